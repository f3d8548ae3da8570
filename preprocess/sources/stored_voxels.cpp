#include "isobrick/preprocess/sources/stored_voxels.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

// Exchanges the halves of each of `count` numbers in place.
template <typename Bits>
void exchangeHalves(unsigned char* data, std::size_t count) {
  constexpr int kHalf = 4 * static_cast<int>(sizeof(Bits));
  for (std::size_t i = 0; i < count; ++i) {
    Bits bits;
    std::memcpy(&bits, data + i * sizeof(Bits), sizeof(Bits));
    bits = static_cast<Bits>(bits << kHalf | bits >> kHalf);
    std::memcpy(data + i * sizeof(Bits), &bits, sizeof(Bits));
  }
}

// Reverses the bytes of `count` elements in place. Halves of halves, because each of the loops
// becomes vector instructions that every x86-64 has; a loop over __builtin_bswap32 does not.
void swapElements(void* data, std::size_t count, std::size_t element_bytes) {
  constexpr std::size_t kBlockBytes = 8 << 10;  // stays in the nearest cache between the loops
  auto* const all = static_cast<unsigned char*>(data);
  const std::size_t bytes = element_bytes == 1 ? 0 : count * element_bytes;
  for (std::size_t at = 0; at < bytes; at += kBlockBytes) {
    const std::size_t block = std::min(kBlockBytes, bytes - at);
    exchangeHalves<std::uint16_t>(all + at, block / 2);
    if (element_bytes >= 4) exchangeHalves<std::uint32_t>(all + at, block / 4);
    if (element_bytes == 8) exchangeHalves<std::uint64_t>(all + at, block / 8);
  }
}

float plainNumber(Half half) {
  const std::uint32_t sign = (half.bits & 0x8000u) << 16, exponent = half.bits >> 10 & 31u,
                      fraction = half.bits & 0x3ffu;
  if (exponent == 0) {
    const float value = std::ldexp(static_cast<float>(fraction), -24);
    return sign != 0 ? -value : value;
  }
  return std::bit_cast<float>(sign | (exponent == 31 ? 255u : exponent + 112u) << 23 |
                              fraction << 13);
}
template <typename T>
T plainNumber(T number) {
  return number;
}

// The number of type T at `from`.
template <typename T>
auto numberAt(const std::byte* from) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return plainNumber(value);
}

template <typename T, typename Out>
void mapNumbers(const StoredVoxels::Map& map, const std::byte* in, std::size_t count, Out* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto number = static_cast<double>(numberAt<T>(in + i * sizeof(T)));
    out[i] = static_cast<Out>(number * map.slope + map.intercept);
  }
}

template <typename T>
void findMagnitudes(const std::byte* in, std::size_t count, std::size_t components, float* out) {
  for (std::size_t i = 0; i < count; ++i) {
    double squares = 0;
    for (std::size_t c = 0; c < components; ++c) {
      const auto value = static_cast<double>(numberAt<T>(in + (i * components + c) * sizeof(T)));
      squares += value * value;
    }
    out[i] = static_cast<float>(std::sqrt(squares));
  }
}

}  // namespace

VoxelType StoredVoxels::delivered() const {
  if (magnitude) return VoxelType::kFloat32;
  if (map) {
    // Single precision holds 24 bits, also of what follows a large intercept.
    constexpr double kMostSteps = 0x1p24;
    const bool fits = bytes() / components <= 2 || type == StoredType::kFloat32;
    return fits && std::abs(map->intercept) <= kMostSteps * std::abs(map->slope)
               ? VoxelType::kFloat32
               : VoxelType::kFloat64;
  }
  for (std::uint32_t i = 0; i < std::size(kVoxelTypes); ++i)
    if (kVoxelTypes[i].name == infoOf(type).name) return static_cast<VoxelType>(i);
  return VoxelType::kFloat32;
}

bool StoredVoxels::keepsType() const {
  return components == 1 && !map && type != StoredType::kFloat16;
}

bool StoredVoxels::isVerbatim() const {
  // The byte order of the machine is little-endian (storage/format.h).
  return keepsType() && (!big_endian || bytes() == 1);
}

void StoredVoxels::decodeInPlace(void* data, std::size_t count) const {
  if (big_endian) swapElements(data, count, bytes());
}

