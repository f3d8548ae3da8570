#include "array_source.h"

#include <nanobind/ndarray.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

// IEEE 754 half precision, as numpy has it.
struct Half {
  std::uint16_t bits;
  explicit operator float() const {
    const std::uint32_t sign = static_cast<std::uint32_t>(bits & 0x8000u) << 16;
    const std::uint32_t exponent = bits >> 10 & 0x1fu, mantissa = bits & 0x3ffu;
    if (exponent == 0) {
      const float tiny = static_cast<float>(mantissa) * 0x1p-24F;
      return sign != 0 ? -tiny : tiny;
    }
    const std::uint32_t wide = exponent == 31 ? 255u : exponent + 112u;
    return std::bit_cast<float>(sign | wide << 23 | mantissa << 13);
  }
};

template <typename F>
void visitStored(const std::string& type, F&& f) {
  if (type == "u1") return f(VoxelTag<std::uint8_t>{});
  if (type == "i1") return f(VoxelTag<std::int8_t>{});
  if (type == "u2") return f(VoxelTag<std::uint16_t>{});
  if (type == "i2") return f(VoxelTag<std::int16_t>{});
  if (type == "u4") return f(VoxelTag<std::uint32_t>{});
  if (type == "i4") return f(VoxelTag<std::int32_t>{});
  if (type == "u8") return f(VoxelTag<std::uint64_t>{});
  if (type == "i8") return f(VoxelTag<std::int64_t>{});
  if (type == "f2") return f(VoxelTag<Half>{});
  if (type == "f4") return f(VoxelTag<float>{});
  if (type == "f8") return f(VoxelTag<double>{});
  throw Error("voxels of numpy's type '" + type +
              "' are no real numbers that a pyramid can hold; convert the array with astype()");
}

// Halves become floats.
template <typename Stored>
using Delivered = std::conditional_t<std::is_same_v<Stored, Half>, float, Stored>;

template <typename Stored>
Stored load(const std::byte* from, bool is_swapped) {
  std::array<std::byte, sizeof(Stored)> bytes;
  std::memcpy(bytes.data(), from, sizeof(Stored));
  if (is_swapped)
    for (std::size_t i = 0; i < sizeof(Stored) / 2; ++i)
      std::swap(bytes[i], bytes[sizeof(Stored) - 1 - i]);
  return std::bit_cast<Stored>(bytes);
}

// The common part of both kinds.
class BoxSource : public VolumeSource {
 public:
  BoxSource(VolumeInfo info, std::string identity)
      : info_(std::move(info)), identity_(std::move(identity)) {}
  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return identity_; }
  bool readsBoxes() const override { return true; }

 private:
  VolumeInfo info_;
  std::string identity_;
};

template <typename Stored>
class StridedSource final : public BoxSource {
 public:
  StridedSource(VolumeInfo info, const StridedArray& array, std::string identity)
      : BoxSource(std::move(info), std::move(identity)), array_(array) {}

  void readBox(const IndexBox& box, void* out) const override {
    auto* to = static_cast<Delivered<Stored>*>(out);
    const bool is_run = std::is_same_v<Stored, Delivered<Stored>> && !array_.is_swapped &&
                        array_.strides.x == static_cast<std::int64_t>(sizeof(Stored));
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; ++y) {
        const std::byte* from =
            reinterpret_cast<const std::byte*>(array_.address) +
            (box.first.x * array_.strides.x + y * array_.strides.y + z * array_.strides.z);
        if (is_run) {
          std::memcpy(to, from, static_cast<std::size_t>(box.count.x) * sizeof(Stored));
          to += box.count.x;
          continue;
        }
        for (std::int64_t x = 0; x < box.count.x; ++x, from += array_.strides.x)
          *to++ = static_cast<Delivered<Stored>>(load<Stored>(from, array_.is_swapped));
      }
  }

 private:
  StridedArray array_;
};

