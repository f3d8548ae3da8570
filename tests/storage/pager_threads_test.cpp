// Several threads ask one pager for parts, stored and packed.
#include <gtest/gtest.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <barrier>
#include <chrono>
#include <cstring>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_pager.h"
#include "tests/support/child_process.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"
#include "tests/support/refused_part.h"
#include "tests/support/temporary_folder.h"
#include "tools/bench/page_cache.h"

namespace isobrick::test {
namespace {

using format::Codec;

struct PagerLoad {
  const char* name;
  std::vector<Codec> codecs;  // of the parts, in turn
  std::size_t part_count;
  std::size_t part_bytes;  // unpacked
  std::uint64_t budget_bytes;
  int rounds;
  FileAccess access = FileAccess::kMap;
};

void PrintTo(const PagerLoad& load, std::ostream* out) { *out << load.name; }

// A file with parts of runs of values, each at a page of its own.
class PagerThreads : public testing::TestWithParam<PagerLoad> {
 protected:
  void SetUp() override {
    std::string all;
    Random random(1);
    for (std::size_t i = 0; i < GetParam().part_count; ++i) {
      std::vector<std::byte> elements;
      while (elements.size() < GetParam().part_bytes)
        elements.insert(elements.end(), 2 * (1 + randomBelow(random, 40)),
                        static_cast<std::byte>(random()));
      elements.resize(GetParam().part_bytes);
      EncodedBrick brick;
      brick.samples.bytes = elements;
      brick.ranges.bytes.resize(4);
      const Codec codec = GetParam().codecs[i % GetParam().codecs.size()];
      encodeBrick(VoxelType::kUint16, codec, brick);
      ASSERT_EQ(brick.samples.codec, codec);
      all.resize((all.size() + 4095) / 4096 * 4096);
      const bool is_stored = codec == Codec::kStored;
      parts_.push_back({all.size(), brick.samples.bytes.size(), brick.samples.checksum,
                        is_stored ? 0 : static_cast<std::uint32_t>(elements.size()), codec});
      all.append(reinterpret_cast<const char*>(brick.samples.bytes.data()),
                 brick.samples.bytes.size());
      elements_.push_back(std::move(elements));
    }
    writeBytes(path_, all);
  }
  bool holdsElements(std::size_t id, const std::byte* data) const {
    return data != nullptr && std::memcmp(data, elements_[id].data(), elements_[id].size()) == 0;
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.file("parts");
  std::vector<BrickPager::Part> parts_;
  std::vector<std::vector<std::byte>> elements_;
};

TEST_P(PagerThreads, EachGetsWhatItAsksForWithinTheBudget) {
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, GetParam().budget_bytes);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      for (int round = 0; round < GetParam().rounds; ++round) {
        std::size_t held[3];
        for (std::size_t& id : held) {
          // Half the time the same few parts, so that threads meet.
          id = randomBelow(random, random() % 2 == 0 ? 4 : parts_.size());
          if (!holdsElements(id, pager.acquire(id))) ++wrong;
        }
        for (const std::size_t id : held) pager.release(id);
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_LE(pager.heldBytes(), GetParam().budget_bytes);
  const BrickPager::Counters counters = pager.counters();
  EXPECT_GT(counters.parts_released, 0u);
  if (GetParam().codecs == std::vector{Codec::kStored}) {
    // Equal parts: what stays is known to the byte.
    const std::uint64_t resident = counters.parts_read - counters.parts_released;
    EXPECT_LE(resident * GetParam().part_bytes, GetParam().budget_bytes);
    EXPECT_EQ(counters.bytes_read, counters.parts_read * GetParam().part_bytes);
    EXPECT_EQ(counters.bytes_unpacked, 0u);
  } else {
    EXPECT_GT(counters.bytes_unpacked, 0u);
  }
}

// Bytes that this process has asked files for, /proc aside.
std::uint64_t bytesAskedFor() {
  std::ifstream io("/proc/self/io");
  std::string name;
  std::uint64_t value = 0;
  io >> name >> value;
  return value;
}

// The bytes that are asked of the file tell how often a packed part is read and unpacked.
TEST_P(PagerThreads, APartIsLoadedOnceForAllWhoWantIt) {
  if (GetParam().codecs == std::vector{Codec::kStored}) return;  // nothing is unpacked
  constexpr int kThreads = 4;
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, 0);
  std::barrier all(kThreads);
  std::atomic<int> wrong{0};
  const std::uint64_t before = bytesAskedFor();
  const std::uint64_t measuring = bytesAskedFor() - before;
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t)
    threads.emplace_back([&] {
      for (std::size_t round = 0; round < 100; ++round) {
        const std::size_t id = 3 * (round % (parts_.size() / 3)) + 1;
        all.arrive_and_wait();
        if (!holdsElements(id, pager.acquire(id))) ++wrong;
        all.arrive_and_wait();
        pager.release(id);
      }
    });
  for (std::thread& thread : threads) thread.join();
  const std::uint64_t asked = bytesAskedFor() - before - 2 * measuring;
  EXPECT_EQ(wrong, 0);
  const BrickPager::Counters counters = pager.counters();
  EXPECT_EQ(counters.parts_read, 100u);
  EXPECT_LE(asked, counters.bytes_read + 4096);
  EXPECT_EQ(counters.misses, 100u);
  EXPECT_EQ(counters.hits + counters.loads_joined, 100u * (kThreads - 1));
  EXPECT_GT(counters.wait_nanoseconds, 0u);
}

// Damage is told to all who wait for the part, and nobody is left waiting.
TEST_P(PagerThreads, AllWhoWaitHearOfDamage) {
  std::vector<BrickPager::Part> damaged = parts_;
  damaged[1].checksum ^= 1;
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, damaged, 1 << 20);
  std::barrier all(4);
  std::atomic<int> told{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int round = 0; round < 20; ++round) {
        all.arrive_and_wait();
        if (whyRefused(pager, 1).find("checksum") != std::string::npos) ++told;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(told, 4 * 20);
  EXPECT_EQ(pager.heldBytes(), 0u);
  EXPECT_EQ(pager.counters().parts_read, 0u);
}

// A fetched part stays for its query, and the next may want it; one that was taken back goes first.
// Some file systems keep all in memory; there nothing is to be seen but that nothing is counted.
TEST_P(PagerThreads, WhatIsAnnouncedIsReadByTheSystemAndCountsNowhere) {
  dropFromPageCache(path_);
  const bool is_cold = cachedShare(path_) == 0;
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, GetParam().budget_bytes);
  for (std::size_t id = 0; id < parts_.size(); ++id) pager.announce({&id, 1});
  const BrickPager::Counters counters = pager.counters();
  EXPECT_EQ(counters.hits + counters.misses + counters.parts_read + counters.parts_fetched, 0u);
  EXPECT_EQ(pager.heldBytes(), 0u);
  for (int n = 0; is_cold && n < 10000 && cachedShare(path_) < 0.9; ++n)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_GE(cachedShare(path_), 0.9);
  EXPECT_TRUE(holdsElements(0, pager.acquire(0)));
  const std::size_t resident = 0;
  pager.announce({&resident, 1});
  pager.release(0);
}

