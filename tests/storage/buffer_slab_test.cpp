// Buffers out of one range of memory.
#include "isobrick/storage/buffer_slab.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <fstream>
#include <map>
#include <thread>
#include <vector>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_pager.h"
#include "isobrick/storage/checksum.h"
#include "tests/support/child_process.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/asan_interface.h>
#endif

namespace isobrick::test {
namespace {

constexpr std::uint64_t kHugePage = BufferSlab::kHugePageBytes;

// Bytes of a buffer whose run has just so many, a power of two, with what AddressSanitizer adds.
constexpr std::uint64_t fits(std::uint64_t run_bytes) { return run_bytes - 64; }

// Sizes as parts have them: many of nearly the same size, some small ones, few large ones.
std::uint64_t randomBytes(Random& random) {
  switch (randomBelow(random, 4)) {
    case 0:
      return 1 + randomBelow(random, 20000);
    case 1:
      return 1 + randomBelow(random, kHugePage);
    default:
      return 600000 - 10000 * randomBelow(random, 3);
  }
}

TEST(BufferSlab, RunsAreLittleLongerThanTheirBuffers) {
  Random random(1);
  for (int round = 0; round < 1000; ++round) {
    const std::uint64_t bytes = 1 + randomBelow(random, std::uint64_t{1} << (1 + round % 40));
    const std::uint64_t run = BufferSlab::runBytes(bytes);
    EXPECT_EQ(run % 64, 0u);
    EXPECT_GE(run, bytes);
    EXPECT_LE(run, bytes + bytes / 32 + 128);
  }
}

// Beside a model that knows just which bytes are taken: no two buffers share any, and a buffer is
// refused only if no gap between the others is long enough.
TEST(BufferSlab, RandomBuffersNeitherOverlapNorAreRefusedWhereThereIsRoom) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Random random(seed);
    const std::uint64_t slab_bytes = kHugePage * (1 + randomBelow(random, 8));
    BufferSlab slab(slab_bytes - randomBelow(random, kHugePage));
    std::map<const std::byte*, std::uint64_t> taken;  // to the end of each run
    const std::byte* base = nullptr;
    int refused = 0;
    for (int round = 0; round < 3000; ++round) {
      if (randomBelow(random, 100) < 45 && !taken.empty()) {
        const auto out = std::next(taken.begin(),
                                   static_cast<std::ptrdiff_t>(randomBelow(random, taken.size())));
        slab.giveBack(out->first);
        taken.erase(out);
        continue;
      }
      const std::uint64_t bytes = randomBytes(random);
      const std::uint64_t run = BufferSlab::runBytes(bytes);
      std::byte* const buffer = slab.take(bytes);
      if (base == nullptr) base = buffer;  // the slab is empty: its begin
      if (buffer == nullptr) {
        ++refused;
        const std::byte* end = base;
        for (const auto& [begin, length] : taken) {
          ASSERT_LT(static_cast<std::uint64_t>(begin - end), run);
          end = begin + length;
        }
        ASSERT_LT(static_cast<std::uint64_t>(base + slab_bytes - end), run);
        continue;
      }
      ASSERT_EQ(reinterpret_cast<std::uintptr_t>(buffer) % 64, 0u);
      ASSERT_GE(buffer, base);
      ASSERT_LE(buffer + run, base + slab_bytes);
      const auto [here, is_new] = taken.emplace(buffer, run);
      ASSERT_TRUE(is_new);
      if (here != taken.begin()) {
        ASSERT_LE(std::prev(here)->first + std::prev(here)->second, buffer);
      }
      if (std::next(here) != taken.end()) {
        ASSERT_LE(buffer + run, std::next(here)->first);
      }
      buffer[0] = buffer[bytes - 1] = std::byte{1};
    }
    EXPECT_GT(refused, 0);
    for (const auto& [begin, length] : taken) slab.giveBack(begin);
    // All of it is one run again.
    const std::uint64_t most = slab_bytes - slab_bytes / 16;
    std::byte* const all = slab.take(most);
    EXPECT_EQ(all, base);
    slab.giveBack(all);
  }
}

// The buffer that went last of its size is where the next one of nearly that size goes.
TEST(BufferSlab, AHoleServesTheNextOfItsSize) {
  BufferSlab slab(8 * kHugePage);
  std::vector<std::byte*> buffers;
  for (int n = 0; n < 10; ++n) buffers.push_back(slab.take(600000));
  slab.giveBack(buffers[3]);
  slab.giveBack(buffers[6]);
  EXPECT_EQ(slab.take(595000), buffers[3]);
  EXPECT_EQ(slab.take(600000), buffers[6]);
}