void StoredVoxels::decode(std::byte* stored, std::size_t count, void* out) const {
  const std::size_t number_bytes = storedBytes(type);
  if (components > 1 && !magnitude) {
    for (std::size_t i = 0; i < count; ++i)
      std::memmove(stored + i * number_bytes, stored + (i * components + component) * number_bytes,
                   number_bytes);
    StoredVoxels one = *this;
    one.components = 1;
    if (!one.keepsType()) return one.decode(stored, count, out);
    one.decodeInPlace(stored, count);
    std::memcpy(out, stored, count * number_bytes);
    return;
  }
  if (big_endian) swapElements(stored, count * components, number_bytes);
  const Map to = map.value_or(Map{1, -0.0});  // 0 would lose the sign of -0
  visitStoredType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    if (magnitude)
      findMagnitudes<T>(stored, count, components, static_cast<float*>(out));
    else if (delivered() == VoxelType::kFloat64)
      mapNumbers<T>(to, stored, count, static_cast<double*>(out));
    else
      mapNumbers<T>(to, stored, count, static_cast<float*>(out));
  });
}

namespace {

class MagnitudeSource final : public VolumeSource {
 public:
  MagnitudeSource(VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components)
      : info_(std::move(info)),
        components_(std::move(components)),
        squares_(static_cast<std::size_t>(info_.voxels.x)),
        row_(squares_.size() * sizeof(double)) {}  // of any number

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<float*>(out);
    for (std::int64_t row = first; row < first + count; ++row) {
      std::ranges::fill(squares_, 0.0);
      for (const auto& component : components_) addRow(*component, row);
      for (const double square : squares_) *to++ = static_cast<float>(std::sqrt(square));
    }
  }

  std::vector<std::string> files() const override { return components_.front()->files(); }
  std::uint64_t bufferBytes() const override {
    std::uint64_t bytes = row_.size() + squares_.size() * sizeof(double);
    for (const auto& component : components_) bytes += component->bufferBytes();
    return bytes;
  }

 private:
  void addRow(VolumeSource& component, std::int64_t row) {
    component.readRows(row, 1, row_.data());
    visitNumberType(component.info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      const T* const values = reinterpret_cast<const T*>(row_.data());
      for (std::size_t i = 0; i < squares_.size(); ++i)
        squares_[i] += static_cast<double>(values[i]) * static_cast<double>(values[i]);
    });
  }

  VolumeInfo info_;
  std::vector<std::unique_ptr<VolumeSource>> components_;
  std::vector<double> squares_;
  std::vector<std::byte> row_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeMagnitudeSource(
    VolumeInfo info, std::vector<std::unique_ptr<VolumeSource>> components) {
  return std::make_unique<MagnitudeSource>(std::move(info), std::move(components));
}

void checkComponentChoice(const std::string& path, std::uint64_t components,
                          const OpenOptions& options) {
  if (components == 1) return refuseComponentChoice(path, options);
  const std::string values = concat(components, " values per voxel");
  if (components == 0 || components > kMostComponents)
    throw unusable(path, "it has ", values, ", and 1 to ", kMostComponents,
                   " are read; correct its header");
  if (!options.component)
    throw unusable(path, "it has ", values,
                   " (colour, vector or complex); extract one channel first",
                   Remedy::kChooseComponent);
  const std::int64_t index = options.component->index;
  if (!options.component->magnitude &&
      (index < 0 || static_cast<std::uint64_t>(index) >= components))
    throw unusable(path, "it has ", values, ", 0 to ", components - 1, ", and none is number ",
                   index, Remedy::kChooseComponent);
}

void refuseComponentChoice(const std::string& path, const OpenOptions& options) {
  if (options.component)
    throw fileError(path, "cannot take a component of '", path,
                    "': only single files of NRRD, MetaImage, NIfTI, MRC, VTI and TIFF have "
                    "several values per voxel, where they say so; leave the choice out");
}

void takeComponent(std::uint64_t components, const OpenOptions& options, StoredVoxels& stored,
                   VolumeInfo& info) {
  if (components == 1) return;
  stored.components = static_cast<std::size_t>(components);
  stored.magnitude = options.component->magnitude;
  if (!stored.magnitude) stored.component = static_cast<std::size_t>(options.component->index);
  info.voxel_type = stored.delivered();
  info.encoding = stored.magnitude ? "magnitude" : "component " + std::to_string(stored.component);
  info.notes.push_back(concat(stored.magnitude ? "the magnitude" : info.encoding, " of ",
                              components, " values per voxel was taken"));
}

}  // namespace isobrick
