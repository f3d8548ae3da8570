// Packed parts: every element comes back, the bytes are always the same ones, whatever somebody
// puts into a file in their place is refused without harm, and the pager keeps unpacked parts
// within its budget.

#include <blosc.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_pager.h"
#include "isobrick/storage/checksum.h"
#include "tests/support/random_numbers.h"
#include "tests/support/refused_part.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using RawBytes = std::vector<std::byte>;
using format::Codec;

// Memory that ends where reading and writing ends: what goes past it is a crash in every build,
// also in libraries that no sanitizer has seen. A write before it shows in intact().
class GuardedBytes {
 public:
  explicit GuardedBytes(std::size_t bytes) : bytes_(bytes) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    const std::size_t body = (bytes + kBefore + page - 1) / page * page;
    map_bytes_ = body + page;
    void* map =
        mmap(nullptr, map_bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (map == MAP_FAILED) throw std::bad_alloc();
    map_ = static_cast<std::byte*>(map);
    mprotect(map_ + body, page, PROT_NONE);
    data_ = map_ + body - bytes;
    std::memset(data_ - kBefore, 0x5a, kBefore);
  }
  explicit GuardedBytes(const RawBytes& content) : GuardedBytes(content.size()) {
    if (!content.empty()) std::memcpy(data_, content.data(), content.size());
  }
  ~GuardedBytes() { munmap(map_, map_bytes_); }
  GuardedBytes(const GuardedBytes&) = delete;
  GuardedBytes& operator=(const GuardedBytes&) = delete;

  std::byte* data() const { return data_; }
  std::size_t size() const { return bytes_; }
  std::span<const std::byte> span() const { return {data_, bytes_}; }
  bool intact() const {
    for (std::size_t i = 1; i <= kBefore; ++i)
      if (*(data_ - i) != std::byte{0x5a}) return false;
    return true;
  }

 private:
  static constexpr std::size_t kBefore = 64;
  std::size_t bytes_, map_bytes_;
  std::byte* map_;
  std::byte* data_;
};

enum class Content { kConstant, kSmooth, kRuns, kNoise };
constexpr Content kContents[] = {Content::kConstant, Content::kSmooth, Content::kRuns,
                                 Content::kNoise};

template <typename T>
RawBytes valuesOf(Content content, std::size_t count, std::uint64_t seed) {
  Random random(seed);
  RawBytes bytes(count * sizeof(T));
  T* to = reinterpret_cast<T*>(bytes.data());
  const auto edge = static_cast<std::size_t>(std::cbrt(static_cast<double>(count))) + 1;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = static_cast<double>(i % edge), y = static_cast<double>(i / edge % edge);
    switch (content) {
      case Content::kConstant:
        to[i] = T{77};
        break;
      case Content::kSmooth:
        to[i] = static_cast<T>(60 + 30 * std::sin(0.1 * x) + 25 * std::cos(0.07 * y));
        break;
      case Content::kRuns:  // never constant
        to[i] = i < 2              ? static_cast<T>(i + 1)
                : random() % 4 > 0 ? to[i - 1]
                                   : static_cast<T>(random() & 7);
        break;
      case Content::kNoise: {
        const std::uint64_t bits = random();
        std::memcpy(&to[i], &bits, sizeof(T));  // of float: NaN and infinity too; only bytes matter
      }
    }
  }
  return bytes;
}

RawBytes valuesOf(VoxelType type, Content content, std::size_t count, std::uint64_t seed = 1) {
  return visitVoxelType(
      type, [&](auto tag) { return valuesOf<typename decltype(tag)::Type>(content, count, seed); });
}

// All three parts, the ranges and codes of about the same number as in a brick of such samples.
EncodedBrick brickOf(VoxelType type, Content content, std::size_t samples) {
  EncodedBrick brick;
  brick.samples.bytes = valuesOf(type, content, samples, 1);
  brick.ranges.bytes = valuesOf(type, content, 2 * (samples / 64 + 1), 2);
  brick.curvature.bytes = valuesOf(VoxelType::kUint8, content, 3 * (samples / 8 + 1), 3);
  return brick;
}

