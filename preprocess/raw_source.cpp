// Volumes without a header, and raw voxels that another file's header describes.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "preprocess/raw_run.h"
#include "preprocess/source_checks.h"
#include "preprocess/volume_source.h"
#include "storage/error.h"

namespace isobrick {
namespace {

enum class Stored { kUint8, kInt8, kUint16, kInt16, kUint32, kInt32, kFloat32, kFloat64 };

struct StoredType {
  Stored stored;
  std::size_t bytes;
  VoxelType delivered;
};

std::size_t bytesOf(Stored stored) {
  switch (stored) {
    case Stored::kUint8:
    case Stored::kInt8:
      return 1;
    case Stored::kUint16:
    case Stored::kInt16:
      return 2;
    case Stored::kUint32:
    case Stored::kInt32:
    case Stored::kFloat32:
      return 4;
    case Stored::kFloat64:
      return 8;
  }
  return 0;
}

VoxelType deliveredFor(Stored stored) {
  switch (stored) {
    case Stored::kUint8:
      return VoxelType::kUint8;
    case Stored::kInt8:
      return VoxelType::kInt8;
    case Stored::kUint16:
      return VoxelType::kUint16;
    case Stored::kInt16:
      return VoxelType::kInt16;
    default:
      return VoxelType::kFloat32;
  }
}

StoredType storedType(const std::string& path, const std::string& name) {
  struct Alias {
    std::string_view name;
    Stored stored;
  };
  static constexpr std::array kAliases = {
      Alias{"u8", Stored::kUint8},        Alias{"uint8", Stored::kUint8},
      Alias{"uchar", Stored::kUint8},     Alias{"i8", Stored::kInt8},
      Alias{"int8", Stored::kInt8},       Alias{"char", Stored::kInt8},
      Alias{"u16", Stored::kUint16},      Alias{"uint16", Stored::kUint16},
      Alias{"ushort", Stored::kUint16},   Alias{"i16", Stored::kInt16},
      Alias{"int16", Stored::kInt16},     Alias{"short", Stored::kInt16},
      Alias{"u32", Stored::kUint32},      Alias{"uint32", Stored::kUint32},
      Alias{"uint", Stored::kUint32},     Alias{"i32", Stored::kInt32},
      Alias{"int32", Stored::kInt32},     Alias{"int", Stored::kInt32},
      Alias{"f32", Stored::kFloat32},     Alias{"float32", Stored::kFloat32},
      Alias{"float", Stored::kFloat32},   Alias{"f64", Stored::kFloat64},
      Alias{"float64", Stored::kFloat64}, Alias{"double", Stored::kFloat64},
  };
  for (const Alias& alias : kAliases)
    if (alias.name == name)
      return {alias.stored, bytesOf(alias.stored), deliveredFor(alias.stored)};
  throw Error("cannot read '" + path + "': unknown voxel type '" + name +
              "'; choose one of u8, i8, u16, i16, u32, i32, f32, f64");
}

// Reverses the bytes of `count` elements in place.
template <typename Bits>
void swapBytes(void* data, std::size_t count) {
  auto* at = static_cast<unsigned char*>(data);
  for (std::size_t i = 0; i < count; ++i, at += sizeof(Bits)) {
    Bits bits;
    std::memcpy(&bits, at, sizeof bits);
    if constexpr (sizeof(Bits) == 2) bits = __builtin_bswap16(bits);
    if constexpr (sizeof(Bits) == 4) bits = __builtin_bswap32(bits);
    if constexpr (sizeof(Bits) == 8) bits = __builtin_bswap64(bits);
    std::memcpy(at, &bits, sizeof bits);
  }
}

void swapElements(void* data, std::size_t count, std::size_t element_bytes) {
  if (element_bytes == 2) swapBytes<std::uint16_t>(data, count);
  if (element_bytes == 4) swapBytes<std::uint32_t>(data, count);
  if (element_bytes == 8) swapBytes<std::uint64_t>(data, count);
}

template <typename T>
void convertToFloat(const std::byte* in, std::size_t count, float* out) {
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    std::memcpy(&value, in + i * sizeof(T), sizeof(T));
    out[i] = static_cast<float>(value);
  }
}

class RawSource final : public VolumeSource {
 public:
  // `header_path` is empty where the user gave the layout.
  RawSource(const std::string& path, const RawLayout& layout, const std::string& header_path)
      : header_path_(header_path),
        type_(storedType(path, layout.type)),
        // The byte order of the machine is little-endian (storage/format.h).
        swap_(layout.big_endian && type_.bytes > 1),
        offset_bytes_(layout.offset_bytes) {
    checkVoxelCounts(path, layout.voxels);
    info_.voxels = layout.voxels;
    info_.voxel_type = type_.delivered;
    info_.geometry.spacing = layout.spacing;
    info_.source = path;
    info_.format = "raw";
    if (isConverted()) info_.notes.push_back(layout.type + " voxels were converted to float32");
    tidyGeometry(path, info_.geometry, info_.notes);
    open(path);
  }

  ~RawSource() override { close(fd_); }
  RawSource(const RawSource&) = delete;
  RawSource& operator=(const RawSource&) = delete;

