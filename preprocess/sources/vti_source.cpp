// VTK ImageData, as ParaView writes it: XML (.vti, .pvti) and the legacy format (.vtk).
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/vti_header.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

struct VolumePart {
  Index3 first{0};                       // of its voxels, in the whole
  std::unique_ptr<VolumeSource> source;  // of the whole's voxel type
};

// The boxes' borders along each axis divide the whole into cells, each of which lies in a box or
// not.
class CoverCheck {
 public:
  CoverCheck(const std::string& path, const Index3& voxels, const std::vector<VolumePart>& parts) {
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<std::int64_t>& cuts = cuts_[static_cast<std::size_t>(axis)];
      cuts = {0, voxels[axis]};
      for (const VolumePart& part : parts) {
        cuts.push_back(part.first[axis]);
        cuts.push_back(part.first[axis] + part.source->info().voxels[axis]);
      }
      std::ranges::sort(cuts);
      cuts.erase(std::unique(cuts.begin(), cuts.end()), cuts.end());
      cells_[axis] = static_cast<std::int64_t>(cuts.size()) - 1;
    }
    constexpr std::int64_t kMostSteps = std::int64_t{1} << 26;
    if (elementCount(cells_) > kMostSteps / static_cast<std::int64_t>(parts.size()))
      throw unusable(path, "it has ", parts.size(),
                     " pieces, which are too many; save it in fewer");
    covered_.resize(static_cast<std::size_t>(elementCount(cells_)));
    for (const VolumePart& part : parts) mark(part.first, part.first + part.source->info().voxels);
    const auto hole = std::ranges::find(covered_, false);
    if (hole == covered_.end()) return;
    const std::int64_t at = hole - covered_.begin();
    const Index3 cell(at % cells_.x, at / cells_.x % cells_.y, at / cells_.x / cells_.y);
    throw unusable(path, "none of its pieces has the voxel ",
                   indexText({cuts_[0][static_cast<std::size_t>(cell.x)],
                              cuts_[1][static_cast<std::size_t>(cell.y)],
                              cuts_[2][static_cast<std::size_t>(cell.z)]}),
                   "; save the whole of it");
  }

 private:
  std::int64_t cellAt(int axis, std::int64_t cut) const {
    const auto& cuts = cuts_[static_cast<std::size_t>(axis)];
    return std::lower_bound(cuts.begin(), cuts.end(), cut) - cuts.begin();
  }
  void mark(const Index3& first, const Index3& end) {
    for (std::int64_t z = cellAt(2, first.z); z < cellAt(2, end.z); ++z)
      for (std::int64_t y = cellAt(1, first.y); y < cellAt(1, end.y); ++y) {
        const auto row = covered_.begin() + (z * cells_.y + y) * cells_.x;
        std::fill(row + cellAt(0, first.x), row + cellAt(0, end.x), true);
      }
  }

  std::array<std::vector<std::int64_t>, 3> cuts_;
  Index3 cells_{0};
  std::vector<bool> covered_;
};

// `info` is that of the whole. Parts may overlap: the later one counts. They are read in order, a
// row at a time. Throws Error, naming the place, if a voxel lies in none.
class AssembledSource final : public VolumeSource {
 public:
  AssembledSource(VolumeInfo info, std::vector<VolumePart> parts)
      : info_(std::move(info)), parts_(std::move(parts)) {
    const CoverCheck check(info_.source, info_.voxels, parts_);
    row_.resize(static_cast<std::size_t>(info_.voxels.x) * voxelBytes(info_.voxel_type));
  }

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count; ++row, to += row_.size())
      for (VolumePart& part : parts_)
        readRow(part, row % info_.voxels.y - part.first.y, row / info_.voxels.y - part.first.z, to);
  }

  std::vector<std::string> files() const override {
    std::vector<std::string> files = {info_.source};
    for (const VolumePart& part : parts_)
      for (const std::string& file : part.source->files())
        if (std::ranges::find(files, file) == files.end()) files.push_back(file);
    return files;
  }
  std::uint64_t bufferBytes() const override {
    std::uint64_t bytes = row_.size();
    for (const VolumePart& part : parts_) bytes += part.source->bufferBytes();
    return bytes;
  }

 private:
  // What the part has of a row of the whole; y and z are its own.
  void readRow(VolumePart& part, std::int64_t y, std::int64_t z, std::byte* out) {
    const Index3& voxels = part.source->info().voxels;
    if (y < 0 || y >= voxels.y || z < 0 || z >= voxels.z) return;
    part.source->readRows(z * voxels.y + y, 1, row_.data());
    const std::size_t bytes = voxelBytes(info_.voxel_type);
    std::memcpy(out + static_cast<std::size_t>(part.first.x) * bytes, row_.data(),
                static_cast<std::size_t>(voxels.x) * bytes);
  }

  VolumeInfo info_;
  std::vector<VolumePart> parts_;
  std::vector<std::byte> row_;  // of a part
};

