// MRC and CCP4 maps: one header of 1,024 bytes, an extension that is skipped, and the voxels.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <string_view>
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/stored_array.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr std::size_t kMrcHeaderBytes = 1024;

// What a mode says of a voxel.
struct MrcMode {
  std::int32_t mode;
  StoredType type;
  std::int64_t numbers = 1;  // of a voxel
};
constexpr MrcMode kMrcModes[] = {
    {0, StoredType::kUint8},    {1, StoredType::kInt16},      {2, StoredType::kFloat32},
    {3, StoredType::kInt16, 2}, {4, StoredType::kFloat32, 2}, {6, StoredType::kUint16},
    {12, StoredType::kFloat16}, {16, StoredType::kUint8, 3},  {101, StoredType::kUint8}};
constexpr std::int32_t kNibbleMode = 101;

// The header, byte by byte as the standard of 2014 numbers it.
class MrcHeader {
 public:
  explicit MrcHeader(const std::string& path) : path_(path) {
    const auto file = std::make_shared<const InputFile>(path);
    auto stream = makeFileStream(file, 0);
    is_packed_ = lowercase(path).ends_with(".gz");
    if (is_packed_) stream = makeInflateStream(path, std::move(stream));
    is_whole_ = stream->read(bytes_.data(), bytes_.size()) == bytes_.size();
    constexpr unsigned char kBig = 0x11, kLittle = 0x44;
    const unsigned char stamp = bytes_[212];
    big_endian_ = stamp == kBig || (stamp != kLittle && !isMode(number(12)));
  }

  // Files of before 2000 have no "MAP" and are known by their name as well.
  bool hasWord() const { return is_whole_ && std::memcmp(&bytes_[208], "MAP", 3) == 0; }
  bool isPlausible() const {
    return is_whole_ && isMode(number(12)) && isCount(number(0)) && isCount(number(4)) &&
           isCount(number(8)) && number(92) >= 0;
  }

  bool isPacked() const { return is_packed_; }
  bool bigEndian() const { return big_endian_; }
  std::int64_t extensionBytes() const { return number(92); }
  Index3 counts() const { return threeNumbers(0); }  // columns, rows, sections
  Index3 starts() const { return threeNumbers(16); }
  // Of the cell, along x, y and z.
  Index3 samples() const { return threeNumbers(28); }
  glm::dvec3 cell() const { return threeLengths(40); }
  glm::dvec3 angles() const { return threeLengths(52); }
  glm::dvec3 origin() const { return threeLengths(196); }

  // The axes (0 .. 2 for x, y, z) along columns, rows and sections.
  Index3 axes() const {
    const Index3 axes = threeNumbers(64);
    if (axes == Index3(0)) return {0, 1, 2};
    Index3 uses(0);
    for (int axis = 0; axis < 3; ++axis)
      if (axes[axis] < 1 || axes[axis] > 3 || uses[static_cast<int>(axes[axis]) - 1]++ > 0)
        throw unusable(path_, "its axes are not x, y and z in some order; correct its header");
    return axes - Index3(1);
  }

  MrcMode mode() const {
    const auto found = std::ranges::find(kMrcModes, number(12), &MrcMode::mode);
    if (found == std::end(kMrcModes))
      throw unusable(path_, "its voxels are of MRC mode ", number(12),
                     ", which is not read; convert it to mode 2");
    MrcMode mode = *found;
    if (mode.mode == 0 && hasSignedBytes()) mode.type = StoredType::kInt8;
    return mode;
  }

  // Volumes one behind the other: space group 401, or with the symmetry of another.
  std::int64_t volumes() const {
    constexpr std::int32_t kFirstOfStacks = 401, kLastOfStacks = 630;
    const std::int32_t group = number(88), sections = number(36);
    if (group < kFirstOfStacks || group > kLastOfStacks) return 1;
    if (sections < 1 || number(8) < sections || number(8) % sections != 0)
      throw unusable(path_, "it is a stack of volumes of ", sections, " sections each and has ",
                     number(8), " in all; correct its header");
    return number(8) / sections;
  }

 private:
  static bool isMode(std::int32_t number) {
    return std::ranges::count(kMrcModes, number, &MrcMode::mode) > 0;
  }
  static bool isCount(std::int32_t count) { return count > 0 && count <= kMaxVoxelsPerAxis; }

  std::int32_t number(std::size_t at) const {
    return loadNumber<std::int32_t>(&bytes_[at], big_endian_);
  }
  Index3 threeNumbers(std::size_t at) const { return {number(at), number(at + 4), number(at + 8)}; }
  glm::dvec3 threeLengths(std::size_t at) const {
    const auto length = [&](std::size_t i) { return loadNumber<float>(&bytes_[i], big_endian_); };
    return {length(at), length(at + 4), length(at + 8)};
  }

