// NIfTI-1, NIfTI-2 and Analyze 7.5. The NIfTI library gives the form of the headers and their byte
// order. Its own reader prints on the standard error, believes sizes that are impossible and holds
// the whole volume; so the voxels are streamed as those of other formats are.
#include <nifti2_io.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <initializer_list>
#include <iterator>
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/stored_array.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// What the headers of all three have, of any byte order.
struct NiftiHeader {
  bool is_nifti = false;  // Analyze has no magic
  bool is_one_file = false;
  bool big_endian = false;
  std::uint64_t header_bytes = 0;
  std::array<std::int64_t, 8> dim = {};  // the number of axes, then the voxels along each
  std::array<double, 8> pixdim = {};
  int data_type = 0, units = 0, qform_code = 0, sform_code = 0;
  double voxel_offset = 0, slope = 0, intercept = 0;
  glm::dvec3 quaternion{0.0}, offset{0.0};
  std::array<std::array<double, 4>, 3> rows = {};  // of the sform
};

template <typename Header>
NiftiHeader headerFrom(const unsigned char* bytes, bool big_endian) {
  Header h;
  std::memcpy(&h, bytes, sizeof h);
  if (big_endian) {
    if constexpr (std::is_same_v<Header, nifti_1_header>)
      nifti_swap_as_nifti1(&h);
    else
      nifti_swap_as_nifti2(&h);
  }
  NiftiHeader header;
  header.is_nifti = h.magic[0] == 'n' && (h.magic[1] == 'i' || h.magic[1] == '+') &&
                    h.magic[2] >= '1' && h.magic[2] <= '9' && h.magic[3] == 0;
  header.is_one_file = header.is_nifti && h.magic[1] == '+';
  header.big_endian = big_endian;
  header.header_bytes = sizeof h;
  for (std::size_t i = 0; i < 8; ++i) {
    header.dim[i] = h.dim[i];
    header.pixdim[i] = h.pixdim[i];
  }
  header.data_type = h.datatype;
  header.voxel_offset = static_cast<double>(h.vox_offset);
  if (!header.is_nifti) return header;
  header.units = h.xyzt_units & 7;
  header.slope = h.scl_slope;
  header.intercept = h.scl_inter;
  header.qform_code = h.qform_code;
  header.sform_code = h.sform_code;
  header.quaternion = {h.quatern_b, h.quatern_c, h.quatern_d};
  header.offset = {h.qoffset_x, h.qoffset_y, h.qoffset_z};
  for (std::size_t i = 0; i < 4; ++i) {
    header.rows[0][i] = h.srow_x[i];
    header.rows[1][i] = h.srow_y[i];
    header.rows[2][i] = h.srow_z[i];
  }
  return header;
}

bool isGzipped(const InputFile& file) {
  std::array<unsigned char, 2> magic = {};
  return file.readAt(0, magic.data(), magic.size()) == magic.size() && magic[0] == 0x1f &&
         magic[1] == 0x8b;
}

using HeaderBytes = std::array<unsigned char, sizeof(nifti_2_header)>;

// Zeros behind the end of a short file.
std::pair<HeaderBytes, std::size_t> firstBytes(const std::string& path) {
  const auto file = std::make_shared<const InputFile>(path);
  auto stream = makeFileStream(file, 0);
  if (isGzipped(*file)) stream = makeInflateStream(path, std::move(stream));
  HeaderBytes bytes = {};
  const std::size_t count = stream->read(bytes.data(), bytes.size());
  return {bytes, count};
}

bool startsWithSize(const HeaderBytes& bytes, std::uint32_t size) {
  return loadNumber<std::uint32_t>(bytes.data(), false) == size ||
         loadNumber<std::uint32_t>(bytes.data(), true) == size;
}