// One part of elements of `type`, packed by `codec` if that is possible.
EncodedPart packedSamples(VoxelType type, Codec codec, const RawBytes& elements) {
  EncodedBrick brick;
  brick.samples.bytes = elements;
  brick.ranges.bytes = RawBytes(2 * voxelBytes(type));
  encodeBrick(type, codec, brick);
  return brick.samples;
}

void expectDecodes(const EncodedPart& part, const RawBytes& elements, const std::string& what) {
  ASSERT_EQ(part.checksum, checksum64(part.bytes.data(), part.bytes.size())) << what;
  const GuardedBytes stored(part.bytes);
  const GuardedBytes out(elements.size());
  ASSERT_TRUE(decodePart(part.codec, stored.span(), out.size(), out.data())) << what;
  EXPECT_EQ(std::memcmp(out.data(), elements.data(), elements.size()), 0) << what;
  EXPECT_TRUE(out.intact()) << what;
}

void checkRoundTrip(VoxelType type, Codec codec, Content content, std::size_t samples,
                    EncodedBrick& brick) {
  const EncodedBrick before = brickOf(type, content, samples);
  brick.samples.bytes = before.samples.bytes;
  brick.ranges.bytes = before.ranges.bytes;
  brick.curvature.bytes = before.curvature.bytes;
  encodeBrick(type, codec, brick);
  const std::string what = std::string(voxelTypeName(type)) + ", " + std::to_string(samples) +
                           " samples, content " + std::to_string(static_cast<int>(content));
  if (content == Content::kConstant) {
    EXPECT_EQ(brick.samples.codec, Codec::kConstant) << what;
    EXPECT_EQ(brick.ranges.codec, Codec::kConstant) << what;
    EXPECT_EQ(brick.constant, 77.0f) << what;
  } else {
    expectDecodes(brick.samples, before.samples.bytes, what);
    expectDecodes(brick.ranges, before.ranges.bytes, what + ", ranges");
  }
  expectDecodes(brick.curvature, before.curvature.bytes, what + ", curvature");
  for (const auto* pair : {&brick.samples, &brick.ranges, &brick.curvature})
    if (pair->codec != Codec::kConstant) {
      EXPECT_TRUE(pair->codec == codec || pair->codec == Codec::kStored) << what;
    }
}

TEST(Codec, EveryElementComesBack) {
  for (const Codec codec : {Codec::kStored, Codec::kLz4, Codec::kZstd})
    for (int type = 0; type < 5; ++type) {
      EncodedBrick brick;  // used again for all sizes, as the builder does
      // One tile of 2^3 cells, odd sizes, a brick of 64^3 cells, small ones again.
      for (const std::size_t samples : {27, 1, 2, 125, 343, 1001, 4096, 67 * 67 * 67, 64, 1331})
        for (const Content content : kContents) {
          // A float sample that is a NaN has no meaning as a constant.
          if (samples == 1 && content != Content::kConstant) continue;
          checkRoundTrip(static_cast<VoxelType>(type), codec, content, samples, brick);
        }
    }
}

TEST(Codec, EveryElementOfTheGreatestBrickComesBack) {
  EncodedBrick brick;
  const std::size_t samples = 259 * 259 * 259;
  checkRoundTrip(VoxelType::kFloat32, Codec::kLz4, Content::kRuns, samples, brick);
  checkRoundTrip(VoxelType::kUint8, Codec::kZstd, Content::kRuns, samples, brick);
}

// Every difference of two bytes, and the wrap-around at both ends of every type.
TEST(Codec, EveryDifferenceComesBack) {
  RawBytes bytes;
  for (int a = 0; a < 256; ++a)
    for (int b = 0; b < 256; ++b) {
      bytes.push_back(static_cast<std::byte>(a));
      bytes.push_back(static_cast<std::byte>(b));
    }
  for (int type = 0; type < 5; ++type) {
    const EncodedPart part = packedSamples(static_cast<VoxelType>(type), Codec::kZstd, bytes);
    expectDecodes(part, bytes, std::string(voxelTypeName(static_cast<VoxelType>(type))));
  }
}