  // By the flags of IMOD, or by the standard of 2014. Older headers do not say.
  bool hasSignedBytes() const {
    constexpr std::int32_t kImodStamp = 1146047817;  // "IMOD" in the file's byte order
    if (number(152) == kImodStamp) return (number(156) & 1) != 0;
    return number(108) / 10 == 2014;
  }

  std::string path_;
  std::array<unsigned char, kMrcHeaderBytes> bytes_ = {};
  bool is_whole_ = false, is_packed_ = false, big_endian_ = false;
};

// The edges of a cell, x along the world's, y in its plane, as all programs of the field have it.
glm::dmat3 cellEdges(glm::dvec3 degrees) {
  const bool is_stated = degrees.x > 0 && degrees.y > 0 && degrees.z > 0;
  if (!is_stated || degrees == glm::dvec3(90)) return glm::dmat3(1.0);
  const auto cosine = [&](int i) { return std::cos(degrees[i] * std::numbers::pi / 180); };
  const double alpha = cosine(0), beta = cosine(1), gamma = cosine(2);
  const double sine = std::sqrt(1 - gamma * gamma);
  const double along_y = (alpha - beta * gamma) / sine;
  return {glm::dvec3(1, 0, 0), glm::dvec3(gamma, sine, 0),
          glm::dvec3(beta, along_y, std::sqrt(1 - beta * beta - along_y * along_y))};
}

// As mrcfile, ChimeraX and gemmi have it: the origin if there is one, else the index of the first
// voxel in the cell.
void takePlace(const std::string& path, const MrcHeader& header, VolumeInfo& info) {
  const Index3 axes = header.axes();
  const glm::dvec3 cell = header.cell();
  const bool has_cell = cell.x != 0 && cell.y != 0 && cell.z != 0;
  const glm::dmat3 edges = cellEdges(header.angles());
  StatedPlaces places;
  for (int axis = 0; axis < 3; ++axis) {
    const int world = static_cast<int>(axes[axis]);
    const std::int64_t stated = header.samples()[world];
    const double samples = static_cast<double>(stated > 0 ? stated : info.voxels[axis]);
    places.steps[axis] = edges[world] * (has_cell ? cell[world] / samples : 1.0);
  }
  places.origin = header.origin();
  if (places.origin == glm::dvec3(0)) places.origin = places.steps * glm::dvec3(header.starts());
  places.origin += 0.0;  // no negative zeros
  info.geometry = oneGrid(path, places, info.voxels, info.notes);
  const std::string unit = has_cell ? "angstrom" : "";
  takeLengthUnits({unit, unit, unit}, info);
}

}  // namespace

bool isMrcFile(const std::string& path) {
  std::string name = lowercase(path);
  const bool is_packed = name.ends_with(".gz");
  if (is_packed) name.resize(name.size() - 3);
  constexpr std::string_view kEndings[] = {".mrc", ".mrcs", ".map", ".ccp4",
                                           ".st",  ".ali",  ".rec", ".preali"};
  const bool is_named = std::ranges::any_of(
      kEndings, [&](std::string_view ending) { return name.ends_with(ending); });
  if (is_packed && !is_named) return false;
  const MrcHeader header(path);
  return header.hasWord() || (is_named && header.isPlausible());
}

std::unique_ptr<VolumeSource> openMrcSource(const std::string& path, const OpenOptions& options) {
  const MrcHeader header(path);
  if (header.extensionBytes() < 0)
    throw unusable(path, "its header has an extension of ", header.extensionBytes(),
                   " bytes; correct it");
  const MrcMode mode = header.mode();
  const Index3 counts = header.counts();
  const std::int64_t volumes = header.volumes();
  using Use = StoredAxis::Use;
  VolumeInfo info;
  info.source = path;
  info.format = "MRC";
  StoredArray array;
  array.stored.type = mode.type;
  array.stored.big_endian = header.bigEndian();
  array.axes = {{mode.numbers, Use::kValues},
                {counts.x, Use::kSpace},
                {counts.y, Use::kSpace},
                {counts.z / volumes, Use::kSpace},
                {volumes, Use::kImages}};
  array.files.header_path = path;
  array.files.paths = {path};
  array.files.skipped_bytes = static_cast<std::int64_t>(kMrcHeaderBytes) + header.extensionBytes();
  if (header.isPacked()) array.files.form = NumberFiles::Form::kGzip;
  if (mode.mode == kNibbleMode) {
    if (header.isPacked())
      throw unusable(path, "its voxels of 4 bits are packed with gzip; unpack it first");
    array.files.form = NumberFiles::Form::kNibbles;
    array.files.row_numbers = static_cast<std::uint64_t>(counts.x);
  }
  info.voxels = volumeVoxels(path, array.axes);
  takePlace(path, header, info);
  return openStoredArray(std::move(info), array, options);
}

}  // namespace isobrick
