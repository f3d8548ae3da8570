// No two triangles of a cell cross (rule 11), and none has a side inside a face (rule 10), for all
// patterns and any places of the crossings on their edges: extreme and random ones, in exact
// arithmetic. Nothing here knows how the table chooses triangles.
#include "isobrick/extract/kernels/marching_cubes_table.h"

#include <gtest/gtest.h>

#include <bitset>
#include <map>
#include <set>
#include <vector>

#include "tests/support/crossing_triangles.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

constexpr std::int64_t kEdge = 4096;  // the places of crossings are whole numbers 1 .. 4095

std::vector<std::uint32_t> trianglesOf(const MarchingCubesCase& made) {
  return {made.edges.begin(), made.edges.begin() + 3 * made.triangle_count};
}

glm::dvec3 pointOn(int edge, std::int64_t place) {
  const CellEdge& on = kCellEdgeTable[static_cast<std::size_t>(edge)];
  glm::dvec3 point(on.x * kEdge, on.y * kEdge, on.z * kEdge);
  point[on.axis] = static_cast<double>(place);
  return point;
}

// Of all edges, near their ends or anywhere.
std::vector<glm::dvec3> randomPoints(Random& random) {
  std::vector<glm::dvec3> points;
  for (int edge = 0; edge < kCellEdges; ++edge) {
    const std::int64_t reach = randomInt(random, 0, 2) == 0 ? 8 : kEdge - 1;
    const std::int64_t place = randomInt(random, 1, reach);
    points.push_back(pointOn(edge, randomInt(random, 0, 1) == 0 ? place : kEdge - place));
  }
  return points;
}

TEST(MarchingCubesTable, NoTwoTrianglesOfACellCross) {
  Random random(1);
  for (std::size_t pattern = 0; pattern < 256; ++pattern) {
    const std::vector<std::uint32_t> triangles = trianglesOf(marchingCubesTable()[pattern]);
    const std::set<std::uint32_t> used(triangles.begin(), triangles.end());
    const auto check = [&](const std::vector<glm::dvec3>& points) {
      const auto pairs = crossingTriangles(points, triangles);
      ASSERT_TRUE(pairs.empty()) << "pattern " << std::bitset<8>(pattern) << ": triangles "
                                 << pairs[0][0] << " and " << pairs[0][1];
    };
    for (unsigned ends = 0; ends < 1u << used.size(); ++ends) {
      std::vector<glm::dvec3> points(kCellEdges);
      unsigned bit = 0;
      for (const std::uint32_t edge : used)
        points[edge] = pointOn(static_cast<int>(edge), (ends >> bit++ & 1) != 0 ? kEdge - 1 : 1);
      ASSERT_NO_FATAL_FAILURE(check(points));
    }
    for (int n = 0; n < 200; ++n) ASSERT_NO_FATAL_FAILURE(check(randomPoints(random)));
  }
}

TEST(MarchingCubesTable, NoSideBetweenTwoTrianglesLiesInAFace) {
  Random random(2);
  const std::vector<glm::dvec3> points = randomPoints(random);
  const auto shareFace = [&](std::uint32_t a, std::uint32_t b) {
    for (int axis = 0; axis < 3; ++axis)
      for (const std::int64_t side : {std::int64_t{0}, kEdge})
        if (points[a][axis] == static_cast<double>(side) && points[a][axis] == points[b][axis])
          return true;
    return false;
  };
  for (std::size_t pattern = 0; pattern < 256; ++pattern) {
    const std::vector<std::uint32_t> triangles = trianglesOf(marchingCubesTable()[pattern]);
    std::map<std::set<std::uint32_t>, int> uses;
    for (std::size_t i = 0; i < triangles.size(); ++i)
      ++uses[{triangles[i], triangles[i % 3 == 2 ? i - 2 : i + 1]}];
    for (const auto& [side, count] : uses)
      EXPECT_EQ(shareFace(*side.begin(), *side.rbegin()), count == 1)
          << "pattern " << std::bitset<8>(pattern);
  }
}

}  // namespace
}  // namespace isobrick::test
