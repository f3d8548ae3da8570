#include "isobrick/preprocess/sources/nifti_run.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <iterator>
#include <limits>

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/inflate_stream.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

constexpr std::size_t kHeaderBytes = 348;

bool isGzipped(const InputFile& file) {
  std::array<unsigned char, 2> magic = {};
  return file.readAt(0, magic.data(), magic.size()) == magic.size() && magic[0] == 0x1f &&
         magic[1] == 0x8b;
}

// The file beside `path` that has one of `endings` for `ending` (each perhaps with .gz), or `path`
// if its name ends otherwise.
std::string besidePair(const std::string& path, const std::string& ending,
                       std::initializer_list<const char*> endings) {
  std::string stem = path;
  if (stem.ends_with(".gz")) stem.resize(stem.size() - 3);
  if (!stem.ends_with(ending)) return path;
  stem.resize(stem.size() - ending.size());
  for (const char* other : endings)
    if (inputIsThere(stem + other)) return stem + other;
  throw unreadable(path, "there is no '" + stem + *endings.begin() +
                             "' beside it; put both files of the pair into one folder");
}

class NiftiHeader {
 public:
  explicit NiftiHeader(const std::string& path) {
    const auto file = std::make_shared<const InputFile>(path);
    auto stream = makeFileStream(file, 0);
    if (isGzipped(*file)) stream = makeInflateStream(path, std::move(stream));
    if (stream->read(bytes_.data(), kHeaderBytes) != kHeaderBytes)
      throw unreadable(path, "its header is cut short; get the whole file again");
    if (isNifti2())
      throw unusable(path, "it is NIfTI-2, which is not read; convert it to NIfTI-1 or NRRD");
    // How the NIfTI library finds the byte order: dim[0] is 1 .. 7.
    if (dim(0) < 1 || dim(0) > 7) {
      big_endian_ = true;
      if (dim(0) < 1 || dim(0) > 7)
        throw unreadable(path,
                         "its NIfTI header is damaged, or text (.nia); get the whole file again, "
                         "or convert it to .nii");
    }
  }

  bool bigEndian() const { return big_endian_; }
  bool isNifti() const {  // Analyze has no magic
    return bytes_[344] == 'n' && (bytes_[345] == 'i' || bytes_[345] == '+') && bytes_[346] >= '1' &&
           bytes_[346] <= '9' && bytes_[347] == 0;
  }
  bool isOneFile() const { return isNifti() && bytes_[345] == '+'; }
  // The number of axes, and behind it that of the voxels along each.
  int dim(int i) const { return at<std::int16_t>(40 + 2 * static_cast<std::size_t>(i)); }
  int dataType() const { return at<std::int16_t>(70); }
  // The unit of lengths by xyzt_units; Analyze 7.5 has them in millimetres.
  std::string lengthUnit() const {
    static constexpr const char* kUnits[] = {"", "meter", "millimeter", "micrometer"};
    const unsigned code = isNifti() ? bytes_[123] & 7u : 2u;
    return code < std::size(kUnits) ? kUnits[code] : "code " + std::to_string(code);
  }
  double voxelOffset() const { return static_cast<double>(at<float>(108)); }
  double slope() const { return static_cast<double>(at<float>(112)); }
  double intercept() const { return static_cast<double>(at<float>(116)); }

 private:
  // Its header has 540 bytes, and says so in the byte order of the file.
  bool isNifti2() const {
    return loadNumber<std::uint32_t>(bytes_.data(), false) == 540 ||
           loadNumber<std::uint32_t>(bytes_.data(), true) == 540;
  }
  template <typename T>
  T at(std::size_t offset) const {
    return loadNumber<T>(&bytes_[offset], big_endian_);
  }

  std::array<unsigned char, kHeaderBytes> bytes_ = {};
  bool big_endian_ = false;
};

// RGB24, RGBA32, complex64 and complex128.
std::size_t numbersTogether(int data_type) {
  if (data_type == 128) return 3;
  if (data_type == 2304) return 4;
  return data_type == 32 || data_type == 1792 ? 2 : 1;
}

StoredType storedType(const std::string& path, int data_type) {
  switch (data_type) {
    case 2:
    case 128:
    case 2304:
      return StoredType::kUint8;
    case 4:
      return StoredType::kInt16;
    case 8:
      return StoredType::kInt32;
    case 16:
    case 32:
      return StoredType::kFloat32;
    case 1792:
    case 64:
      return StoredType::kFloat64;
    case 256:
      return StoredType::kInt8;
    case 512:
      return StoredType::kUint16;
    case 768:
      return StoredType::kUint32;
    case 1024:
      return StoredType::kInt64;
    case 1280:
      return StoredType::kUint64;
    default:
      throw unusable(path, "its voxels are of NIfTI type " + std::to_string(data_type) +
                               ", which is no plain number; convert it first");
  }
}

// As in the NIfTI library and ITK: numbers that are not finite count as 0, and a slope of 0 as 1.
std::optional<StoredVoxels::Map> valueMap(const NiftiHeader& header) {
  if (!header.isNifti()) return std::nullopt;
  StoredVoxels::Map map;
  if (std::isfinite(header.slope()) && header.slope() != 0) map.slope = header.slope();
  if (std::isfinite(header.intercept())) map.intercept = header.intercept();
  constexpr double kNothing = std::numeric_limits<double>::epsilon();
  if (std::abs(map.slope) <= kNothing) return std::nullopt;
  if (std::abs(map.slope - 1) <= kNothing && std::abs(map.intercept) <= kNothing)
    return std::nullopt;
  return map;
}

}  // namespace

NiftiRun findNiftiRun(const std::string& path) {
  NiftiRun result;
  RawRun& run = result.run;
  run.header_path = besidePair(path, ".img", {".hdr", ".hdr.gz"});
  const NiftiHeader header(run.header_path);
  run.path = header.isOneFile() ? run.header_path
                                : besidePair(run.header_path, ".hdr", {".img", ".img.gz"});
  const double offset = header.voxelOffset();
  if (!(offset >= 0 && offset < 0x1p31))
    throw unreadable(run.header_path, "it says that the voxels begin at byte " +
                                          std::to_string(offset) +
                                          "; correct vox_offset in its header");
  auto offset_bytes = static_cast<std::uint64_t>(offset);
  if (header.isOneFile()) offset_bytes = std::max<std::uint64_t>(offset_bytes, kHeaderBytes);
  run.is_deflated = isGzipped(InputFile(run.path, run.path == path ? "" : path));
  (run.is_deflated ? run.content_offset_bytes : run.offset_bytes) = offset_bytes;

  result.length_unit = header.lengthUnit();
  result.numbers_together = numbersTogether(header.dataType());
  result.stored.type = storedType(path, header.dataType());
  result.stored.big_endian = header.bigEndian();
  result.stored.map = valueMap(header);
  return result;
}

void checkNiftiHeader(const std::string& path) {
  std::string name = lowercase(path);
  if (name.ends_with(".gz")) name.resize(name.size() - 3);
  if (!name.ends_with(".nii")) return;
  const NiftiHeader header(path);
  static_cast<void>(storedType(path, header.dataType()));
  for (int axis = 1; axis <= header.dim(0); ++axis)
    if (header.dim(axis) < 1)
      throw unusable(path, "it has " + std::to_string(header.dim(axis)) + " voxels along axis " +
                               std::to_string(axis) + "; correct its header");
}

}  // namespace isobrick
