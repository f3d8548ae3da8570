// The reads of a sweep over isovalues, if the budget is half of its parts.
#include <gtest/gtest.h>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/isovalue_sweep.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// The optimum knows the parts to come. Parts that settled in the file's order were read once.
TEST(IsovalueSweep, ReadsLittleMoreThanTheOptimumAtHalfTheWorkingSet) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 16;
  options.codec = format::Codec::kStored;
  buildPyramid(*makePhantomSource(PhantomSpec{"head", 160, {}, 16}), folder.file("head.isb"),
               options);
  const IsovalueSweep sweep{300, 2200};
  const TakeTrace trace = traceOf(folder.file("head.isb"), sweep);
  const std::uint64_t budget = workingSetBytes(trace) / 2;
  const auto optimum = static_cast<double>(bytesReadByBelady(trace, budget));
  const auto read = static_cast<double>(bytesReadByPager(folder.file("head.isb"), trace, budget));
  EXPECT_LE(read, 1.3 * optimum);
  // The sweep is one that a queue of the least recently used is bad at.
  const auto lru = static_cast<double>(bytesReadByLru(trace, budget));
  EXPECT_GT(lru, 1.5 * optimum);
  EXPECT_LE(static_cast<double>(bytesReadByQueries(folder.file("head.isb"), sweep, budget)),
            1.3 * optimum);
  EXPECT_NEAR(read, static_cast<double>(bytesReadByPolicy(trace, budget)), 0.02 * optimum);
}

// A cycle is the worst of all for a queue of the least recently used.
TEST(ResidencePolicy, OfACycleMostOfTheBudgetStays) {
  TakeTrace trace(10);
  for (auto& query : trace)
    for (std::uint64_t id = 0; id < 1000; ++id) query.push_back({id, 100});
  const std::uint64_t budget = 50000;
  EXPECT_EQ(bytesReadByLru(trace, budget), 10u * 100000);
  EXPECT_LE(bytesReadByBelady(trace, budget), 100000u + 9 * 50500);
  EXPECT_LE(bytesReadByPolicy(trace, budget), 100000u + 9 * (50000 + 50000 / 16 + 200));
}

// A part that queries took long ago leaves, though it was taken often.
TEST(ResidencePolicy, WhatQueriesLeaveBehindGoesFirst) {
  TakeTrace trace(12);
  for (std::size_t query = 0; query < trace.size(); ++query)
    for (std::uint64_t id = 0; id < 100; ++id)
      trace[query].push_back({id + (query < 6 ? 0 : 1000), 100});
  EXPECT_LE(bytesReadByPolicy(trace, 12000), 3u * 10000);
}

// A part that is taken twice within a query stays that long.
TEST(ResidencePolicy, ArrivalsStayForAWhile) {
  TakeTrace trace(5);
  for (auto& query : trace)
    for (std::uint64_t id = 0; id < 1000; ++id) {
      query.push_back({id, 100});
      if (id > 0) query.push_back({id - 1, 100});
    }
  const std::uint64_t budget = 50000;
  EXPECT_LE(bytesReadByPolicy(trace, budget), 100000u + 4 * (50000 + 2 * 50000 / 16));
}

}  // namespace
}  // namespace isobrick::test