  const VolumeInfo& info() const override { return info_; }

  void readSlices(std::int64_t first, std::int64_t count, void* out) override {
    const std::size_t slice_voxels = static_cast<std::size_t>(info_.voxels.x * info_.voxels.y);
    const std::size_t slice_bytes_out = slice_voxels * voxelBytes(info_.voxel_type);
    for (std::int64_t k = first; k < first + count; ++k) {
      readSlice(k, slice_voxels, static_cast<std::byte*>(out));
      out = static_cast<std::byte*>(out) + slice_bytes_out;
    }
  }

 private:
  // Opens the file and compares its size with the layout's.
  void open(const std::string& path) {
    fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd_ < 0)
      throw Error("cannot open '" + path + "'" +
                  (header_path_.empty() ? "" : ", which '" + header_path_ + "' names") + ": " +
                  std::strerror(errno) + "; check the path");
    try {
      checkSize();
    } catch (...) {
      close(fd_);
      throw;
    }
    posix_fadvise(fd_, 0, 0, POSIX_FADV_SEQUENTIAL);
  }

  void checkSize() const {
    struct stat status = {};
    if (fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode))
      throw Error("cannot read '" + info_.source + "': it is not a regular file; copy it to one");
    const auto have = static_cast<std::uint64_t>(status.st_size);
    // At most 2^60 voxels of 8 bytes, so only the offset can overflow.
    const auto voxel_bytes = static_cast<std::uint64_t>(elementCount(info_.voxels)) * type_.bytes;
    std::uint64_t need = 0;
    const bool overflow = __builtin_add_overflow(voxel_bytes, offset_bytes_, &need);
    const bool may_be_longer = !header_path_.empty();
    if (!overflow && (have == need || (may_be_longer && have > need))) return;
    const std::string needed = overflow ? "more than 2^64" : std::to_string(need);
    const std::string sizes = "cannot read '" + info_.source + "': it has " + std::to_string(have) +
                              " bytes, but an offset of " + std::to_string(offset_bytes_) +
                              " and " + voxelCountsText(info_.voxels) + " voxels of " +
                              std::to_string(type_.bytes) +
                              (type_.bytes == 1 ? " byte make " : " bytes make ") + needed;
    if (!header_path_.empty())
      throw Error(sizes + " (from the header '" + header_path_ + "'); get the whole file again");
    throw Error(sizes + "; check --raw-dims, --raw-type and --raw-offset" +
                (overflow || have < need ? ", or get the whole file" : ""));
  }

  void readSlice(std::int64_t slice, std::size_t voxels, std::byte* out) {
    const std::size_t bytes = voxels * type_.bytes;
    const bool converts = isConverted();
    if (converts) buffer_.resize(bytes);
    std::byte* const target = converts ? buffer_.data() : out;
    readBytes(slice, target, bytes);
    if (swap_) swapElements(target, voxels, type_.bytes);
    if (!converts) return;
    // `out` is aligned for the voxel type by the caller's contract.
    float* const result = reinterpret_cast<float*>(out);
    if (type_.stored == Stored::kUint32) convertToFloat<std::uint32_t>(target, voxels, result);
    if (type_.stored == Stored::kInt32) convertToFloat<std::int32_t>(target, voxels, result);
    if (type_.stored == Stored::kFloat64) convertToFloat<double>(target, voxels, result);
  }

  void readBytes(std::int64_t slice, std::byte* target, std::size_t bytes) {
    constexpr std::size_t kMostPerCall = std::size_t{1} << 30;  // Linux reads < 2^31 a call
    std::uint64_t at = offset_bytes_ + static_cast<std::uint64_t>(slice) * bytes;
    while (bytes > 0) {
      const ssize_t got = pread(fd_, target, std::min(bytes, kMostPerCall), static_cast<off_t>(at));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0)
        throw Error("cannot read slice " + std::to_string(slice) + " of '" + info_.source +
                    "' at byte " + std::to_string(at) + ": " +
                    (got < 0 ? std::strerror(errno) : "the file became shorter meanwhile") +
                    "; check the disk and the file, then run again");
      target += got;
      at += static_cast<std::uint64_t>(got);
      bytes -= static_cast<std::size_t>(got);
    }
  }

  bool isConverted() const {
    return type_.stored == Stored::kUint32 || type_.stored == Stored::kInt32 ||
           type_.stored == Stored::kFloat64;
  }

  std::string header_path_;
  StoredType type_;
  bool swap_;
  std::uint64_t offset_bytes_;
  VolumeInfo info_;
  int fd_ = -1;
  std::vector<std::byte> buffer_;  // one slice as it is stored, where it needs conversion
};

}  // namespace

std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout) {
  return std::make_unique<RawSource>(path, layout, "");
}

std::unique_ptr<VolumeSource> openRawRun(const std::string& header_path, const RawRun& run,
                                         const Index3& voxels, const std::string& type) {
  RawLayout layout;
  layout.voxels = voxels;
  layout.type = type;
  layout.big_endian = run.big_endian;
  layout.offset_bytes = run.offset_bytes;
  return std::make_unique<RawSource>(run.path, layout, header_path);
}

}  // namespace isobrick
