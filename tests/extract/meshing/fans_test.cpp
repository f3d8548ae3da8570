// The fans of cells beside finer ones, in exact arithmetic: random values at the corners of a cell,
// and any faces of it finer.
#include "isobrick/extract/meshing/fans.h"

#include <gtest/gtest.h>

#include <map>
#include <tuple>
#include <vector>

#include "isobrick/extract/meshing/transition_face.h"
#include "tests/support/crossing_triangles.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

// Cell 0 of level 1, two voxels wide, and its triangles.
class CellFans {
 public:
  explicit CellFans(Random& random) : lattice_(Index3(5)) {
    // Anything, values near the isovalue, and few ones.
    const std::int64_t kind = randomInt(random, 0, 3);
    for (float& value : values_) {
      value = static_cast<float>(randomReal(random, -1, 1));
      if (kind == 1) value = static_cast<float>(randomInt(random, -3, 2)) + 0.5F;
      if (kind == 2 && randomInt(random, 0, 1) == 0) value *= 1e-3F;
      if (kind == 3 && randomInt(random, 0, 1) == 0) value *= 1e-4F;
    }
    batch_.level = 1;
    meshLoops(static_cast<unsigned>(randomInt(random, 1, 63)));
  }

  std::size_t fans() const { return fans_.loops(); }
  const auto& triangles() const { return batch_.triangles; }
  // Those of fans that know nothing of each other.
  std::vector<glm::dvec3> lonelyPositions() const {
    return {lonely_.positions.begin(), lonely_.positions.end()};
  }
  const auto& lonelyTriangles() const { return lonely_.triangles; }
  std::vector<glm::dvec3> positions() const {
    return {batch_.positions.begin(), batch_.positions.end()};
  }

 private:
  void meshLoops(unsigned finer) {
    constexpr float kIsovalue = 0;
    unsigned pattern = 0;
    for (unsigned corner = 0; corner < 8; ++corner)
      pattern |= static_cast<unsigned>(values_[corner] >= kIsovalue) << corner;
    const auto numberOf = [&](int edge) {
      const CellEdge& e = kCellEdgeTable[static_cast<std::size_t>(edge)];
      return vertexOn(e.axis, Index3(2) * Index3(e.x, e.y, e.z), 2, values_[e.low],
                      values_[e.high]);
    };
    const auto makeVertex = [&](int axis, const LatticePoint& low, const LatticePoint& high) {
      return vertexOn(axis, low.sample, 1, low.value, high.value);
    };
    Contour contour;
    for (int face = 0; face < 6; ++face) {
      const unsigned mask = faceCorners(face), inside = pattern & mask;
      if (inside == 0 || inside == mask) continue;
      if ((finer >> face & 1) != 0) {
        addTransitionFace(makeTransitionFace(lattice_, 1, Index3(0), face, values_), kIsovalue,
                          numberOf, makeVertex, contour);
        continue;
      }
      const FaceContour& pieces = plainFace(face, pattern);
      for (std::size_t n = 0; n < pieces.size; ++n) {
        const auto [from, to] = pieces.pieces[n];
        for (const std::uint8_t point : {from, to})
          if (!contour.isKnown(point)) contour.setNumber(point, numberOf(point));
        contour.add(from, to, face);
      }
    }
    const WorldFrame frame{GridGeometry()};
    lonely_ = batch_;
    EXPECT_TRUE(forEachLoop(contour, [&](const ContourLoop& loop) {
      fans_.add(loop);
      if (const auto hub = hubOf(loop))
        addFan(frame, loop, *hub, lonely_);
      else
        addCenteredFan(frame, glm::dvec3(1), loop, lonely_);
    }));
    if (fans_.loops() > 1)
      fans_.append(frame, glm::dvec3(0), glm::dvec3(1), batch_);
    else
      batch_ = lonely_;
  }
  std::uint32_t vertexOn(int axis, const Index3& low, int length, float at_low, float at_high) {
    const auto [found, is_new] =
        vertices_.try_emplace(std::tuple(axis, low.x, low.y, low.z), batch_.positions.size());
    if (is_new) {
      glm::vec3 at(low);
      const float t = crossingParameter(0, at_low, at_high);
      at[axis] =
          crossingCoordinate(at[axis] + static_cast<float>(length), static_cast<float>(length), t);
      batch_.positions.push_back(at);
      batch_.normals.emplace_back(0, 0, 1);
    }
    return found->second;
  }

  Lattice lattice_;
  float values_[8];
  MeshBatch batch_, lonely_;
  std::map<std::tuple<int, std::int64_t, std::int64_t, std::int64_t>, std::uint32_t> vertices_;
  SeveralFans fans_;
};

// Seen from its centre, or its hub, no two points of a loop on a convex cell are in one direction.
// Fans that know nothing of each other cross in 2 of 1,000 cells of several loops.
TEST(TransitionFans, NoTwoTrianglesOfACellCross) {
  Random random(1);
  std::size_t fans = 0, several = 0, lonely_crossed = 0;
  for (int n = 0; n < 40'000; ++n) {
    const CellFans cell(random);
    fans += cell.fans();
    ASSERT_TRUE(crossingTriangles(cell.positions(), cell.triangles()).empty()) << "cell " << n;
    if (cell.fans() < 2) continue;
    ++several;
    if (crossingTriangles(cell.lonelyPositions(), cell.lonelyTriangles()).empty())
      ASSERT_EQ(cell.triangles(), cell.lonelyTriangles()) << "cell " << n;
    else
      ++lonely_crossed;
  }
  EXPECT_GT(fans, 40'000u);
  EXPECT_GT(several, 10'000u);
  EXPECT_GT(lonely_crossed, 10u);
  EXPECT_LT(lonely_crossed, several / 300);
}

// The centre of gravity of this loop lies on its first side.
TEST(TransitionFans, ACentreThatMakesAFlatTriangleGivesWayToThatOfTheCell) {
  const std::vector<std::uint32_t> vertices{0, 1, 2, 3};
  const std::vector<std::uint8_t> faces(4);
  MeshBatch batch;
  batch.level = 1;
  batch.positions = {{0, 0, 0}, {2, 0, 0}, {1, 1, 0}, {1, -1, 0}};
  batch.normals.assign(4, glm::vec3(0, 0, 1));
  addCenteredFan(WorldFrame{GridGeometry()}, glm::dvec3(1), {vertices, faces}, batch);
  EXPECT_EQ(batch.triangles.size(), 12u);
  EXPECT_EQ(batch.positions.back(), glm::vec3(1));
}

}  // namespace
}  // namespace isobrick::test
