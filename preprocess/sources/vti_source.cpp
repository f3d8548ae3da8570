// VTK ImageData, as ParaView writes it: XML (.vti, .pvti) and the legacy format (.vtk).
#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/assembled_source.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/preprocess/sources/vti_header.h"
#include "isobrick/preprocess/sources/vti_voxels.h"
#include "isobrick/preprocess/sources/vtk_legacy_header.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Exactly N numbers with blanks between them.
template <typename T, std::size_t N>
std::optional<std::array<T, N>> numbers(const std::string& text) {
  std::array<T, N> values{};
  const char* at = text.data();
  const char* const end = at + text.size();
  const auto skipBlanks = [&] {
    while (at != end && (*at == ' ' || *at == '\t' || *at == '\r' || *at == '\n')) ++at;
  };
  for (T& value : values) {
    skipBlanks();
    const auto result = std::from_chars(at, end, value);
    if (result.ec != std::errc() || (result.ptr != end && *result.ptr > ' ')) return std::nullopt;
    at = result.ptr;
  }
  skipBlanks();
  if (at != end) return std::nullopt;
  return values;
}

StoredType vtiStoredType(const std::string& path, const std::string& name) {
  if (const auto type = storedTypeNamed(lowercase(name))) return *type;  // "UInt8"
  if (name == "Bit") return StoredType::kUint8;
  throw cannotUseVti(path, "its voxels are of the type " + inQuotes(name) + ", which is no number");
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
      throw cannotUseVti(path_,
                         "it holds VTK's " + inQuotes(header_.file_type) + ", not ImageData");
    const std::string& order = header_.byte_order;
    if (!order.empty() && order != "LittleEndian" && order != "BigEndian")
      throw cannotUseVti(path_, "its byte order " + inQuotes(order) + " is unknown");
    const std::string& type = header_.header_type;
    if (!type.empty() && type != "UInt32" && type != "UInt64")
      throw cannotUseVti(path_, "its header type " + inQuotes(type) + " is unknown");
    if (!knowsVtiCompressor(header_.compressor))
      throw cannotUseVti(path_, "it is compressed by " + inQuotes(header_.compressor) +
                                    ", and only VTK's compressors by zlib, LZ4 and LZMA are known");
    if (header_.pieces.empty()) throw cannotUseVti(path_, "it has no piece, and so no voxels");
  }

  Extent extentIn(const std::string& text, const char* name) const {
    const auto extent = numbers<std::int64_t, 6>(text);
    // VTK's own are int: greater ones would overflow sums below.
    constexpr std::int64_t kMost = std::int64_t{1} << 31;
    if (!extent || std::any_of(extent->begin(), extent->end(),
                               [](std::int64_t v) { return v < -kMost || v > kMost; }))
      throw cannotUseVti(
          path_, std::string("its ") + name + " " + inQuotes(text) + " is not six whole numbers");
    return *extent;
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
    const auto values = numbers<double, 3>(text);
    if (!values)
      throw cannotUseVti(
          path_, "its " + std::string(name) + " " + inQuotes(text) + " is not three numbers");
    return {(*values)[0], (*values)[1], (*values)[2]};
  }

  void takeDirection() {
    if (header_.direction.empty()) return;
    const auto rows = numbers<double, 9>(header_.direction);
    if (!rows)
      throw cannotUseVti(path_,
                         "its Direction " + inQuotes(header_.direction) + " is not nine numbers");
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
    auto chosen = std::find_if(data.arrays.begin(), data.arrays.end(), isWanted);
    if (chosen == data.arrays.end() && options_.grid.empty())
      chosen = std::find_if(data.arrays.begin(), data.arrays.end(), fits);
    return chosen == data.arrays.end() ? nullptr : &*chosen;
  }

  static std::string listOf(const VtiPiece& piece) {
    constexpr std::size_t kMostListed = 12;
    std::string text;
    std::size_t listed = 0;
    for (const auto& [data, kind] : {std::pair(&piece.points, "points"), {&piece.cells, "cells"}})
      for (const VtiArray& array : data->arrays)
        if (listed++ < kMostListed)
          text += (text.empty() ? "" : ", ") + inQuotes(array.name) + " of " + kind;
    return text.empty() ? "none" : text + (listed > kMostListed ? ", ..." : "");
  }

  void chooseArray() {
    const VtiPiece& piece = header_.pieces.front();
    const VtiArray* chosen = findArray(piece.points);
    is_of_cells_ = chosen == nullptr;
    if (is_of_cells_) chosen = findArray(piece.cells);
    if (chosen == nullptr && !options_.grid.empty())
      throw Error(
          "'" + path_ + "' has no array " + inQuotes(options_.grid) + "; it has " + listOf(piece),
          {.path = path_});
    if (chosen == nullptr)
      throw cannotUseVti(path_, std::string("it has no array with ") +
                                    (options_.component ? "several values" : "one value") +
                                    " per voxel; it has " + listOf(piece));
    array_ = *chosen;
    array_.components = std::max<std::uint64_t>(array_.components, 1);
    if (array_.components > 1 && !options_.component)
      throw Error(
          cannotUseVti(path_, "its array " + inQuotes(array_.name) + " has " +
                                  std::to_string(array_.components) +
                                  " values per voxel (ParaView's filter Calculator takes one "
                                  "out)")
              .what(),
          {.path = path_}, {Remedy::kChooseComponent});
    checkComponentChoice(path_, array_.components, options_);
    const std::size_t arrays = piece.points.arrays.size() + piece.cells.arrays.size();
    if (arrays > 1)
      info_.notes.push_back("of " + std::to_string(arrays) + " arrays, " + inQuotes(array_.name) +
                            " was taken");
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
        throw cannotUseVti(path_, "its piece " + inQuotes(piece.source) + " is no .vti file");
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
        throw cannotUseVti(path_, "its piece " + inQuotes(piece.source) +
                                      " has not the extent or the type that it says");
      parts.push_back(std::move(part));
    }
    info_.source = path_;
    info_.format = "VTK ImageData";
    return makeAssembledSource(std::move(info_), std::move(parts), {path_});
  }

  // Of its first voxel in the whole.
  Index3 placeOf(const VtiPiece& piece, const Extent& extent) const {
    Index3 first;
    for (int axis = 0; axis < 3; ++axis)
      first[axis] =
          extent[static_cast<std::size_t>(2 * axis)] - whole_[static_cast<std::size_t>(2 * axis)];
    if (glm::any(glm::lessThan(first, Index3(0))) ||
        glm::any(glm::greaterThan(first + voxelsOf(extent), info_.voxels)))
      throw cannotUseVti(path_, "its piece covers " + inQuotes(piece.extent) +
                                    ", beyond the whole extent " + inQuotes(header_.whole_extent));
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
    return makeAssembledSource(std::move(info_), std::move(parts), {path_});
  }

  // The one that was chosen of the first piece.
  void takeArrayOf(const VtiPiece& piece) {
    const auto& arrays = (is_of_cells_ ? piece.cells : piece.points).arrays;
    const auto found = std::find_if(arrays.begin(), arrays.end(), [&](const VtiArray& array) {
      return array.name == array_.name && array.type == array_.type &&
             std::max<std::uint64_t>(array.components, 1) == array_.components;
    });
    if (found == arrays.end())
      throw cannotUseVti(path_, "one of its pieces has no array " + inQuotes(array_.name) +
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
