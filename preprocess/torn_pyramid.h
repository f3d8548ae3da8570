// A pyramid that came to harm, as far as its bytes are right: what repairPyramid() works with.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/file_io.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/source_bricks.h"

namespace isobrick {

// One `.isb` file. Its checksums say which bytes are right; header, rows and provenance in which a
// single byte is wrong are put right by them. All const members are thread-safe.
class TornFile {
 public:
  // A file that cannot be read has no header, as one whose header is lost.
  explicit TornFile(const std::string& path);

  const std::string& path() const { return path_; }
  int fd() const { return fd_.get(); }
  std::uint64_t size() const { return size_; }  // 0 if it cannot be opened
  mode_t mode() const { return mode_; }
  const std::optional<format::Header>& header() const { return header_; }
  const PyramidSpec& spec() const { return spec_; }  // of the header
  // "" if it is lost.
  const std::string& provenance() const { return provenance_; }
  // Whether some of these, or of the rows, was put right.
  bool isCorrected() const { return is_corrected_; }

  // Whether the row is right. One that is not may still lead to bytes that are.
  bool isKnown(std::size_t row) const { return row < known_.size() && known_[row]; }
  // All parts of one that is not in the file are absent.
  BrickRow row(std::size_t row) const;
  // As they lie in the file; row < rowCount().
  std::span<const std::byte> rowBytes(std::size_t row) const;
  std::size_t rowCount() const { return known_.size(); }
  std::size_t tableBytes() const { return table_.size(); }

  // The stored bytes of a part; false if they cannot be read or are not those of its checksum.
  bool read(const format::PartEntry& part, std::vector<std::byte>& out) const;
  bool hasZerosAlone(std::uint64_t offset, std::uint64_t bytes) const;

 private:
  bool readAt(std::uint64_t offset, std::span<std::byte> out) const;
  template <typename IsRight>
  bool putOneByteRight(std::span<std::byte> bytes, const IsRight& isRight);

  std::string path_;
  OpenDescriptor fd_;
  std::uint64_t size_ = 0;
  mode_t mode_ = 0;
  std::optional<format::Header> header_;
  PyramidSpec spec_;
  std::string provenance_;
  std::vector<std::byte> table_;
  std::vector<bool> known_;
  bool is_corrected_ = false;
};

// All its files. Const members are thread-safe.
class TornPyramid {
 public:
  // Throws Error if no header is left, or most files of a divided pyramid are missing.
  // `memory_bytes`: for the source of an index.
  TornPyramid(const std::string& path, std::uint64_t memory_bytes);

  const PyramidSpec& spec() const { return spec_; }
  const BrickLayout& layout() const { return layout_; }
  // Those with level 0: of a pyramid that is not divided the one file.
  const std::vector<TornFile>& files() const { return files_; }
  // Of a divided pyramid, whose folder it is in.
  const std::optional<SuperBricks>& superBricks() const { return super_bricks_; }
  const std::optional<TornFile>& index() const { return index_; }
  // That of any file; "" if it is lost.
  const std::string& provenance() const { return provenance_; }

  // Writes the samples of layout().brickSampleBox(0, brick); false if they are lost.
  bool copySamples(const Index3& brick, std::vector<std::byte>& out) const;
  // Reads all of level 0: bricks with samples that nothing has any more, by their place in level 0,
  // x fastest. Nothing: all of them, since the brick table is not in the file.
  std::optional<std::set<std::int64_t>> lostBricks(const CancelFlag* cancel) const;
  // Why the source of an index could not be opened; "" if it was.
  const std::string& sourceFailure() const { return source_failure_; }

 private:
  std::optional<TornFile> index_;
  std::vector<TornFile> files_;
  std::optional<SuperBricks> super_bricks_;
  PyramidSpec spec_;
  BrickLayout layout_;
  std::string provenance_;
  std::unique_ptr<Level0Source> source_;  // of an index, if it could be opened
  std::string source_failure_;
};

// Level 0 of it as a volume, of this name. Voxels of bricks without samples come from the aprons of
// their neighbours, and are 0 where there is none.
class TornVolume final : public VolumeSource {
 public:
  TornVolume(const TornPyramid& pyramid, const std::string& name);

  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return "level 0 of " + info_.source; }
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override;

 private:
  const TornPyramid& pyramid_;
  VolumeInfo info_;
};

}  // namespace isobrick