NiftiHeader readNiftiHeader(const std::string& path) {
  const auto [bytes, count] = firstBytes(path);
  const bool is_second = startsWithSize(bytes, sizeof(nifti_2_header));
  if (count < (is_second ? sizeof(nifti_2_header) : sizeof(nifti_1_header)))
    throw unreadable(path, "its header is cut short; get the whole file again");
  // The library finds the byte order so: dim[0] is 1 .. 7.
  for (const bool big_endian : {false, true}) {
    const NiftiHeader header = is_second ? headerFrom<nifti_2_header>(bytes.data(), big_endian)
                                         : headerFrom<nifti_1_header>(bytes.data(), big_endian);
    if (header.dim[0] < 1 || header.dim[0] > 7) continue;
    for (std::size_t axis = 1; axis <= static_cast<std::size_t>(header.dim[0]); ++axis)
      if (header.dim[axis] < 1)
        throw unusable(path, "it has ", header.dim[axis], " voxels along axis ", axis,
                       "; correct its header");
    return header;
  }
  throw unreadable(path,
                   "its NIfTI header is damaged, or text (.nia); get the whole file again, or "
                   "convert it to .nii");
}

// The file beside `path` that has one of `endings` for `ending` (each perhaps with .gz), or `path`
// if its name ends otherwise; empty if there is none.
std::string besidePair(const std::string& path, const std::string& ending,
                       std::initializer_list<const char*> endings) {
  std::string stem = path;
  if (stem.ends_with(".gz")) stem.resize(stem.size() - 3);
  if (!stem.ends_with(ending)) return path;
  stem.resize(stem.size() - ending.size());
  for (const char* other : endings)
    if (inputIsThere(stem + other)) return stem + other;
  return "";
}

std::string headerPathOf(const std::string& path) {
  return besidePair(path, ".img", {".hdr", ".hdr.gz"});
}

// Where the numbers are: behind the header, or in the other file of the pair.
NumberFiles numberFiles(const std::string& header_path, const NiftiHeader& header) {
  NumberFiles files;
  files.header_path = header_path;
  const std::string data_path =
      header.is_one_file ? header_path : besidePair(header_path, ".hdr", {".img", ".img.gz"});
  if (data_path.empty())
    throw unreadable(
        header_path,
        "there is no .img file of that name beside it; put both files of the pair into one folder");
  files.paths = {data_path};
  if (isGzipped(InputFile(data_path, data_path == header_path ? "" : header_path)))
    files.form = NumberFiles::Form::kGzip;
  if (!(header.voxel_offset >= 0 && header.voxel_offset < 0x1p62))
    throw unreadable(header_path, "it says that the voxels begin at byte ", header.voxel_offset,
                     "; correct vox_offset in its header");
  files.skipped_bytes = static_cast<std::int64_t>(header.voxel_offset);
  if (header.is_one_file)
    files.skipped_bytes =
        std::max(files.skipped_bytes, static_cast<std::int64_t>(header.header_bytes));
  return files;
}

// Colours and complex numbers are several numbers together.
struct NiftiType {
  int code;
  StoredType type;
  std::int64_t numbers = 1;  // of a voxel
};
constexpr NiftiType kNiftiTypes[] = {
    {NIFTI_TYPE_UINT8, StoredType::kUint8},     {NIFTI_TYPE_RGB24, StoredType::kUint8, 3},
    {NIFTI_TYPE_RGBA32, StoredType::kUint8, 4}, {NIFTI_TYPE_INT8, StoredType::kInt8},
    {NIFTI_TYPE_UINT16, StoredType::kUint16},   {NIFTI_TYPE_INT16, StoredType::kInt16},
    {NIFTI_TYPE_UINT32, StoredType::kUint32},   {NIFTI_TYPE_INT32, StoredType::kInt32},
    {NIFTI_TYPE_UINT64, StoredType::kUint64},   {NIFTI_TYPE_INT64, StoredType::kInt64},
    {NIFTI_TYPE_FLOAT32, StoredType::kFloat32}, {NIFTI_TYPE_COMPLEX64, StoredType::kFloat32, 2},
    {NIFTI_TYPE_FLOAT64, StoredType::kFloat64}, {NIFTI_TYPE_COMPLEX128, StoredType::kFloat64, 2}};

