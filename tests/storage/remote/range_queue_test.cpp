// Which ranges one request brings.
#include "isobrick/storage/remote/range_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

RangeQueue::Wanted wantedRange(std::uint64_t offset, std::uint64_t bytes, bool is_awaited = false) {
  auto wanted = std::make_shared<WantedRange>();
  wanted->range = {offset, bytes};
  wanted->is_awaited = is_awaited;
  return wanted;
}

std::vector<std::uint64_t> offsetsOf(const std::vector<RangeQueue::Wanted>& joined) {
  std::vector<std::uint64_t> offsets;
  for (const RangeQueue::Wanted& wanted : joined) offsets.push_back(wanted->range.offset);
  return offsets;
}
using Offsets = std::vector<std::uint64_t>;

TEST(RangeQueue, JoinsWhatLiesSideBySideInAnyOrder) {
  RangeQueue queue;
  for (const std::uint64_t offset : {3000u, 1000u, 2000u}) queue.push(wantedRange(offset, 1000));
  EXPECT_EQ(offsetsOf(queue.pop()), (Offsets{1000, 2000, 3000}));
  EXPECT_TRUE(queue.empty());
  EXPECT_TRUE(queue.pop().empty());
}

TEST(RangeQueue, ReadsOverAGapThatIsSmallBesideWhatIsWanted) {
  RangeQueue queue;
  queue.push(wantedRange(0, 100'000));
  queue.push(wantedRange(110'000, 100'000));
  EXPECT_EQ(offsetsOf(queue.pop()), (Offsets{0, 110'000}));
  queue.push(wantedRange(0, 10'000));
  queue.push(wantedRange(20'000, 10'000));
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{0}) << "a third of it would be for nobody";
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{20'000});
  queue.push(wantedRange(0, 500'000));
  queue.push(wantedRange(500'000 + RangeQueue::kMostGapBytes + 1, 400'000));
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{0}) << "a request is cheaper";
  EXPECT_EQ(queue.pop().size(), 1u);
  queue.push(wantedRange(0, 64));
  queue.push(wantedRange(64 + RangeQueue::kFreeGapBytes, 64));
  EXPECT_EQ(queue.pop().size(), 2u) << "the headers are longer";
}

TEST(RangeQueue, RequestsHaveABound) {
  RangeQueue queue;
  constexpr std::uint64_t kBytes = RangeQueue::kMostRequestBytes / 4;
  for (std::uint64_t i = 0; i < 10; ++i) queue.push(wantedRange(i * kBytes, kBytes));
  EXPECT_EQ(queue.pop().size(), 4u);
  EXPECT_EQ(queue.pop().size(), 4u);
  EXPECT_EQ(queue.pop().size(), 2u);
  queue.push(wantedRange(0, 10 * kBytes));
  EXPECT_EQ(queue.pop().size(), 1u) << "one that is longer comes all the same";
}

TEST(RangeQueue, WhatIsAwaitedGoesFirst) {
  RangeQueue queue;
  const auto announced = wantedRange(10'000'000, 10);
  queue.push(wantedRange(0, 10));
  queue.push(announced);
  queue.push(wantedRange(20'000'000, 10, true));
  queue.hurry(announced);
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{20'000'000});
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{10'000'000});
  EXPECT_EQ(offsetsOf(queue.pop()), Offsets{0});
}

TEST(RangeQueue, WhatWasRemovedDoesNotCome) {
  RangeQueue queue;
  const auto first = wantedRange(0, 10), second = wantedRange(0, 20);
  queue.push(first);
  queue.push(second);
  queue.remove(first);
  queue.remove(first);
  EXPECT_EQ(queue.pop(), std::vector{second});
  EXPECT_TRUE(queue.empty());
}

// Each range comes once, gaps stay within their bound, and none of what waits is left behind.
TEST(RangeQueue, RandomRangesComeOnceAndCheaply) {
  Random random(7);
  for (int round = 0; round < 200; ++round) {
    RangeQueue queue;
    std::vector<RangeQueue::Wanted> all;
    const auto count = randomInt(random, 1, 60);
    for (int i = 0; i < count; ++i) {
      const auto offset = static_cast<std::uint64_t>(randomInt(random, 0, 3'000'000));
      const auto bytes = static_cast<std::uint64_t>(randomInt(random, 1, 200'000));
      all.push_back(wantedRange(offset, bytes, randomInt(random, 0, 2) == 0));
      queue.push(all.back());
    }
    std::vector<RangeQueue::Wanted> came;
    while (!queue.empty()) {
      const auto joined = queue.pop();
      ASSERT_FALSE(joined.empty());
      std::uint64_t end = joined.front()->range.offset, gaps = 0, free_gaps = 0;
      for (const auto& wanted : joined) {
        const std::uint64_t gap = wanted->range.offset > end ? wanted->range.offset - end : 0;
        ASSERT_LE(gap, RangeQueue::kMostGapBytes);
        (gap <= RangeQueue::kFreeGapBytes ? free_gaps : gaps) += gap;
        end = std::max(end, wanted->end());
        came.push_back(wanted);
      }
      const std::uint64_t bytes = end - joined.front()->range.offset;
      ASSERT_TRUE(joined.size() == 1 || bytes <= RangeQueue::kMostRequestBytes);
      ASSERT_LE(gaps, bytes / 8);
    }
    std::sort(all.begin(), all.end());
    std::sort(came.begin(), came.end());
    EXPECT_EQ(came, all);
  }
}

}  // namespace
}  // namespace isobrick::test