TEST_P(PagerThreads, WhatIsWithdrawnMakesRoom) {
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, GetParam().budget_bytes);
  const auto take = [&](std::size_t id) {
    EXPECT_TRUE(holdsElements(id, pager.acquire(id)));
    pager.release(id);
  };
  pager.beginQuery();
  pager.fetch(0);
  pager.fetch(1);
  for (std::size_t id = 2; id < parts_.size(); ++id) take(id);
  EXPECT_EQ(pager.counters().fetched_unused, 0u);
  pager.withdraw(1);
  pager.withdraw(2);  // never fetched
  pager.beginQuery();
  for (std::size_t id = 2; id < parts_.size(); ++id) take(id);
  EXPECT_EQ(pager.counters().fetched_unused, 1u);
  const std::uint64_t misses = pager.missCount();
  take(0);
  EXPECT_EQ(pager.missCount(), misses);
  EXPECT_LE(pager.heldBytes(), GetParam().budget_bytes);
}

// Threads that reserve and fetch at once never push out what a query since took, and never have
// more than the budget together; what nobody took since goes for them.
TEST_P(PagerThreads, WhatIsFetchedIntoRoomPushesNothingOutThatIsUsed) {
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, GetParam().budget_bytes);
  const std::uint64_t old_query = pager.beginQuery();
  for (std::size_t id = 0; id < parts_.size(); ++id) pager.fetch(id);  // more than the budget
  const std::uint64_t since = pager.beginQuery();
  EXPECT_GT(since, old_query);
  std::vector<std::size_t> taken;
  for (std::size_t id = 0; id < 3; ++id)
    if (pager.acquire(id) != nullptr) taken.push_back(id);
  for (const std::size_t id : taken) pager.release(id);
  std::atomic<std::uint64_t> most{0}, came{0}, refused{0};
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      for (int round = 0; round < GetParam().rounds; ++round) {
        const std::size_t ids[] = {randomBelow(random, parts_.size()),
                                   randomBelow(random, parts_.size())};
        const auto room = pager.reserve(ids, since);
        if (!room) ++refused;
        if (!room) continue;
        for (const std::size_t id : ids)
          if (pager.fetch(id, nullptr, room) == BrickPager::Fetched::kNow) ++came;
        std::uint64_t seen = most;
        const std::uint64_t held = pager.heldBytes();
        while (seen < held && !most.compare_exchange_weak(seen, held)) {
        }
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_GT(came, 0u);
  EXPECT_GT(refused, 0u);
  EXPECT_LE(most, GetParam().budget_bytes);
  // All that came in is there still, and so is what the query took.
  const std::uint64_t misses = pager.missCount();
  for (const std::size_t id : taken) {
    EXPECT_TRUE(holdsElements(id, pager.acquire(id)));
    pager.release(id);
  }
  EXPECT_EQ(pager.missCount(), misses);
  const BrickPager::Counters counters = pager.counters();
  std::uint64_t resident = 0;
  for (std::size_t id = 0; id < parts_.size(); ++id)
    if (pager.acquireIfResident(id) != nullptr) {
      ++resident;
      pager.release(id);
    }
  EXPECT_EQ(resident, counters.parts_read - counters.parts_released);
  EXPECT_GE(resident, came + taken.size());
}