const NiftiType& niftiType(const std::string& path, int code) {
  const auto found = std::ranges::find(kNiftiTypes, code, &NiftiType::code);
  if (found == std::end(kNiftiTypes))
    throw unusable(path, "its voxels are of NIfTI type ", code,
                   ", which is no plain number; convert it first");
  return *found;
}

// As nibabel: a slope that is 0 or not finite means that nothing is scaled, whatever the intercept;
// an intercept that is not finite is none.
std::optional<StoredVoxels::Map> valueMap(const NiftiHeader& header,
                                          std::vector<std::string>& notes) {
  if (!std::isfinite(header.slope) || header.slope == 0) return std::nullopt;
  const double intercept = std::isfinite(header.intercept) ? header.intercept : 0;
  if (header.slope == 1 && intercept == 0) return std::nullopt;
  notes.push_back("slope " + shortText(header.slope) + " and intercept " + shortText(intercept) +
                  " were applied to the stored values");
  return StoredVoxels::Map{header.slope, intercept};
}

// The forms of a place, in NIfTI's world (right, anterior, superior).

StatedPlaces sform(const NiftiHeader& header) {
  StatedPlaces places;
  for (int row = 0; row < 3; ++row) {
    const auto& numbers = header.rows[static_cast<std::size_t>(row)];
    for (int axis = 0; axis < 3; ++axis)
      places.steps[axis][row] = numbers[static_cast<std::size_t>(axis)];
    places.origin[row] = numbers[3];
  }
  return places;
}

double voxelSize(const NiftiHeader& header, int axis) {
  const double size = std::abs(header.pixdim[static_cast<std::size_t>(axis) + 1]);
  return std::isfinite(size) && size > 0 ? size : 1;
}

StatedPlaces qform(const NiftiHeader& header) {
  const glm::dvec3& q = header.quaternion;
  const nifti_dmat44 matrix = nifti_quatern_to_dmat44(
      q.x, q.y, q.z, header.offset.x, header.offset.y, header.offset.z, voxelSize(header, 0),
      voxelSize(header, 1), voxelSize(header, 2), header.pixdim[0] < 0 ? -1 : 1);
  StatedPlaces places;
  for (int row = 0; row < 3; ++row) {
    for (int axis = 0; axis < 3; ++axis) places.steps[axis][row] = matrix.m[row][axis];
    places.origin[row] = matrix.m[row][3];
  }
  return places;
}

// As nibabel's for a file without either: x from right to left, the middle at 0.
StatedPlaces placesOfSizes(const NiftiHeader& header, const Index3& voxels) {
  StatedPlaces places;
  for (int axis = 0; axis < 3; ++axis) {
    places.steps[axis][axis] = (axis == 0 ? -1 : 1) * voxelSize(header, axis);
    places.origin -= places.steps[axis] * (static_cast<double>(voxels[axis] - 1) / 2);
  }
  return places;
}

// How far the corners of two places are apart.
double greatestDistance(const StatedPlaces& a, const StatedPlaces& b, const Index3& voxels) {
  double distance = 0;
  for (unsigned corner = 0; corner < 8; ++corner) {
    glm::dvec3 index(0.0);
    for (int axis = 0; axis < 3; ++axis)
      if ((corner >> axis & 1u) != 0) index[axis] = static_cast<double>(voxels[axis] - 1);
    distance =
        std::max(distance, glm::length(a.origin + a.steps * index - b.origin - b.steps * index));
  }
  return distance;
}