TEST(Codec, SmoothPartsArePackedAndNoiseIsStored) {
  for (const Codec codec : {Codec::kLz4, Codec::kZstd})
    for (int type = 0; type < 5; ++type) {
      EncodedBrick smooth = brickOf(static_cast<VoxelType>(type), Content::kSmooth, 35937);
      const std::size_t bytes = smooth.samples.bytes.size();
      encodeBrick(static_cast<VoxelType>(type), codec, smooth);
      EXPECT_EQ(smooth.samples.codec, codec);
      EXPECT_LT(smooth.samples.bytes.size(), bytes - bytes / 16);
      const EncodedBrick noise = brickOf(static_cast<VoxelType>(type), Content::kNoise, 35937);
      EncodedBrick encoded = noise;
      encodeBrick(static_cast<VoxelType>(type), codec, encoded);
      EXPECT_EQ(encoded.samples.codec, Codec::kStored);
      EXPECT_TRUE(encoded.samples.bytes == noise.samples.bytes);
      EXPECT_TRUE(encoded.ranges.bytes == noise.ranges.bytes);
      EXPECT_TRUE(encoded.curvature.bytes == noise.curvature.bytes);
    }
}

TEST(Codec, TheBytesDependOnTheElementsAlone) {
  for (const Codec codec : {Codec::kLz4, Codec::kZstd})
    for (int type = 0; type < 5; ++type) {
      const EncodedBrick elements =
          brickOf(static_cast<VoxelType>(type), Content::kRuns, 40 * 41 * 42);
      EncodedBrick first = elements;
      encodeBrick(static_cast<VoxelType>(type), codec, first);
      std::atomic<int> differ{0};
      std::vector<std::thread> threads;
      for (std::size_t t = 0; t < 3; ++t)
        threads.emplace_back([&, t] {
          EncodedBrick brick = elements;
          brick.scratch.assign(t * 100000, std::byte{0xee});
          encodeBrick(static_cast<VoxelType>(type), codec, brick);
          if (brick.samples.bytes != first.samples.bytes ||
              brick.ranges.bytes != first.ranges.bytes ||
              brick.curvature.bytes != first.curvature.bytes)
            ++differ;
        });
      for (std::thread& thread : threads) thread.join();
      EXPECT_EQ(differ, 0);
    }
}

// The 16 bytes that a Blosc buffer begins with are those of docs/FORMAT.md.
TEST(Codec, BloscHeadersAreThoseOfTheFormat) {
  for (const Codec codec : {Codec::kLz4, Codec::kZstd})
    for (int type = 0; type < 5; ++type) {
      EncodedBrick brick = brickOf(static_cast<VoxelType>(type), Content::kSmooth, 67 * 67 * 67);
      const std::size_t voxel = voxelBytes(static_cast<VoxelType>(type));
      const std::size_t bytes = brick.samples.bytes.size();
      encodeBrick(static_cast<VoxelType>(type), codec, brick);
      const auto byteOf = [](const EncodedPart& part, std::size_t at) {
        return static_cast<unsigned>(part.bytes[at]);
      };
      const auto numberOf = [](const EncodedPart& part, std::size_t at) {
        std::uint32_t number;
        std::memcpy(&number, part.bytes.data() + at, 4);
        return number;
      };
      for (const EncodedPart* part : {&brick.samples, &brick.ranges, &brick.curvature}) {
        ASSERT_EQ(part->codec, codec);
        EXPECT_EQ(byteOf(*part, 0), 2u);
        EXPECT_EQ(byteOf(*part, 1), 1u);
        EXPECT_EQ(byteOf(*part, 2) >> 5, codec == Codec::kLz4 ? 1u : 4u);
        EXPECT_EQ(byteOf(*part, 2) & 0x0eu, 0u);
        EXPECT_EQ(numberOf(*part, 12), part->bytes.size());
      }
      EXPECT_EQ(byteOf(brick.samples, 2) & 1, 1u);
      EXPECT_EQ(byteOf(brick.samples, 3), voxel);
      EXPECT_EQ(numberOf(brick.samples, 4), bytes);
      EXPECT_EQ(byteOf(brick.ranges, 2) & 1, 1u);
      EXPECT_EQ(byteOf(brick.ranges, 3), 2 * voxel);
      EXPECT_EQ(byteOf(brick.curvature, 2) & 1, 0u);
      EXPECT_EQ(byteOf(brick.curvature, 3), 1u);
    }
}