// Room that is set aside counts until it goes; a part that does not fit is refused, but not to who
// needs it.
TEST_P(PagerThreads, APartWithoutRoomIsRefusedAndComesInForWhoNeedsIt) {
  const PagedFile file(path_, GetParam().access);
  const std::uint64_t cost = BrickPager(file, parts_, 0).costOf(parts_[0]);
  BrickPager pager(file, parts_, cost + cost / 2);
  const std::uint64_t since = pager.beginQuery();
  const std::size_t first[] = {0};
  const std::size_t second[] = {3};  // stored as well
  {
    const auto room = pager.reserve(first, since);
    ASSERT_TRUE(room);
    EXPECT_EQ(pager.heldBytes(), cost);
    EXPECT_FALSE(pager.reserve(second, since));
    EXPECT_EQ(pager.fetch(3, nullptr, room),
              BrickPager::Fetched::kNow);  // in the room of the other
    EXPECT_EQ(pager.fetch(0, nullptr, room), BrickPager::Fetched::kNoRoom);
    EXPECT_EQ(pager.fetch(3, nullptr, room), BrickPager::Fetched::kBefore);
    EXPECT_EQ(pager.heldBytes(), cost);
  }
  EXPECT_EQ(pager.heldBytes(), cost);
  EXPECT_EQ(pager.counters().parts_released, 0u);
  EXPECT_TRUE(holdsElements(0, pager.acquire(0)));
  pager.release(0);
  EXPECT_EQ(pager.counters().parts_released, 1u);
  // Another query that asks for another surface may push out what this one took.
  const auto room = pager.reserve(second, pager.beginQuery());
  ASSERT_TRUE(room);
  EXPECT_EQ(pager.fetch(3, nullptr, room), BrickPager::Fetched::kNow);
  EXPECT_EQ(pager.counters().parts_released, 2u);
}

// The kernel ends a child that makes any call but read, write and exit.
TEST_P(PagerThreads, AHitMakesNoSystemCall) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "ThreadSanitizer makes calls of its own";
#endif
  const PagedFile file(path_, GetParam().access);
  BrickPager pager(file, parts_, 1 << 20);
  const auto hit = [&](std::size_t id) {
    const bool is_there = pager.acquire(id) != nullptr;
    if (is_there) pager.release(id);
    return is_there;
  };
  if (!hit(0) || !hit(1)) FAIL();
  const int status = statusOfChild([&] {
    if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_STRICT) != 0) return 2;
    int hits = 0;
    for (int round = 0; round < 100; ++round) hits += hit(0) + hit(1);
    syscall(SYS_exit, hits == 200 ? 0 : 3);
    return 4;
  });
  ASSERT_TRUE(WIFEXITED(status)) << "killed by signal " << WTERMSIG(status);
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

INSTANTIATE_TEST_SUITE_P(
    All, PagerThreads,
    testing::Values(
        PagerLoad{"Stored", {Codec::kStored}, 64, 8192, 6 * 8192, 4000},
        PagerLoad{"Packed", {Codec::kStored, Codec::kLz4, Codec::kZstd}, 40, 20000, 300000, 600},
        PagerLoad{"Read",
                  {Codec::kStored, Codec::kLz4, Codec::kZstd},
                  40,
                  20000,
                  300000,
                  600,
                  FileAccess::kRead}),
    [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace isobrick::test
