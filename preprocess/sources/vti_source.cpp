// VTK XML ImageData (.vti), as ParaView writes it.
#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <utility>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/inflate_stream.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/preprocess/sources/vti_header.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Text of a file, fit for a line of a message.
std::string inQuotes(const std::string& text) { return quotedText(text, 60); }

Error cannotUse(const std::string& path, const std::string& reason) {
  return unusable(path, reason + "; save it again with ParaView, or convert it to .nrrd or .mhd");
}

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

StoredType storedType(const std::string& path, const std::string& name) {
  if (const auto type = storedTypeNamed(lowercase(name))) return *type;  // "UInt8"
  throw cannotUse(path, "its voxels are of the type " + inQuotes(name) + ", which is no number");
}

// Opening, step by step; each refuses files that it cannot use.
class VtiOpener {
 public:
  VtiOpener(const std::string& path, const OpenOptions& options)
      : path_(path),
        options_(options),
        file_(std::make_shared<const InputFile>(path)),
        header_(readVtiHeader(*file_)) {}

  std::unique_ptr<VolumeSource> open() {
    checkFileKind();
    takeGeometry();
    chooseArray();
    info_.source = path_;
    info_.format = "VTK ImageData";
    stored_.type = storedType(path_, array_.type);
    stored_.big_endian = header_.byte_order == "BigEndian";
    info_.voxel_type = stored_.delivered();
    takeComponent(array_.components, options_, stored_, info_);
    const auto bytes = stored_.bytesOf(elementCount(info_.voxels));
    if (!bytes) throw wrongSize("less than 2^64");
    need_bytes_ = *bytes;
    return openVoxels();
  }

 private:
  void checkFileKind() const {
    if (header_.file_type != "ImageData")
      throw cannotUse(path_, "it holds VTK's " + inQuotes(header_.file_type) + ", not ImageData");
    const std::string& order = header_.byte_order;
    if (!order.empty() && order != "LittleEndian" && order != "BigEndian")
      throw cannotUse(path_, "its byte order " + inQuotes(order) + " is unknown");
    const std::string& type = header_.header_type;
    if (!type.empty() && type != "UInt32" && type != "UInt64")
      throw cannotUse(path_, "its header type " + inQuotes(type) + " is unknown");
    if (!header_.compressor.empty() && header_.compressor != "vtkZLibDataCompressor")
      throw cannotUse(path_, "it is compressed by " + inQuotes(header_.compressor) +
                                 ", and only vtkZLibDataCompressor or none is read");
    if (header_.piece_extents.size() != 1)
      throw cannotUse(path_, "it has " + std::to_string(header_.piece_extents.size()) +
                                 " pieces and must have one");
  }