// ---- hostile bytes ----

// Some bytes that decodePart() must survive; true if it took them.
bool survives(Codec codec, const RawBytes& stored_bytes, std::size_t bytes) {
  const GuardedBytes stored(stored_bytes);
  const GuardedBytes out(bytes);
  const bool decoded = decodePart(codec, stored.span(), bytes, out.data());
  EXPECT_TRUE(out.intact());
  return decoded;
}

void putNumber(RawBytes& bytes, std::size_t at, std::uint32_t number) {
  std::memcpy(bytes.data() + at, &number, sizeof number);
}

// A packed part of several blocks, its codec and the bytes of its elements.
struct PackedExample {
  Codec codec;
  RawBytes stored;
  std::size_t bytes;
};

std::vector<PackedExample> packedExamples() {
  std::vector<PackedExample> examples;
  for (const Codec codec : {Codec::kLz4, Codec::kZstd})
    for (const auto& [type, content, count] : {std::tuple{VoxelType::kUint8, Content::kSmooth, 400},
                                               {VoxelType::kUint8, Content::kRuns, 300000},
                                               {VoxelType::kInt16, Content::kSmooth, 343},
                                               {VoxelType::kUint16, Content::kRuns, 150000},
                                               {VoxelType::kFloat32, Content::kSmooth, 1331}}) {
      const RawBytes elements = valuesOf(type, content, static_cast<std::size_t>(count));
      const EncodedPart part = packedSamples(type, codec, elements);
      EXPECT_EQ(part.codec, codec);
      examples.push_back({codec, part.bytes, elements.size()});
    }
  return examples;
}

TEST(HostilePart, EveryPrefixIsRefused) {
  for (const PackedExample& example : packedExamples())
    for (std::size_t length = 0; length < example.stored.size(); length += 1 + length / 50) {
      RawBytes prefix(example.stored.begin(),
                      example.stored.begin() + static_cast<std::ptrdiff_t>(length));
      ASSERT_FALSE(survives(example.codec, prefix, example.bytes)) << length;
      if (length < 16) continue;
      putNumber(prefix, 12, static_cast<std::uint32_t>(length));  // as if it were whole
      ASSERT_FALSE(survives(example.codec, prefix, example.bytes)) << length;
    }
}

TEST(HostilePart, OtherSizesAreRefused) {
  for (const PackedExample& example : packedExamples()) {
    ASSERT_TRUE(survives(example.codec, example.stored, example.bytes));
    for (const std::size_t bytes : {std::size_t{0}, std::size_t{1}, example.bytes / 2,
                                    example.bytes - 1, example.bytes + 1, 2 * example.bytes})
      EXPECT_FALSE(survives(example.codec, example.stored, bytes)) << bytes;
    RawBytes longer = example.stored;
    longer.push_back(std::byte{0});
    EXPECT_FALSE(survives(example.codec, longer, example.bytes));
    putNumber(longer, 12, static_cast<std::uint32_t>(longer.size()));
    EXPECT_FALSE(survives(example.codec, longer, example.bytes));
    // The same bytes under every other codec.
    for (const Codec other : {Codec::kStored, Codec::kConstant, Codec::kAbsent, Codec::kLz4,
                              Codec::kZstd, static_cast<Codec>(5), static_cast<Codec>(~0u)})
      if (other != example.codec) {
        EXPECT_FALSE(survives(other, example.stored, example.bytes));
      }
  }
}

