// What a corner table says of random triangles, against a search through all of them.
#include "isobrick/extract/simplify/corner_table.h"

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"

namespace isobrick::test {
namespace {

using IndexTriple = std::array<std::uint32_t, 3>;

// Few vertices, so that sides meet in all ways; or most of a closed surface.
std::vector<IndexTriple> randomTriangles(Random& random, std::uint32_t vertices) {
  std::vector<IndexTriple> triangles;
  if (randomBelow(random, 2) == 0) {
    // A double pyramid over a ring, of which some triangles are left out or are there twice.
    for (std::uint32_t i = 2; i < vertices; ++i) {
      const std::uint32_t next = i + 1 == vertices ? 2 : i + 1;
      for (const IndexTriple& t : {IndexTriple{0, i, next}, IndexTriple{1, next, i}})
        for (std::uint64_t copies = 1 + (randomBelow(random, 30) == 0 ? 1u : 0u) -
                                    (randomBelow(random, 10) == 0 ? 1u : 0u);
             copies > 0; --copies)
          triangles.push_back(t);
    }
    return triangles;
  }
  for (std::uint64_t i = 1 + randomBelow(random, 12); i > 0; --i) {
    IndexTriple t{};
    do
      for (std::uint32_t& v : t) v = static_cast<std::uint32_t>(randomBelow(random, vertices));
    while (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]);
    triangles.push_back(t);
  }
  return triangles;
}

TEST(CornerTable, SaysOfRandomTrianglesWhatASearchFinds) {
  Random random(8);
  int closed = 0, open = 0, broken = 0;
  for (int n = repetitions(3000); n > 0; --n) {
    const auto vertices = static_cast<std::uint32_t>(5 + randomBelow(random, 6));
    const std::vector<IndexTriple> triangles = randomTriangles(random, vertices);
    if (triangles.empty()) continue;
    std::vector<std::uint32_t> corners;
    for (const IndexTriple& t : triangles) corners.insert(corners.end(), t.begin(), t.end());
    CornerTable table;
    table.set(corners, vertices);
    // By both ends: corners that face the side from one to the other.
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> sides;
    for (std::uint32_t t = 0; t < triangles.size(); ++t)
      for (std::uint32_t c = 4 * t; c < 4 * t + 3; ++c)
        sides[{table.vertex(CornerTable::next(c)), table.vertex(CornerTable::previous(c))}]
            .push_back(c);
    const auto facing = [&](std::uint32_t from, std::uint32_t to) {
      const auto found = sides.find({from, to});
      return found == sides.end() ? std::vector<std::uint32_t>() : found->second;
    };
    for (const auto& [side, of] : sides) {
      const auto back = facing(side.second, side.first);
      for (const std::uint32_t c : of)
        ASSERT_EQ(table.opposite(c),
                  of.size() == 1 && back.size() == 1 ? back[0] : CornerTable::kNone);
    }
    for (std::uint32_t v = 0; v < vertices; ++v) {
      const auto around = table.cornersOf(v);
      if (around.empty()) continue;
      bool is_broken = false;
      for (const auto& [side, of] : sides)
        is_broken = is_broken || ((side.first == v || side.second == v) && of.size() > 1);
      // All triangles that a walk to both sides comes to.
      std::size_t seen = 1;
      std::uint32_t at = table.left(around[0]);
      for (; at != CornerTable::kNone && at != around[0]; at = table.left(at)) ++seen;
      const bool is_closed = at == around[0];
      if (!is_closed)
        for (at = table.right(around[0]); at != CornerTable::kNone; at = table.right(at)) ++seen;
      is_broken = is_broken || seen != around.size();
      ASSERT_EQ(table.ring(v), is_broken   ? CornerTable::Ring::kBroken
                               : is_closed ? CornerTable::Ring::kClosed
                                           : CornerTable::Ring::kOpen);
      ++(is_broken ? broken : is_closed ? closed : open);
    }
  }
  EXPECT_GT(closed, 100);
  EXPECT_GT(open, 100);
  EXPECT_GT(broken, 100);
}

}  // namespace
}  // namespace isobrick::test
