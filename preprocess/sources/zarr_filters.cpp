#include <algorithm>
#include <bit>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/zarr_array.h"

namespace isobrick {
namespace {

std::uint64_t wholeNumber(const std::byte* at, const StoredVoxels& type) {
  const std::size_t bytes = type.bytes();
  std::uint64_t value = loadUnsigned(at, bytes, type.big_endian);
  const bool is_signed = infoOf(type.type).name[0] == 'i';
  if (is_signed && bytes < 8 && (value >> (8 * bytes - 1) & 1) != 0)
    value -= std::uint64_t{1} << (8 * bytes);
  return value;
}

void storeWhole(std::uint64_t value, const StoredVoxels& type, std::byte* at) {
  const std::size_t bytes = type.bytes();
  for (std::size_t i = 0; i < bytes; ++i, value >>= 8)
    at[type.big_endian ? bytes - 1 - i : i] = static_cast<std::byte>(value & 0xff);
}

// Integers wrap around, as they did when they were written.
void addUpIntegers(const ZarrFilter& filter, std::span<const std::byte> packed, std::byte* out) {
  std::uint64_t sum = 0;
  for (std::size_t at = 0; at < packed.size();
       at += filter.packed.bytes(), out += filter.unpacked.bytes()) {
    sum += wholeNumber(packed.data() + at, filter.packed);
    storeWhole(sum, filter.unpacked, out);
  }
}

template <typename Float, typename Bits>
void addUpFloats(const ZarrFilter& filter, std::span<const std::byte> packed, std::byte* out) {
  Float sum = 0;
  for (std::size_t at = 0; at < packed.size(); at += sizeof(Float), out += sizeof(Float)) {
    sum += std::bit_cast<Float>(static_cast<Bits>(wholeNumber(packed.data() + at, filter.packed)));
    storeWhole(std::bit_cast<Bits>(sum), filter.unpacked, out);
  }
}

// Bytes of a last number that is not whole stay where they are.
void unshuffle(std::size_t number_bytes, std::span<const std::byte> packed, std::byte* out) {
  const std::size_t count = packed.size() / number_bytes, whole = count * number_bytes;
  for (std::size_t byte = 0; byte < number_bytes; ++byte)
    for (std::size_t i = 0; i < count; ++i) out[i * number_bytes + byte] = packed[byte * count + i];
  std::copy(packed.begin() + static_cast<std::ptrdiff_t>(whole), packed.end(), out + whole);
}

}  // namespace

void undoZarrFilter(const ZarrFilter& filter, std::span<const std::byte> packed, std::size_t bytes,
                    std::vector<std::byte>& out) {
  out.resize(bytes);
  if (filter.kind == ZarrFilter::Kind::kShuffle)
    unshuffle(filter.shuffled_bytes, packed, out.data());
  else if (filter.unpacked.type == StoredType::kFloat32)
    addUpFloats<float, std::uint32_t>(filter, packed, out.data());
  else if (filter.unpacked.type == StoredType::kFloat64)
    addUpFloats<double, std::uint64_t>(filter, packed, out.data());
  else
    addUpIntegers(filter, packed, out.data());
}

}  // namespace isobrick