// All 256 values of the first four bytes, and nasty sizes.
TEST(HostilePart, HeadersAreReadOnlyIfTheFormatHasThem) {
  for (const PackedExample& example : packedExamples()) {
    for (std::size_t at = 0; at < 4; ++at)
      for (int value = 0; value < 256; ++value) {
        RawBytes bytes = example.stored;
        if (bytes[at] == static_cast<std::byte>(value)) continue;
        bytes[at] = static_cast<std::byte>(value);
        const bool decoded = survives(example.codec, bytes, example.bytes);
        // Another shuffle or width of elements: sound bytes of something else.
        const bool may_decode =
            at == 3 || (at == 2 && ((value ^ static_cast<int>(example.stored[2])) & ~0x11) == 0);
        ASSERT_TRUE(may_decode || !decoded) << "byte " << at << " = " << value;
      }
    for (const std::size_t at : {4, 8, 12, 16, 20})
      for (const std::uint32_t number :
           {0u, 1u, 2u, 7u, 15u, 16u, 127u, 128u, 255u, 1u << 20, (1u << 20) + 8, 0x7fffffffu,
            0x80000000u, 0xfffffff0u, 0xffffffffu}) {
        RawBytes bytes = example.stored;
        if (at + 4 > bytes.size()) continue;
        putNumber(bytes, at, number);
        if (bytes != example.stored) {
          ASSERT_FALSE(survives(example.codec, bytes, example.bytes)) << at << " = " << number;
        }
      }
  }
}

TEST(HostilePart, WhatOtherBloscSettingsMakeIsRefused) {
  const RawBytes elements = valuesOf(VoxelType::kUint16, Content::kRuns, 50000);
  RawBytes packed(elements.size() + BLOSC_MAX_OVERHEAD);
  const auto pack = [&](int level, int shuffle, const char* compressor, std::size_t width = 2) {
    const int size = blosc_compress_ctx(level, shuffle, width, elements.size(), elements.data(),
                                        packed.data(), packed.size(), compressor, 0, 1);
    return RawBytes(packed.begin(), packed.begin() + std::max(size, 0));
  };
  for (const Codec codec : {Codec::kLz4, Codec::kZstd}) {
    const char* own = codec == Codec::kLz4 ? BLOSC_LZ4_COMPNAME : BLOSC_ZSTD_COMPNAME;
    for (const char* compressor :
         {BLOSC_BLOSCLZ_COMPNAME, BLOSC_SNAPPY_COMPNAME, BLOSC_ZLIB_COMPNAME,
          codec == Codec::kLz4 ? BLOSC_ZSTD_COMPNAME : BLOSC_LZ4_COMPNAME}) {
      EXPECT_FALSE(survives(codec, pack(5, BLOSC_SHUFFLE, compressor), elements.size()));
      // Somebody may change the name as well.
      RawBytes renamed = pack(5, BLOSC_SHUFFLE, compressor);
      if (renamed.empty()) continue;  // Blosc was made without it
      renamed[2] = static_cast<std::byte>((static_cast<int>(renamed[2]) & 0x1f) |
                                          (codec == Codec::kLz4 ? 0x20 : 0x80));
      EXPECT_FALSE(survives(codec, renamed, elements.size()));
    }
    EXPECT_FALSE(survives(codec, pack(5, BLOSC_BITSHUFFLE, own), elements.size()));
    EXPECT_FALSE(survives(codec, pack(0, BLOSC_SHUFFLE, own), elements.size())) << "a plain copy";
    EXPECT_FALSE(survives(codec, pack(5, BLOSC_SHUFFLE, own, 3), elements.size()));
    // Any level and block size will do, and no shuffle.
    EXPECT_TRUE(survives(codec, pack(9, BLOSC_SHUFFLE, own), elements.size()));
    EXPECT_TRUE(survives(codec, pack(1, BLOSC_NOSHUFFLE, own), elements.size()));
  }
}

