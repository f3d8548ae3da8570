// Rows of bits, one for each cell along x, in words of 64.
#pragma once

#include <bit>
#include <cstdint>

namespace isobrick {

inline std::int64_t wordsOf(std::int64_t bits) { return (bits + 63) / 64; }

// How many bits are set. std::popcount() is a function call in a build for every processor.
constexpr std::uint32_t bitCount(std::uint64_t x) {
  x -= x >> 1 & 0x5555555555555555ull;
  x = (x & 0x3333333333333333ull) + (x >> 2 & 0x3333333333333333ull);
  x = (x + (x >> 4)) & 0x0F0F0F0F0F0F0F0Full;
  return static_cast<std::uint32_t>(x * 0x0101010101010101ull >> 56);
}

// The lowest `count` bits, 0 .. 64.
inline std::uint64_t lowBits(std::int64_t count) {
  return count >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1;
}

// How many bits below bit `bit` are set.
inline std::uint32_t bitsBelow(const std::uint64_t* bits, std::int64_t bit) {
  std::uint32_t count = bitCount(bits[bit / 64] & lowBits(bit % 64));
  for (std::int64_t word = 0; word < bit / 64; ++word) count += bitCount(bits[word]);
  return count;
}

// The bits of word `word` that lie in [begin, end).
inline std::uint64_t bitsBetween(std::int64_t begin, std::int64_t end, std::int64_t word) {
  const std::int64_t low = begin - 64 * word, high = end - 64 * word;
  return (high > 0 ? lowBits(high) : 0) & ~(low > 0 ? lowBits(low) : 0);
}

// Sets bits [0, count) and clears the rest of the last word.
inline void setBits(std::uint64_t* bits, std::int64_t count) {
  for (std::int64_t word = 0; word < wordsOf(count); ++word)
    bits[word] = bitsBetween(0, count, word);
}

// Clears the bits of [0, count) that do not lie in [begin, end).
inline void keepBits(std::uint64_t* bits, std::int64_t count, std::int64_t begin,
                     std::int64_t end) {
  for (std::int64_t word = 0; word < wordsOf(count); ++word)
    bits[word] &= bitsBetween(begin, end, word);
}

// Keeps the set bits of `words` words for which `f(number of the bit)` is true.
template <typename F>
void keepBitsWhere(std::uint64_t* bits, std::int64_t words, F&& f) {
  for (std::int64_t word = 0; word < words; ++word)
    for (std::uint64_t left = bits[word]; left != 0; left &= left - 1)
      if (!f(64 * word + std::countr_zero(left))) bits[word] &= ~(left & -left);
}

inline bool hasBitsBetween(const std::uint64_t* bits, std::int64_t begin, std::int64_t end) {
  for (std::int64_t word = begin / 64; 64 * word < end; ++word)
    if ((bits[word] & bitsBetween(begin, end, word)) != 0) return true;
  return false;
}

// Bit i of the low half becomes bits 2i and 2i + 1.
inline std::uint64_t doubled(std::uint64_t half) {
  std::uint64_t x = half & 0xFFFFFFFFull;
  x = (x | x << 16) & 0x0000FFFF0000FFFFull;
  x = (x | x << 8) & 0x00FF00FF00FF00FFull;
  x = (x | x << 4) & 0x0F0F0F0F0F0F0F0Full;
  x = (x | x << 2) & 0x3333333333333333ull;
  x = (x | x << 1) & 0x5555555555555555ull;
  return x | x << 1;
}

// Every one of `parents` bits stands for two; bits [skip, skip + count) of these go to `out`, whose
// last word is filled with zeros. `skip`: 0 or 1.
inline void doubleBits(const std::uint64_t* parent_bits, std::int64_t parents, std::int64_t skip,
                       std::int64_t count, std::uint64_t* out) {
  const auto doubledWord = [&](std::int64_t word) {
    if (32 * word >= parents) return std::uint64_t{0};
    return doubled(parent_bits[word / 2] >> 32 * (word % 2));
  };
  std::uint64_t here = doubledWord(0);
  for (std::int64_t word = 0; word < wordsOf(count); ++word) {
    const std::uint64_t next = doubledWord(word + 1);
    out[word] = (skip == 0 ? here : here >> 1 | next << 63) & bitsBetween(0, count, word);
    here = next;
  }
}

}  // namespace isobrick