  void takeGeometry() {
    const auto extent = numbers<std::int64_t, 6>(header_.whole_extent);
    // VTK's own are int: greater ones would overflow sums below.
    constexpr std::int64_t kMost = std::int64_t{1} << 31;
    if (!extent || std::any_of(extent->begin(), extent->end(),
                               [](std::int64_t v) { return v < -kMost || v > kMost; }))
      throw cannotUse(
          path_, "its WholeExtent " + inQuotes(header_.whole_extent) + " is not six whole numbers");
    if (numbers<std::int64_t, 6>(header_.piece_extents[0]) != extent)
      throw cannotUse(path_, "its piece covers " + inQuotes(header_.piece_extents[0]) +
                                 " and not the whole extent " + inQuotes(header_.whole_extent));
    const glm::dvec3 origin = vector(header_.origin, glm::dvec3(0), "Origin");
    GridGeometry& geometry = info_.geometry;
    geometry.spacing = vector(header_.spacing, glm::dvec3(1), "Spacing");
    takeDirection();
    geometry.origin = origin;
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(2 * axis);
      info_.voxels[axis] = (*extent)[i + 1] - (*extent)[i] + 1;
      // Origin is the position of index 0, which need not be in the extent.
      geometry.origin +=
          geometry.direction[axis] * (geometry.spacing[axis] * static_cast<double>((*extent)[i]));
    }
    checkVoxelCounts(path_, info_.voxels);
    tidyGeometry(path_, geometry, info_.voxels, info_.notes);
  }

  glm::dvec3 vector(const std::string& text, const glm::dvec3& otherwise, const char* name) const {
    if (text.empty()) return otherwise;
    const auto values = numbers<double, 3>(text);
    if (!values)
      throw cannotUse(path_,
                      "its " + std::string(name) + " " + inQuotes(text) + " is not three numbers");
    return {(*values)[0], (*values)[1], (*values)[2]};
  }

  void takeDirection() {
    if (header_.direction.empty()) return;
    const auto rows = numbers<double, 9>(header_.direction);
    if (!rows)
      throw cannotUse(path_,
                      "its Direction " + inQuotes(header_.direction) + " is not nine numbers");
    for (int axis = 0; axis < 3; ++axis)
      for (int row = 0; row < 3; ++row)
        info_.geometry.direction[axis][row] = (*rows)[static_cast<std::size_t>(3 * row + axis)];
  }

  // The array that the user named; or the one that the file calls its scalars, or the first that
  // can be them: of one value per voxel, or of several if one is to be taken of them.
  void chooseArray() {
    const auto& arrays = header_.point_arrays;
    const bool wants_several = options_.component.has_value();
    const auto fits = [&](const VtiArray& array) {
      return (array.components > 1) == wants_several;
    };
    const auto isWanted = [&](const VtiArray& array) {
      if (!options_.grid.empty()) return array.name == options_.grid;
      if (header_.scalars.empty()) return fits(array);
      return array.name == header_.scalars && (fits(array) || !wants_several);
    };
    auto chosen = std::find_if(arrays.begin(), arrays.end(), isWanted);
    if (chosen == arrays.end() && options_.grid.empty())
      chosen = std::find_if(arrays.begin(), arrays.end(), fits);
    if (arrays.empty() && header_.has_cell_arrays)
      throw cannotUse(path_,
                      "it has values of cells and none of points (ParaView's filter Cell "
                      "Data to Point Data makes them)");
    if (chosen == arrays.end() && !options_.grid.empty())
      throw cannotUse(path_, "it has no array of points named " + inQuotes(options_.grid));
    if (chosen == arrays.end())
      throw cannotUse(path_, wants_several
                                 ? "it has no array of points with several values per voxel"
                                 : "it has no array of points with one value per voxel");
    array_ = *chosen;
    array_.components = std::max<std::uint64_t>(array_.components, 1);
    if (array_.components > 1 && !wants_several)
      throw Error(cannotUse(path_, "its array " + inQuotes(array_.name) + " has " +
                                       std::to_string(array_.components) +
                                       " values per voxel (ParaView's filter Calculator takes one "
                                       "out)")
                      .what(),
                  {.path = path_}, {Remedy::kChooseComponent});
    checkComponentChoice(path_, array_.components, options_);
    if (arrays.size() > 1)
      info_.notes.push_back("of " + std::to_string(arrays.size()) + " arrays, " +
                            inQuotes(array_.name) + " was taken");
  }

  // ---- where the voxels are --------------------------------------------------------------------

  std::unique_ptr<VolumeSource> openVoxels() {
    locate();
    const std::uint64_t first_word = readWord();
    if (header_.compressor.empty()) {
      if (first_word != need_bytes_) throw wrongSize(std::to_string(first_word));
      return openPlain();
    }
    return openBlocks(first_word);
  }

  // Opens the stream of the array's bytes in the file: numbers of its own, then the voxels.
  void locate() {
    is_base64_ = true;
    at_ = array_.text_at;
    if (array_.format == "appended") {
      if (header_.appended_encoding != "raw" && header_.appended_encoding != "base64")
        throw cannotUse(path_, header_.appended_encoding.empty()
                                   ? "it has no appended data, which its array needs"
                                   : "the encoding " + inQuotes(header_.appended_encoding) +
                                         " of its appended data is unknown");
      is_base64_ = header_.appended_encoding == "base64";
      if (array_.offset > file_->size() - header_.appended_at)
        throw cannotUse(path_, "the offset " + std::to_string(array_.offset) +
                                   " of its array lies behind the end of the file");
      at_ = header_.appended_at + array_.offset;
    } else if (array_.format != "binary") {
      throw cannotUse(path_, "its voxels are in the format " + inQuotes(array_.format) +
                                 ", and only appended and binary are read");
    }
    stream_ = is_base64_ ? makeBase64Stream(file_, at_) : makeFileStream(file_, at_);
  }

  std::uint64_t wordBytes() const { return header_.header_type == "UInt64" ? 8 : 4; }

  std::uint64_t readWord() {
    std::array<unsigned char, 8> bytes = {};
    const auto count = static_cast<std::size_t>(wordBytes());
    if (stream_->read(bytes.data(), count) != count)
      throw cannotUse(path_, "its voxels are cut short at their beginning");
    at_ += count;
    return loadUnsigned(bytes.data(), count, stored_.big_endian);
  }

  std::unique_ptr<VolumeSource> openPlain() {
    if (is_base64_)
      return openStream(std::move(info_), stored_, std::move(stream_), 0, {path_}, {},
                        options_.cancel);
    RawRun run;
    run.path = run.header_path = path_;
    run.offset_bytes = at_;
    return openRawRun(std::move(info_), run, stored_, options_.cancel);
  }

  std::unique_ptr<VolumeSource> openBlocks(std::uint64_t blocks) {
    const std::uint64_t block_bytes = readWord();
    const std::uint64_t last_bytes = readWord();  // 0 if the last block is whole
    std::uint64_t whole_bytes = 0, have = 0;
    const std::uint64_t whole_blocks = blocks - (blocks > 0 && last_bytes > 0 ? 1 : 0);
    const bool fits = block_bytes > 0 && last_bytes <= block_bytes &&
                      !__builtin_mul_overflow(whole_blocks, block_bytes, &whole_bytes) &&
                      !__builtin_add_overflow(whole_bytes, last_bytes, &have);
    if (blocks == 0 || !fits || have != need_bytes_)
      throw wrongSize(fits ? std::to_string(have)
                           : std::to_string(blocks) + " blocks of " + std::to_string(block_bytes));
    // The end of one block is the begin of the next; the list of their sizes is not needed. There
    // are at most as many blocks as bytes in the file: no product overflows.
    if (blocks > file_->size() / wordBytes() ||
        skipBytes(*stream_, blocks * wordBytes()) != blocks * wordBytes())
      throw cannotUse(path_, "its list of " + std::to_string(blocks) + " blocks is cut short");
    return openStream(std::move(info_), stored_,
                      makeInflateBlocksStream(path_, std::move(stream_), block_bytes, need_bytes_),
                      0, {path_}, {}, options_.cancel);
  }

  Error wrongSize(const std::string& have) const {
    return cannotUse(path_, "its array " + inQuotes(array_.name) + " has " + have +
                                " bytes and its " + "extent needs " + std::to_string(need_bytes_));
  }

  std::string path_;
  const OpenOptions options_;
  std::shared_ptr<const InputFile> file_;
  VtiHeader header_;
  VolumeInfo info_;
  VtiArray array_;
  StoredVoxels stored_;
  std::uint64_t need_bytes_ = 0;
  // For the array: its encoding, and the first unread byte of it. at_ is that byte of the file only
  // if nothing is encoded.
  bool is_base64_ = false;
  std::uint64_t at_ = 0;
  std::unique_ptr<ByteStream> stream_;
};

}  // namespace

std::unique_ptr<VolumeSource> openVtiSource(const std::string& path, const OpenOptions& options) {
  return VtiOpener(path, options).open();
}

}  // namespace isobrick