class ReaderSource final : public BoxSource {
 public:
  ReaderSource(VolumeInfo info, nb::handle read, std::uint64_t buffer_bytes, std::string identity)
      : BoxSource(std::move(info), std::move(identity)), read_(read), buffer_bytes_(buffer_bytes) {}

  std::uint64_t bufferBytes() const override { return buffer_bytes_; }
  void readBox(const IndexBox& box, void* out) const override {
    const nb::gil_scoped_acquire locked;
    const nb::object result =
        read_(box.first.x, box.first.y, box.first.z, box.count.x, box.count.y, box.count.z);
    const auto voxels = nb::cast<nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>>(result);
    std::memcpy(out, voxels.data(), voxels.nbytes());
  }

 private:
  nb::handle read_;  // the caller's: this object goes without the interpreter's lock
  std::uint64_t buffer_bytes_;
};

// Boxes are read: it is never opened again.
std::unique_ptr<VolumeSource> derivedFrom(std::unique_ptr<VolumeSource> numbers,
                                          const Derivation& derivation) {
  if (!takesNumbers(derivation)) numbers = withVoxels(std::move(numbers), nullptr);
  return derivedVolume(std::move(numbers), derivation);
}

}  // namespace

VoxelType deliveredType(const std::string& type) {
  VoxelType result = VoxelType::kFloat32;
  visitStored(type,
              [&](auto tag) { result = voxelTypeOf<Delivered<typename decltype(tag)::Type>>(); });
  return result;
}

void cellContrasts(const StridedArray& array, const Index3& voxels, std::span<const double> points,
                   std::span<float> out) {
  visitStored(array.type, [&](auto tag) {
    using Stored = typename decltype(tag)::Type;
    const auto* const base = reinterpret_cast<const std::byte*>(array.address);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, out.size()), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        Index3 first, last;  // cells
        for (int axis = 0; axis < 3; ++axis) {
          const double at = points[3 * i + static_cast<std::size_t>(axis)];
          const auto below = static_cast<std::int64_t>(std::floor(at));
          const bool is_between = static_cast<double>(below) < at;
          first[axis] = std::max<std::int64_t>(is_between ? below : below - 1, 0);
          last[axis] = std::min(below, voxels[axis] - 2);
        }
        float most = 0;
        Index3 cell;
        for (cell.z = first.z; cell.z <= last.z; ++cell.z)
          for (cell.y = first.y; cell.y <= last.y; ++cell.y)
            for (cell.x = first.x; cell.x <= last.x; ++cell.x) {
              float least = std::numeric_limits<float>::infinity(), greatest = -least;
              for (int corner = 0; corner < 8; ++corner) {
                const Index3 at =
                    (cell + Index3(corner & 1, corner >> 1 & 1, corner >> 2)) * array.strides;
                const auto value =
                    static_cast<float>(load<Stored>(base + at.x + at.y + at.z, false));
                least = std::min(least, value);
                greatest = std::max(greatest, value);
              }
              most = std::max(most, greatest - least);
            }
        out[i] = most;
      }
    });
  });
}

std::unique_ptr<VolumeSource> makeStridedSource(VolumeInfo info, const StridedArray& array,
                                                std::string identity,
                                                const Derivation& derivation) {
  std::unique_ptr<VolumeSource> source;
  info.voxel_type = deliveredType(array.type);
  visitStored(array.type, [&](auto tag) {
    source = std::make_unique<StridedSource<typename decltype(tag)::Type>>(std::move(info), array,
                                                                           std::move(identity));
  });
  return derivedFrom(std::move(source), derivation);
}

std::unique_ptr<VolumeSource> makeReaderSource(VolumeInfo info, nb::handle read,
                                               std::uint64_t buffer_bytes, std::string identity,
                                               const Derivation& derivation) {
  return derivedFrom(
      std::make_unique<ReaderSource>(std::move(info), read, buffer_bytes, std::move(identity)),
      derivation);
}

}  // namespace isobrick::python
