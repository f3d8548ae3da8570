// Crossings of queued edges against their scalar twin, bit by bit, on every instruction set of the
// machine; and contours on halved faces against those on plain ones.
#include "isobrick/extract/kernels/edge_crossings.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <map>
#include <vector>

#include "isobrick/extract/kernels/contour.h"
#include "tests/support/every_target.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

GridGeometry geometryOf(bool is_oblique) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 1.0, 2.5};
  if (is_oblique) geometry.direction = glm::dmat3(0.8, 0.6, 0, -0.6, 0.8, 0, 0, 0, -1);
  return geometry;
}

TEST(EdgeCrossings, AreThoseOfTheScalarTwin) {
  onEveryTarget([] {
    Random random(11);
    for (int round = 0; round < 200; ++round) {
      const WorldFrame frame(geometryOf(round % 2 == 1), {0.0f, 1000.0f});
      const float isovalue = 0.25f * static_cast<float>(randomInt(random, 0, 4000));
      EdgeQueue queue;
      std::vector<CrossedEdge> edges;
      std::vector<EdgeEnd> low, high;
      std::vector<CrossingBounds> bounds;
      const auto count = static_cast<std::size_t>(randomInt(random, 0, EdgeQueue::kMost));
      for (std::size_t i = 0; i < count; ++i) {
        const auto endOf = [&](bool is_inside) {
          const float beyond = 0.25f * static_cast<float>(randomInt(random, 0, 2000));
          EdgeEnd end{is_inside ? isovalue + beyond : isovalue - 0.25f - beyond, {}};
          // One in four has no gradient, and a few values are not finite.
          if (randomInt(random, 0, 3) > 0)
            for (int axis = 0; axis < 3; ++axis)
              end.gradient[axis] = 0.5f * static_cast<float>(randomInt(random, -500, 500));
          if (randomInt(random, 0, 40) == 0) end.value = std::numeric_limits<float>::infinity();
          return end;
        };
        const bool is_inside = randomInt(random, 0, 1) == 1;
        CrossedEdge edge{static_cast<std::uint32_t>(count - 1 - i),
                         static_cast<int>(randomInt(random, 0, 2)),
                         {},
                         0};
        for (int axis = 0; axis < 3; ++axis)
          edge.begin[axis] = static_cast<float>(randomInt(random, -256, 256));
        edge.end = edge.begin[edge.axis] + static_cast<float>(1 << randomInt(random, 0, 8));
        edges.push_back(edge);
        low.push_back(endOf(is_inside));
        high.push_back(endOf(!is_inside));
        queue.edges[i] = edge;
        const double middle =
            randomInt(random, 0, 1) == 1 ? 0.5 : 0.1 * static_cast<double>(randomInt(random, 1, 9));
        bounds.push_back(boundsBeside(middle, randomInt(random, 0, 1) == 1));
        queue.low[i] = low.back();
        queue.least[i] = bounds.back().least;
        queue.most[i] = bounds.back().most;
        queue.high[i] = high.back();
      }
      queue.count = count;
      std::vector<glm::vec3> positions(count), normals(count);
      queue.make(frame, isovalue, positions.data(), normals.data());
      EXPECT_EQ(queue.count, 0u);
      for (std::size_t i = 0; i < count; ++i) {
        const EdgeCrossing made =
            makeEdgeCrossing(frame, isovalue, edges[i], low[i], high[i], bounds[i]);
        const std::size_t at = edges[i].vertex;
        ASSERT_EQ(std::memcmp(&positions[at], &made.position, sizeof made.position), 0) << i;
        ASSERT_EQ(std::memcmp(&normals[at], &made.normal, sizeof made.normal), 0) << i;
      }
    }
  });
}

// Every point on a side of the face begins or ends pieces as often as its edge is crossed, and
// every point inside is passed through.
TEST(FaceContours, OfHalvedFacesAreJoined) {
  for (int side = 0; side < 2; ++side)
    for (const FaceParts& parts : {FaceParts{2, 2}, {1, 2}, {2, 1}, {1, 1}})
      for (unsigned bits = 0; bits < 512; ++bits) {
        const FaceContour contour = makeHalvedFace(side, bits, parts);
        if (parts.b == 2 && parts.c == 2) {
          const FaceContour& tabled = halvedFace(side, bits);
          ASSERT_EQ(tabled.size, contour.size);
          for (std::size_t n = 0; n < contour.size; ++n) {
            EXPECT_EQ(tabled.pieces[n].from, contour.pieces[n].from);
            EXPECT_EQ(tabled.pieces[n].to, contour.pieces[n].to);
          }
        }
        std::map<int, int> from, to;
        for (std::size_t n = 0; n < contour.size; ++n) {
          ++from[contour.pieces[n].from];
          ++to[contour.pieces[n].to];
        }
        const auto isInside = [&](int i, int j) { return (bits >> (3 * j + i) & 1) != 0; };
        const auto check = [&](int edge, bool is_crossed, bool is_inner) {
          EXPECT_EQ(from[edge] + to[edge], !is_crossed ? 0 : is_inner ? 2 : 1);
          if (is_inner) {
            EXPECT_EQ(from[edge], to[edge]);
          }
        };
        for (int j = 0; j <= parts.c; ++j)
          for (int i = 0; i < parts.b; ++i)
            check(2 * (j == parts.c ? 2 : j) + i, isInside(i, j) != isInside(i + 1, j),
                  j > 0 && j < parts.c);
        for (int i = 0; i <= parts.b; ++i)
          for (int j = 0; j < parts.c; ++j)
            check(6 + 2 * (i == parts.b ? 2 : i) + j, isInside(i, j) != isInside(i, j + 1),
                  i > 0 && i < parts.b);
      }
}

}  // namespace
}  // namespace isobrick::test