StoredType vtiStoredType(const std::string& path, const std::string& name) {
  if (const auto type = storedTypeNamed(lowercase(name))) return *type;  // "UInt8"
  if (name == "Bit") return StoredType::kUint8;
  throw cannotUseVti(path, "its voxels are of the type ", inQuotes(name), ", which is no number");
}

// Opening, step by step; each refuses files that it cannot use.
class VtiOpener {
 public:
  VtiOpener(const std::string& path, const OpenOptions& options)
      : path_(path),
        options_(options),
        file_(std::make_shared<const InputFile>(path)),
        header_(lowerExtension(path) == ".vtk" ? readVtkLegacyHeader(*file_)
                                               : readVtiHeader(*file_)) {}

  std::unique_ptr<VolumeSource> open() {
    checkFileKind();
    if (isParallel()) return openFiles();
    chooseArray();
    takeGeometry();
    info_.source = path_;
    info_.format = "VTK ImageData";
    stored_.type = vtiStoredType(path_, array_.type);
    stored_.big_endian = header_.byte_order == "BigEndian" && array_.format != "ascii";
    info_.voxel_type = stored_.delivered();
    takeComponent(array_.components, options_, stored_, info_);
    return openPieces();
  }

 private:
  // First and last index of points along x, y and z.
  using Extent = std::array<std::int64_t, 6>;

  void checkFileKind() const {
    if (header_.file_type != "ImageData" && !isParallel())
      throw cannotUseVti(path_, "it holds VTK's ", inQuotes(header_.file_type), ", not ImageData");
    const std::string& order = header_.byte_order;
    if (!order.empty() && order != "LittleEndian" && order != "BigEndian")
      throw cannotUseVti(path_, "its byte order ", inQuotes(order), " is unknown");
    const std::string& type = header_.header_type;
    if (!type.empty() && type != "UInt32" && type != "UInt64")
      throw cannotUseVti(path_, "its header type ", inQuotes(type), " is unknown");
    if (!knowsVtiCompressor(header_.compressor))
      throw cannotUseVti(path_, "it is compressed by ", inQuotes(header_.compressor),
                         ", and only VTK's compressors by zlib, LZ4 and LZMA are known");
    if (header_.pieces.empty()) throw cannotUseVti(path_, "it has no piece, and so no voxels");
  }

  Extent extentIn(const std::string& text, const char* name) const {
    const auto numbers = wholeNumbersOf(text);
    // VTK's own are int: greater ones would overflow sums below.
    constexpr std::int64_t kMost = std::int64_t{1} << 31;
    Extent extent;
    if (!numbers || numbers->size() != extent.size() ||
        std::ranges::any_of(*numbers, [](std::int64_t v) { return v < -kMost || v > kMost; }))
      throw cannotUseVti(path_, "its ", name, " ", inQuotes(text), " is not six whole numbers");
    std::ranges::copy(*numbers, extent.begin());
    return extent;
  }