std::uint64_t residentBytes() {
  std::uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> pages;
  return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

TEST(BufferSlab, WhatIsIdleGoesBackToTheSystem) {
  BufferSlab slab(64 * kHugePage);
  std::vector<std::byte*> buffers;
  for (int n = 0; n < 60; ++n) {
    buffers.push_back(slab.take(fits(kHugePage)));
    std::memset(buffers.back(), n, fits(kHugePage));
  }
  EXPECT_EQ(slab.idleBytes(), 0u);
  const std::uint64_t full = residentBytes();
  for (std::size_t n = 0; n < 60; n += n % 10 == 8 ? 2 : 1) slab.giveBack(buffers[n]);
  EXPECT_EQ(slab.idleBytes(), 54 * kHugePage);
  slab.trim(20 * kHugePage);
  EXPECT_LE(slab.idleBytes(), 34 * kHugePage);
  EXPECT_GE(slab.idleBytes(), 33 * kHugePage);
  slab.trim(~std::uint64_t{0});
  EXPECT_EQ(slab.idleBytes(), 0u);
#if !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)  // they hold memory of their own
  EXPECT_LE(residentBytes(), full - 50 * kHugePage);
#endif
  // Runs that were taken are as they were, and the others can be taken again.
  for (std::size_t n = 9; n < 60; n += 10)
    for (std::uint64_t at = 0; at < fits(kHugePage); at += 4096)
      ASSERT_EQ(buffers[n][at], static_cast<std::byte>(n));
  EXPECT_LT(residentBytes(), full + kHugePage);
  std::byte* const again = slab.take(20 * kHugePage / 3);
  ASSERT_NE(again, nullptr);
  std::memset(again, 1, 20 * kHugePage / 3);
}

// Counted as touched, and given back, in pieces of a huge page if a run has no whole one.
TEST(BufferSlab, ShortRunsGoBackInPieces) {
  BufferSlab slab(4 * kHugePage);
  slab.giveBack(slab.take(1000));
  EXPECT_EQ(slab.idleBytes(), kHugePage) << "the first touch brings all of it";
  std::vector<std::byte*> buffers;
  for (int n = 0; n < 8; ++n) buffers.push_back(slab.take(fits(kHugePage / 2)));
  for (std::size_t n = 0; n < 8; n += 2) slab.giveBack(buffers[n]);
  EXPECT_EQ(slab.idleBytes(), 2 * kHugePage);
  slab.trim(kHugePage / 2);
  EXPECT_EQ(slab.idleBytes(), 2 * kHugePage - kHugePage / 2);
  slab.trim(10 * kHugePage);
  EXPECT_EQ(slab.idleBytes(), 0u);
  std::byte* const again = slab.take(fits(kHugePage / 4));
  EXPECT_EQ(slab.idleBytes(), 0u);
  slab.giveBack(again);
  EXPECT_EQ(slab.idleBytes(), kHugePage / 4);
}

TEST(BufferSlab, ThreadsGetBuffersOfTheirOwn) {
  BufferSlab slab(16 * kHugePage);
  std::vector<std::thread> threads;
  std::atomic<int> wrong{0}, had{0};
  for (std::uint64_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      std::vector<std::pair<std::byte*, std::uint64_t>> mine;
      const auto give = [&](std::size_t which) {
        const auto [buffer, bytes] = mine[which];
        if (buffer[0] != std::byte(t) || buffer[bytes / 2] != std::byte(t) ||
            buffer[bytes - 1] != std::byte(t))
          ++wrong;
        slab.giveBack(buffer);
        mine[which] = mine.back();
        mine.pop_back();
      };
      for (int round = 0; round < 4000; ++round) {
        if (mine.size() > 12) give(randomBelow(random, mine.size()));
        if (round % 64 == 0) slab.trim(kHugePage);
        const std::uint64_t bytes = randomBytes(random);
        std::byte* const buffer = slab.take(bytes);
        if (buffer == nullptr) continue;
        ++had;
        buffer[0] = buffer[bytes / 2] = buffer[bytes - 1] = std::byte(t);
        mine.emplace_back(buffer, bytes);
      }
      while (!mine.empty()) give(0);
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(had, 1000);
}

#if defined(__SANITIZE_ADDRESS__)
TEST(BufferSlab, WhatIsNotTakenMayNotBeTouched) {
  BufferSlab slab(4 * kHugePage);
  std::byte* const buffer = slab.take(1000);
  EXPECT_EQ(__asan_region_is_poisoned(buffer, 1000), nullptr);
  EXPECT_TRUE(__asan_address_is_poisoned(buffer + 1000));
  slab.giveBack(buffer);
  EXPECT_EQ(__asan_region_is_poisoned(buffer, 1000), buffer);
}
#endif

TEST(BufferSlab, NoBudgetIsNoSlab) {
  BufferSlab slab(0);
  EXPECT_EQ(slab.bytes(), 0u);
  EXPECT_EQ(slab.take(1), nullptr);
  slab.trim(1);
  EXPECT_EQ(slab.idleBytes(), 0u);
}

// Any number will do as a budget.
// Sanitizers hold memory and addresses of their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

// Addresses count nowhere; what counts is opened as buffers need it.
TEST(BufferSlab, CountsAsUsedOnlyAsFarAsBuffersReach) {
  expectChildLeavesWith(0, [] {
    BufferSlab slab(std::uint64_t{1} << 36);
    rlimit limit{};
    getrlimit(RLIMIT_DATA, &limit);
    limit.rlim_cur = rlim_t{4} << 30;
    if (setrlimit(RLIMIT_DATA, &limit) != 0) return 2;
    std::byte* const buffer = slab.take(100'000'000);
    if (buffer == nullptr) return 3;
    buffer[0] = buffer[99'999'999] = std::byte{1};
    // More than the system promises: from elsewhere, and what is there stays good.
    if (slab.take(std::uint64_t{1} << 35) != nullptr) return 4;
    slab.giveBack(buffer);
    return slab.take(100'000'000) == buffer ? 0 : 5;
  });
}

#endif

TEST(BufferSlab, ABudgetBeyondAllAddressesIsCapped) {
  BufferSlab slab(~std::uint64_t{0});
  EXPECT_EQ(slab.bytes(), BufferSlab::kMostBytes);
  std::byte* const buffer = slab.take(1000);
  if (buffer == nullptr) {  // no addresses
    EXPECT_EQ(slab.bytes(), 0u);
  } else {
    std::memset(buffer, 1, 1000);
    EXPECT_LE(slab.idleBytes(), kHugePage);
  }
}

// ---- the pager's use of it ----

struct PlainParts {
  std::string path;
  std::vector<BrickPager::Part> parts;
};

PlainParts makeParts(const TemporaryFolder& folder, std::size_t count,
                     const std::vector<std::uint64_t>& sizes) {
  PlainParts result{folder.file("parts"), {}};
  std::string all;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t offset = (all.size() + 4095) / 4096 * 4096;
    const std::uint64_t bytes = sizes[i % sizes.size()];
    all.resize(offset);
    all.append(bytes, static_cast<char>(1 + i % 100));
    result.parts.push_back({offset, bytes, checksum64(all.data() + offset, bytes), 0, {}});
  }
  writeBytes(result.path, all);
  return result;
}

bool holdsPart(const PlainParts& made, std::size_t id, const std::byte* data) {
  return data != nullptr && data[0] == static_cast<std::byte>(1 + id % 100) &&
         data[made.parts[id].bytes - 1] == data[0];
}

// Sizes that leave gaps: if none is long enough more parts go, and none of the heap is wanted.
TEST(PagerSlab, GapsThatAreTooShortAreMadeLonger) {
  const TemporaryFolder folder;
  const PlainParts made = makeParts(folder, 60, {300000, 40000, 700000, 1000, 500000});
  const PagedFile file(made.path, FileAccess::kRead);
  const std::uint64_t budget = 3 * kHugePage;
  BrickPager pager(file, made.parts, budget);
  Random random(5);
  for (int round = 0; round < 1000; ++round) {
    const std::size_t id = randomBelow(random, made.parts.size());
    ASSERT_TRUE(holdsPart(made, id, pager.acquire(id)));
    pager.release(id);
    ASSERT_LE(pager.heldBytes(), budget);
  }
  EXPECT_EQ(pager.counters().buffers_beside, 0u);
  EXPECT_GT(pager.counters().parts_released, 100u);
  // Little of the budget is lost to gaps.
  EXPECT_GT(pager.heldBytes(), budget / 2);
}

// Buffers in use do not go: others that have no room beside them are of the heap.
TEST(PagerSlab, WhatIsInUseMayExceedTheSlab) {
  const TemporaryFolder folder;
  const PlainParts made = makeParts(folder, 12, {700000});
  const PagedFile file(made.path, FileAccess::kRead);
  BrickPager pager(file, made.parts, kHugePage);
  for (int round = 0; round < 2; ++round) {
    std::vector<const std::byte*> held;
    for (std::size_t id = 0; id < made.parts.size(); ++id) held.push_back(pager.acquire(id));
    for (std::size_t id = 0; id < made.parts.size(); ++id) {
      EXPECT_TRUE(holdsPart(made, id, held[id]));
      pager.release(id);
    }
    EXPECT_LE(pager.heldBytes(), kHugePage);
    EXPECT_GT(pager.counters().buffers_beside, 8u);
  }
}

// Parts longer than the whole slab push nobody out for nothing.
TEST(PagerSlab, APartLongerThanTheSlabIsOfTheHeap) {
  const TemporaryFolder folder;
  const PlainParts made = makeParts(folder, 2, {5 * kHugePage});
  const PagedFile file(made.path, FileAccess::kRead);
  BrickPager pager(file, made.parts, kHugePage);
  for (const std::size_t id : {0, 1}) {
    EXPECT_TRUE(holdsPart(made, id, pager.acquire(id)));
    pager.release(id);
    EXPECT_EQ(pager.heldBytes(), 0u);
  }
}

// Sanitizers hold memory and addresses of their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

// If there are no addresses for a slab, all is as before but for the huge pages.
TEST(PagerSlab, WithoutAddressesTheHeapServes) {
  const TemporaryFolder folder;
  const PlainParts made = makeParts(folder, 4, {300000});
  expectChildLeavesWith(0, [&] {
    const PagedFile file(made.path, FileAccess::kRead);
    BrickPager pager(file, made.parts, std::uint64_t{1} << 36);
    const rlimit limit{std::uint64_t{1} << 35, std::uint64_t{1} << 35};
    if (setrlimit(RLIMIT_AS, &limit) != 0) return 2;
    int good = 0;
    for (std::size_t id = 0; id < made.parts.size(); ++id) {
      good += holdsPart(made, id, pager.acquire(id));
      pager.release(id);
    }
    return good == 4 && pager.counters().buffers_beside == 4 ? 0 : 3;
  });
}

// The slab gives back as much as parts in place take.
TEST(PagerSlab, PartsInPlaceAndBuffersShareTheBudget) {
  constexpr std::size_t kOfEach = 60;
  const TemporaryFolder folder;
  PlainParts made = makeParts(folder, 2 * kOfEach, {600000});
  std::string all = readBytes(made.path);
  for (std::size_t id = 0; id < kOfEach; ++id) {
    EncodedBrick brick;
    brick.samples.bytes.assign(600000, static_cast<std::byte>(1 + id % 100));
    brick.samples.bytes[300000] = std::byte{0};
    brick.ranges.bytes.resize(4);
    encodeBrick(VoxelType::kUint16, format::Codec::kLz4, brick);
    const EncodedPart& packed = brick.samples;
    ASSERT_EQ(packed.codec, format::Codec::kLz4);
    const std::uint64_t offset = (all.size() + 63) / 64 * 64;
    all.resize(offset);
    all.append(reinterpret_cast<const char*>(packed.bytes.data()), packed.bytes.size());
    made.parts[id] = {offset, packed.bytes.size(), packed.checksum, 600000, packed.codec};
  }
  writeBytes(made.path, all);
  const PagedFile file(made.path);
  const std::uint64_t budget = 12 * kHugePage;
  BrickPager pager(file, made.parts, budget);
  const auto take = [&](std::size_t id) {
    const std::byte* const data = pager.acquire(id);
    ASSERT_NE(data, nullptr);
    EXPECT_EQ(data[0], static_cast<std::byte>(1 + id % 100));
    pager.release(id);
  };
  const std::uint64_t before = residentBytes();
  for (std::size_t id = 0; id < kOfEach; ++id) take(id);
  EXPECT_GT(residentBytes(), before + budget / 2);
  for (int round = 0; round < 2; ++round)
    for (std::size_t id = 0; id < 2 * kOfEach; ++id) {
      take(id % 2 * kOfEach + id / 2);
      ASSERT_LE(residentBytes(), before + budget + 3 * kHugePage) << round << ", " << id;
    }
}
#endif

}  // namespace
}  // namespace isobrick::test