// Blosc takes twice a block's bytes from the heap. (It makes no blocks of LZ4 that are so long.)
TEST(HostilePart, LongBlocksAreRefused) {
  constexpr std::size_t kMostBlockBytes = 1 << 20;
  const RawBytes elements = valuesOf(VoxelType::kUint16, Content::kRuns, 1 << 22);
  RawBytes packed(elements.size() + BLOSC_MAX_OVERHEAD);
  int taken = 0, refused = 0;
  for (std::size_t bytes = kMostBlockBytes / 8; bytes <= 4 * kMostBlockBytes; bytes *= 2) {
    const int size =
        blosc_compress_ctx(1, BLOSC_SHUFFLE, 2, elements.size(), elements.data(), packed.data(),
                           packed.size(), BLOSC_ZSTD_COMPNAME, bytes, 1);
    ASSERT_GT(size, 0);
    std::uint32_t block_bytes;
    std::memcpy(&block_bytes, packed.data() + 8, 4);
    const RawBytes stored(packed.begin(), packed.begin() + size);
    const bool is_short = block_bytes <= kMostBlockBytes;
    ++(is_short ? taken : refused);
    EXPECT_EQ(survives(Codec::kZstd, stored, elements.size()), is_short) << block_bytes;
  }
  EXPECT_GT(taken, 0);
  EXPECT_GT(refused, 0);
}

// Blosc would take the same block twice, or one that lies in the header: so a small file could keep
// a reader busy for hours.
TEST(HostilePart, BlocksInAnotherOrderAreRefused) {
  for (const PackedExample& example : packedExamples()) {
    if (example.bytes < 300000) continue;
    std::uint32_t first, second;
    std::memcpy(&first, example.stored.data() + 16, 4);
    std::memcpy(&second, example.stored.data() + 20, 4);
    RawBytes bytes = example.stored;
    putNumber(bytes, 20, first);
    EXPECT_FALSE(survives(example.codec, bytes, example.bytes));
    putNumber(bytes, 16, second);
    EXPECT_FALSE(survives(example.codec, bytes, example.bytes));
    bytes = example.stored;
    putNumber(bytes, 16, 16);
    EXPECT_FALSE(survives(example.codec, bytes, example.bytes));
  }
}

// A brief fuzzer: flips, random runs, copied runs, numbers put where Blosc has its own.
RawBytes mutated(Random& random, const PackedExample& example) {
  RawBytes bytes = example.stored;
  for (std::uint64_t edits = 1 + randomBelow(random, 4); edits > 0; --edits) {
    // Half of them where the offsets and sizes are.
    const std::uint64_t reach =
        randomBelow(random, 2) == 0 ? std::min<std::uint64_t>(bytes.size(), 64) : bytes.size();
    const std::size_t at = randomBelow(random, reach);
    switch (randomBelow(random, 4)) {
      case 0:
        bytes[at] ^= static_cast<std::byte>(1 << randomBelow(random, 8));
        break;
      case 1:
        bytes[at] = static_cast<std::byte>(random());
        break;
      case 2:
        for (std::size_t i = at; i < bytes.size() && i < at + 12; ++i)
          bytes[i] = bytes[randomBelow(random, bytes.size())];
        break;
      default:
        if (at + 4 <= bytes.size())
          putNumber(bytes, at, static_cast<std::uint32_t>(random() >> randomBelow(random, 64)));
    }
  }
  return bytes;
}

TEST(HostilePart, MutatedPartsDoNoHarm) {
  Random random(31);
  int decoded = 0;
  for (const PackedExample& example : packedExamples())
    for (int round = 0; round < (example.bytes > 100000 ? 300 : 3000); ++round)
      decoded += survives(example.codec, mutated(random, example), example.bytes) ? 1 : 0;
  // Some edits change literals only; then other elements come out, and the checksum is what tells.
  EXPECT_GT(decoded, 100);
}

// ---- the pager ----

struct PackedFile {
  std::string path;
  std::vector<BrickPager::Part> parts;
  std::vector<RawBytes> elements;
};

// Every third part is stored, the others are packed; a few sizes.
PackedFile makePackedFile(const TemporaryFolder& folder, std::size_t count) {
  PackedFile result;
  result.path = folder.file("packed");
  RawBytes all(64);
  for (std::size_t i = 0; i < count; ++i) {
    const RawBytes elements = valuesOf(VoxelType::kUint16, Content::kRuns, 20000 - 50 * (i % 7), i);
    const Codec codec = i % 3 == 0 ? Codec::kStored : i % 3 == 1 ? Codec::kLz4 : Codec::kZstd;
    const EncodedPart part = packedSamples(VoxelType::kUint16, codec, elements);
    EXPECT_EQ(part.codec, codec);
    all.resize((all.size() + 63) / 64 * 64);
    const auto unpacked = static_cast<std::uint32_t>(codec == Codec::kStored ? 0 : elements.size());
    result.parts.push_back({all.size(), part.bytes.size(), part.checksum, unpacked, part.codec});
    all.insert(all.end(), part.bytes.begin(), part.bytes.end());
    result.elements.push_back(elements);
  }
  FILE* file = std::fopen(result.path.c_str(), "wb");
  if (file == nullptr || std::fwrite(all.data(), 1, all.size(), file) != all.size() ||
      std::fclose(file) != 0)
    throw std::runtime_error("cannot write " + result.path);
  return result;
}