  // Of points, or of the cells between them.
  Index3 voxelsOf(const Extent& extent) const {
    Index3 voxels;
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(2 * axis);
      voxels[axis] = extent[i + 1] - extent[i] + (is_of_cells_ ? 0 : 1);
    }
    return voxels;
  }

  void takeGeometry() {
    whole_ = extentIn(header_.whole_extent, "WholeExtent");
    const glm::dvec3 origin = vector(header_.origin, glm::dvec3(0), "Origin");
    GridGeometry& geometry = info_.geometry;
    geometry.spacing = vector(header_.spacing, glm::dvec3(1), "Spacing");
    takeDirection();
    geometry.origin = origin;
    info_.voxels = voxelsOf(whole_);
    for (int axis = 0; axis < 3; ++axis) {
      // Origin is the position of the point 0, which need not be in the extent.
      const double first = static_cast<double>(whole_[static_cast<std::size_t>(2 * axis)]) +
                           (is_of_cells_ ? 0.5 : 0);
      geometry.origin += geometry.direction[axis] * (geometry.spacing[axis] * first);
    }
    checkVoxelCounts(path_, info_.voxels);
    tidyGeometry(path_, geometry, info_.voxels, info_.notes);
  }

  glm::dvec3 vector(const std::string& text, const glm::dvec3& otherwise, const char* name) const {
    if (text.empty()) return otherwise;
    const auto values = numbersOf(text);
    if (!values || values->size() != 3)
      throw cannotUseVti(path_, "its ", name, " ", inQuotes(text), " is not three numbers");
    return {(*values)[0], (*values)[1], (*values)[2]};
  }

  void takeDirection() {
    if (header_.direction.empty()) return;
    const auto rows = numbersOf(header_.direction);
    if (!rows || rows->size() != 9)
      throw cannotUseVti(path_, "its Direction ", inQuotes(header_.direction),
                         " is not nine numbers");
    for (int axis = 0; axis < 3; ++axis)
      for (int row = 0; row < 3; ++row)
        info_.geometry.direction[axis][row] = (*rows)[static_cast<std::size_t>(3 * row + axis)];
  }

  // The array that the user named; or the one that the file calls its scalars, or the first that
  // can be them: of one value per voxel, or of several if one is to be taken of them. Of points, or
  // else of cells.
  const VtiArray* findArray(const VtiPiece::Data& data) const {
    const bool wants_several = options_.component.has_value();
    const auto fits = [&](const VtiArray& array) {
      return (array.components > 1) == wants_several;
    };
    const auto isWanted = [&](const VtiArray& array) {
      if (!options_.grid.empty()) return array.name == options_.grid;
      if (data.scalars.empty()) return fits(array);
      return array.name == data.scalars && (fits(array) || !wants_several);
    };
    auto chosen = std::ranges::find_if(data.arrays, isWanted);
    if (chosen == data.arrays.end() && options_.grid.empty())
      chosen = std::ranges::find_if(data.arrays, fits);
    return chosen == data.arrays.end() ? nullptr : &*chosen;
  }

  static std::string listOf(const VtiPiece& piece) {
    ListText list;
    for (const auto& [data, kind] : {std::pair(&piece.points, "points"), {&piece.cells, "cells"}})
      for (const VtiArray& array : data->arrays) list.add(inQuotes(array.name), " of ", kind);
    return list.text().empty() ? "none" : list.text();
  }

  void chooseArray() {
    const VtiPiece& piece = header_.pieces.front();
    const VtiArray* chosen = findArray(piece.points);
    is_of_cells_ = chosen == nullptr;
    if (is_of_cells_) chosen = findArray(piece.cells);
    if (chosen == nullptr && !options_.grid.empty())
      throw fileError(path_, "'", path_, "' has no array ", inQuotes(options_.grid), "; it has ",
                      listOf(piece));
    if (chosen == nullptr)
      throw cannotUseVti(path_, "it has no array with ",
                         options_.component ? "several values" : "one value", " per voxel; it has ",
                         listOf(piece));
    array_ = *chosen;
    array_.components = std::max<std::uint64_t>(array_.components, 1);
    if (array_.components > 1 && !options_.component)
      throw fileError(
          path_,
          cannotUseVti(path_, "its array ", inQuotes(array_.name), " has ", array_.components,
                       " values per voxel (ParaView's filter Calculator takes one out)")
              .what(),
          Remedy::kChooseComponent);
    checkComponentChoice(path_, array_.components, options_);
    const std::size_t arrays = piece.points.arrays.size() + piece.cells.arrays.size();
    if (arrays > 1)
      info_.notes.push_back(
          concat("of ", arrays, " arrays, ", inQuotes(array_.name), " was taken"));
    if (is_of_cells_)
      info_.notes.push_back("its values are those of cells: voxels are their centres");
  }

  // ---- where the voxels are --------------------------------------------------------------------

  // A .pvti: each piece is a file of its own.
  bool isParallel() const { return header_.file_type == "PImageData"; }

  std::unique_ptr<VolumeSource> openFiles() {
    std::vector<VolumePart> parts;
    for (const VtiPiece& piece : header_.pieces) {
      if (lowerExtension(piece.source) != ".vti")
        throw cannotUseVti(path_, "its piece ", inQuotes(piece.source), " is no .vti file");
      VolumePart part;
      part.source = openVtiSource(
          (std::filesystem::path(path_).parent_path() / piece.source).string(), options_);
      const VolumeInfo& info = part.source->info();
      const Extent extent = extentIn(piece.extent, "piece's Extent");
      if (parts.empty()) {
        is_of_cells_ = voxelsOf(extent) != info.voxels;
        takeGeometry();
        info_.voxel_type = info.voxel_type;
        info_.encoding = info.encoding;
        info_.notes.insert(info_.notes.end(), info.notes.begin(), info.notes.end());
      }
      part.first = placeOf(piece, extent);
      if (voxelsOf(extent) != info.voxels || info.voxel_type != info_.voxel_type)
        throw cannotUseVti(path_, "its piece ", inQuotes(piece.source),
                           " has not the extent or the type that it says");
      parts.push_back(std::move(part));
    }
    info_.source = path_;
    info_.format = "VTK ImageData";
    return std::make_unique<AssembledSource>(std::move(info_), std::move(parts));
  }

  // Of its first voxel in the whole.
  Index3 placeOf(const VtiPiece& piece, const Extent& extent) const {
    Index3 first;
    for (int axis = 0; axis < 3; ++axis)
      first[axis] =
          extent[static_cast<std::size_t>(2 * axis)] - whole_[static_cast<std::size_t>(2 * axis)];
    if (glm::any(glm::lessThan(first, Index3(0))) ||
        glm::any(glm::greaterThan(first + voxelsOf(extent), info_.voxels)))
      throw cannotUseVti(path_, "its piece covers ", inQuotes(piece.extent),
                         ", beyond the whole extent ", inQuotes(header_.whole_extent));
    return first;
  }

  std::unique_ptr<VolumeSource> openPieces() {
    std::vector<VolumePart> parts;
    for (const VtiPiece& piece : header_.pieces) {
      const Extent extent = extentIn(piece.extent, "piece's Extent");
      const Index3 voxels = voxelsOf(extent);
      if (glm::any(glm::lessThan(voxels, Index3(1)))) continue;  // VTK writes empty pieces, too
      VolumePart part;
      part.first = placeOf(piece, extent);
      takeArrayOf(piece);
      VolumeInfo info = info_;
      info.voxels = voxels;
      part.source =
          openVtiVoxels(file_, header_, array_, stored_, std::move(info), options_.cancel);
      if (header_.pieces.size() == 1 && voxels == info_.voxels) return std::move(part.source);
      parts.push_back(std::move(part));
    }
    if (parts.empty()) throw cannotUseVti(path_, "its pieces are empty");
    return std::make_unique<AssembledSource>(std::move(info_), std::move(parts));
  }

  // The one that was chosen of the first piece.
  void takeArrayOf(const VtiPiece& piece) {
    const auto& arrays = (is_of_cells_ ? piece.cells : piece.points).arrays;
    const auto found = std::ranges::find_if(arrays, [&](const VtiArray& array) {
      return array.name == array_.name && array.type == array_.type &&
             std::max<std::uint64_t>(array.components, 1) == array_.components;
    });
    if (found == arrays.end())
      throw cannotUseVti(path_, "one of its pieces has no array ", inQuotes(array_.name),
                         " like that of the first");
    const std::uint64_t components = array_.components;
    array_ = *found;
    array_.components = components;
  }

  std::string path_;
  const OpenOptions options_;
  std::shared_ptr<const InputFile> file_;
  VtiHeader header_;
  VolumeInfo info_;
  VtiArray array_;
  StoredVoxels stored_;
  Extent whole_ = {};
  bool is_of_cells_ = false;
};

}  // namespace

std::unique_ptr<VolumeSource> openVtiSource(const std::string& path, const OpenOptions& options) {
  return VtiOpener(path, options).open();
}

}  // namespace isobrick
