#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "isobrick/viewer/render/gl_chunks.h"

namespace isobrick {
namespace {

TEST(FreeRunsTest, RunsNeverOverlapAndNothingIsLost) {
  std::mt19937 random(11);
  for (int round = 0; round < 200; ++round) {
    const std::size_t units = 1 + random() % 300;
    FreeRuns runs(units);
    std::vector<bool> taken(units, false);
    std::vector<std::pair<std::size_t, std::size_t>> held;
    for (int step = 0; step < 300; ++step) {
      if (held.empty() || random() % 2 == 0) {
        const std::size_t wanted = 1 + random() % 40;
        const auto begin = runs.take(wanted);
        // Refused only if no free run is as long.
        std::size_t longest = 0, run = 0;
        for (std::size_t i = 0; i < units; ++i)
          longest = std::max(longest, run = taken[i] ? 0 : run + 1);
        ASSERT_EQ(begin.has_value(), longest >= wanted);
        if (!begin) continue;
        for (std::size_t i = *begin; i < *begin + wanted; ++i) {
          ASSERT_LT(i, units);
          ASSERT_FALSE(taken[i]);
          taken[i] = true;
        }
        held.emplace_back(*begin, wanted);
      } else {
        const std::size_t which = random() % held.size();
        runs.give(held[which].first, held[which].second);
        for (std::size_t i = 0; i < held[which].second; ++i) taken[held[which].first + i] = false;
        held.erase(held.begin() + static_cast<std::ptrdiff_t>(which));
      }
      ASSERT_EQ(runs.freeUnits(),
                static_cast<std::size_t>(std::count(taken.begin(), taken.end(), false)));
    }
    for (const auto& [begin, length] : held) runs.give(begin, length);
    EXPECT_TRUE(runs.isAllFree());
    EXPECT_EQ(runs.take(units), std::size_t{0});
  }
}

}  // namespace
}  // namespace isobrick