bool holdsElements(const PackedFile& made, std::size_t id, const std::byte* data) {
  return data != nullptr &&
         std::memcmp(data, made.elements[id].data(), made.elements[id].size()) == 0;
}

TEST(PackedPager, KeepsTheBudget) {
  const TemporaryFolder folder;
  const PackedFile made = makePackedFile(folder, 60);
  const PagedFile file(made.path);
  const std::uint64_t budget = 400000;
  BrickPager pager(file, made.parts, budget);
  std::uint64_t file_bytes = 0, unpacked = 0;
  for (std::size_t i = 0; i < made.parts.size(); ++i) {
    const std::byte* data = pager.acquire(i);
    ASSERT_TRUE(holdsElements(made, i, data)) << i;
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(data) % 64, 0u);
    EXPECT_LE(pager.heldBytes(), budget);
    pager.release(i);
    file_bytes += made.parts[i].bytes;
    unpacked += made.parts[i].unpacked_bytes;
  }
  const BrickPager::Counters counters = pager.counters();
  EXPECT_EQ(counters.parts_read, made.parts.size());
  EXPECT_EQ(counters.bytes_read, file_bytes);
  EXPECT_EQ(counters.bytes_unpacked, unpacked);
  EXPECT_EQ(counters.buffers_beside, 0u);
  // The last ones are still there.
  EXPECT_TRUE(holdsElements(made, 59, pager.acquire(59)));
  EXPECT_EQ(pager.counters().parts_read, made.parts.size());
  pager.release(59);
}

TEST(PackedPager, ABudgetSmallerThanAPartStillWorks) {
  const TemporaryFolder folder;
  const PackedFile made = makePackedFile(folder, 12);
  const PagedFile file(made.path);
  for (const std::uint64_t budget : {0, 1000}) {
    BrickPager pager(file, made.parts, budget);
    for (std::size_t i = 0; i + 1 < made.parts.size(); ++i) {
      // Two at once, one of them twice.
      const std::byte* first = pager.acquire(i);
      const std::byte* second = pager.acquire(i + 1);
      EXPECT_EQ(pager.acquire(i), first);
      pager.release(i);
      EXPECT_TRUE(holdsElements(made, i, first) && holdsElements(made, i + 1, second));
      pager.release(i);
      EXPECT_TRUE(holdsElements(made, i + 1, second));
      pager.release(i + 1);
      EXPECT_EQ(pager.heldBytes(), 0u);
    }
  }
}

TEST(PackedPager, BytesThatCannotBeUnpackedAreDamage) {
  const TemporaryFolder folder;
  PackedFile made = makePackedFile(folder, 6);
  const PagedFile file(made.path);
  // The checksum is right, the size is not.
  made.parts[1].unpacked_bytes -= 2;
  made.parts[2].codec = Codec::kLz4;
  made.parts[4].checksum ^= 1;
  BrickPager pager(file, made.parts, 1 << 20);
  for (int round = 0; round < 2; ++round)
    for (const std::size_t id : {1, 2, 4}) {
      const std::string why = whyRefused(pager, id);
      EXPECT_NE(why.find(id == 4 ? "checksum" : "unpacked"), std::string::npos) << why;
    }
  EXPECT_EQ(pager.heldBytes(), 0u);
  EXPECT_EQ(pager.counters().parts_read, 0u);
  EXPECT_TRUE(holdsElements(made, 5, pager.acquire(5)));
  pager.release(5);
}

}  // namespace
}  // namespace isobrick::test
