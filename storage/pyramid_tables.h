// Header and tables of an open `.isb` file, checked.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/brick_index.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/paged_file.h"
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
  ~PyramidTables();

  const std::string& path() const { return file_.path(); }
  const PagedFile& bytes() const { return file_; }
  const format::Header& header() const { return header_; }
  const PyramidSpec& spec() const { return spec_; }
  const BrickLayout& layout() const { return layout_; }
  const Lattice& lattice() const { return layout_.lattice(); }
  const ValueRange& valueRange() const { return value_range_; }
  const std::string& provenance() const { return provenance_; }
  // The rows of the brick table.
  const BrickIndex& index() const { return *index_; }

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
  std::vector<std::byte> readTable(std::uint64_t offset, std::uint64_t bytes,
                                   std::uint64_t checksum, const char* name) const;

  PagedFile file_;
  format::Header header_{};
  PyramidSpec spec_;
  BrickLayout layout_;
  ValueRange value_range_;
  std::string provenance_;
  std::unique_ptr<BrickIndex> index_;
};

}  // namespace isobrick
