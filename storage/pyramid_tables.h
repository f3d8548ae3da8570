// Header and tables of an open `.isb` file, checked.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/brick_index.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/paged_file.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_info.h"
#include "isobrick/storage/voxel_histogram.h"

namespace isobrick {

// The tables of a pyramid; uses nothing before it is checked. All const members are thread-safe.
class PyramidTables {
 public:
  // A provenance of more bytes is refused: it is text for people, and comes into memory as a whole.
  static constexpr std::uint64_t kMostProvenanceBytes = std::uint64_t{64} << 20;

  // See Pyramid's constructor.
  PyramidTables(const std::string& path, FileAccess access, const RemoteOptions& remote);
  // Those of level 0 that lies elsewhere: no file, and no index(). `values` are the least and the
  // greatest voxel, or bounds of them.
  PyramidTables(std::string name, const PyramidSpec& spec, const ValueRange& values);
  ~PyramidTables();

  // As it was opened; a URL without its secrets.
  const std::string& path() const { return path_; }
  const PagedFile& bytes() const { return file_; }
  const format::Header& header() const { return header_; }
  // True for files of earlier programs that have bounds of the error (docs/FORMAT.md section 9).
  bool hasErrorKind() const {
    return std::find(header_.kinds, header_.kinds + header_.kind_count, format::kErrorKind) !=
           header_.kinds + header_.kind_count;
  }
  const PyramidSpec& spec() const { return spec_; }
  const BrickLayout& layout() const { return layout_; }
  const Lattice& lattice() const { return layout_.lattice(); }
  const ValueRange& valueRange() const { return value_range_; }
  // Voxels without data.
  std::uint64_t missingVoxels() const { return spec_.has_missing ? header_.missing_voxels : 0; }
  const std::string& provenance() const { return provenance_; }
  // The rows of the brick table, of a divided pyramid of those of all its files. None if level 0
  // lies elsewhere.
  const BrickIndex& index() const { return *index_; }

  // Which file of a divided pyramid it is, if it is one; an index has a division() too.
  const std::optional<DividedFile>& dividedFile() const { return divided_file_; }
  const PyramidDivision* division() const { return division_.get(); }
  // Header::division, whose checksum was right.
  std::vector<std::byte> divisionBytes() const;
  // Bytes of all files.
  std::uint64_t fileBytes() const {
    return division_ != nullptr ? division_->fileBytes() : file_.size();
  }

  // As Pyramid's.
  VoxelHistogram histogram() const;
  PyramidSums sums() const;
  // How steep the voxels of level 0 are along the isosurface of every value; nothing in files of
  // earlier programs, and if all voxels are equal. Throws Error if it is damaged.
  std::optional<GradientSpectrum> gradients() const;

  // Throws Error: "'path' ...".
  [[noreturn]] void fail(const std::string& what, ErrorPlace place = {}) const;

 private:
  using enum PartKind;
  void readHeader();
  void announceTables(const format::Header& header) const;
  void readTables(const format::Header& header);
  void readDivision();
  std::vector<std::byte> readTable(std::uint64_t offset, std::uint64_t bytes,
                                   std::uint64_t checksum, const char* name) const;

  const std::string path_;
  PagedFile file_;
  format::Header header_{};
  PyramidSpec spec_;
  BrickLayout layout_;
  ValueRange value_range_;
  std::string provenance_;
  const RemoteOptions remote_;
  std::optional<DividedFile> divided_file_;
  std::shared_ptr<const PyramidDivision> division_;  // of an index
  std::unique_ptr<BrickIndex> index_;
};

}  // namespace isobrick