// The format's rule, as nibabel's get_best_affine(): the sform if it has a code, else the qform if
// it has one, else the sizes of voxels alone.
StatedPlaces bestPlaces(const NiftiHeader& header, const Index3& voxels,
                        std::vector<std::string>& notes) {
  if (header.sform_code <= 0) {
    if (header.qform_code > 0) return qform(header);
    notes.emplace_back(
        "neither sform nor qform has a code, so the place is unknown: sizes of voxels alone were "
        "used, and the middle of the volume was put at 0");
    return placesOfSizes(header, voxels);
  }
  const StatedPlaces best = sform(header);
  if (header.qform_code > 0) {
    const StatedPlaces other = qform(header);
    const double distance = greatestDistance(best, other, voxels);
    const double smallest =
        std::min({voxelSize(header, 0), voxelSize(header, 1), voxelSize(header, 2)});
    if (!(distance <= 0.01 * smallest))
      notes.push_back(concat("its sform (code ", header.sform_code, ") and its qform (code ",
                             header.qform_code, ") put voxels up to ", distance,
                             " apart; the sform was taken"));
  }
  return best;
}

// The grid in the world of DICOM (left, posterior, superior).
void takeGrid(const std::string& path, const NiftiHeader& header, VolumeInfo& info) {
  StatedPlaces places = bestPlaces(header, info.voxels, info.notes);
  for (int row = 0; row < 2; ++row) {
    for (int axis = 0; axis < 3; ++axis) places.steps[axis][row] *= -1;
    places.origin[row] *= -1;
  }
  info.geometry = oneGrid(path, places, info.voxels, info.notes);
  info.geometry.origin += 0.0;  // no negative zeros
  static constexpr const char* kUnits[] = {"", "meter", "millimeter", "micrometer"};
  const auto code = static_cast<std::size_t>(header.units);
  const std::string unit = !header.is_nifti           ? "millimeter"  // Analyze 7.5
                           : code < std::size(kUnits) ? kUnits[code]
                                                      : "code " + std::to_string(code);
  takeLengthUnits({unit, unit, unit}, info);
}

}  // namespace

bool isNiftiFile(const std::string& path) {
  std::string name = lowercase(path);
  if (name.ends_with(".gz")) name.resize(name.size() - 3);
  if (name.ends_with(".nii") || name.ends_with(".nia")) return true;
  if (!name.ends_with(".hdr") && !name.ends_with(".img")) return false;
  const std::string header_path = headerPathOf(path);
  if (header_path.empty() || !inputIsThere(header_path)) return false;
  const HeaderBytes bytes = firstBytes(header_path).first;
  return startsWithSize(bytes, sizeof(nifti_1_header)) ||
         startsWithSize(bytes, sizeof(nifti_2_header));
}

std::unique_ptr<VolumeSource> openNiftiSource(const std::string& path, const OpenOptions& options) {
  const std::string header_path = headerPathOf(path);
  const NiftiHeader header = readNiftiHeader(header_path);
  VolumeInfo info;
  info.source = path;
  info.format = "NIfTI";
  StoredArray array;
  array.files = numberFiles(header_path, header);
  const NiftiType& type = niftiType(path, header.data_type);
  array.stored.type = type.type;
  array.stored.big_endian = header.big_endian;
  using Use = StoredAxis::Use;
  array.axes = {{type.numbers, Use::kValues}};
  for (std::size_t axis = 1; axis <= 7; ++axis) {
    const bool is_there = axis <= static_cast<std::size_t>(header.dim[0]);
    array.axes.push_back({is_there ? header.dim[axis] : 1, axis <= 3   ? Use::kSpace
                                                           : axis == 4 ? Use::kTime
                                                                       : Use::kValues});
  }
  info.voxels = volumeVoxels(path, array.axes);
  takeGrid(path, header, info);
  if (array.axes.front().size == 1)  // the map is of plain numbers
    array.stored.map = valueMap(header, info.notes);
  return openStoredArray(std::move(info), array, options);
}

}  // namespace isobrick
