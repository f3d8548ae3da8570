// Values at vertices: steepness, and what another pyramid has there.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <mutex>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/error.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "tests/support/field_pyramid.h"

namespace isobrick {
namespace {

class ChunkValuesTest : public ::testing::Test {
 protected:
  ChunkValuesTest() {
    options_.brick_cells = 16;
    geometry_.spacing = {0.5, 1.0, 2.0};
    geometry_.origin = {-1000.0, 20.0, 3.0};
  }
  std::string build(const char* name, const test::Field& field) {
    return test::buildField(folder_, Index3(50, 49, 43), field, options_, geometry_, name);
  }
  // All chunks of a surface with leaves of several levels.
  static std::vector<SurfaceChunk> chunksWith(const Pyramid& pyramid, const ChunkValues& values,
                                              double isovalue) {
    Query query;
    query.isovalue = isovalue;
    query.focus = FocusSphere{{10.0, 20.0, 20.0}, 12.0};
    std::mutex mutex;
    std::vector<SurfaceChunk> chunks;
    ChunkSink sink({}, {&values}, [&](std::size_t, SurfaceChunk&& chunk) {
      const std::lock_guard lock(mutex);
      chunks.push_back(std::move(chunk));
    });
    extractIsosurface(pyramid, query, sink);
    return chunks;
  }
  static double shareOf(const SurfaceVertex& vertex) { return (vertex.value + 32766) / 65533.0; }

  test::TemporaryFolder folder_;
  BuildOptions options_;
  GridGeometry geometry_;
};

TEST_F(ChunkValuesTest, ALinearFieldIsEquallySteepEverywhereOnEveryLevel) {
  const Pyramid pyramid(
      build("linear.isb", [](const glm::dvec3& p) { return 2.0 * p.x + 1.0 * p.y - 4.0 * p.z; }));
  const auto values = gradientValues(pyramid);
  const auto [least, greatest] = values->range();
  EXPECT_EQ(least, 0.0);
  const double expected = std::sqrt(16.0 + 1.0 + 4.0);  // per world unit: 4, 1 and -2
  std::size_t seen = 0;
  int coarsest = 0;
  for (const SurfaceChunk& chunk : chunksWith(pyramid, *values, -20.5)) {
    coarsest = std::max(coarsest, chunk.level);
    for (const SurfaceVertex& vertex : chunk.vertices) {
      ASSERT_NEAR(shareOf(vertex) * greatest, expected, 1.1 * greatest / 65533.0);
      ++seen;
    }
  }
  EXPECT_GT(seen, 500u);
  EXPECT_GE(coarsest, 2);
}

TEST_F(ChunkValuesTest, AnotherPyramidHasItsValuesWhereTheVerticesAre) {
  const Pyramid pyramid(build(
      "shown.isb", [](const glm::dvec3& p) { return 18.0 - glm::distance(p, glm::dvec3(24.0)); }));
  const auto values = otherValues(
      pyramid, build("other.isb", [](const glm::dvec3& p) { return 3.0 * p.x - p.y + 7.0; }));
  const auto [least, greatest] = values->range();
  std::size_t seen = 0;
  for (const SurfaceChunk& chunk : chunksWith(pyramid, *values, 0.5)) {
    for (const SurfaceVertex& vertex : chunk.vertices) {
      const glm::dvec3 at = chunk.origin + glm::dvec3(vertex.position);
      ASSERT_NEAR(least + shareOf(vertex) * (greatest - least), 3.0 * at.x - at.y + 7.0,
                  1.1 * (greatest - least) / 65533.0);
      ++seen;
    }
  }
  EXPECT_GT(seen, 500u);
  EXPECT_THROW(otherValues(pyramid, folder_.file("nothing.isb")), Error);
}

TEST_F(ChunkValuesTest, OutsideOfTheOtherPyramidThereIsNone) {
  const Pyramid pyramid(build(
      "shown.isb", [](const glm::dvec3& p) { return 18.0 - glm::distance(p, glm::dvec3(24.0)); }));
  GridGeometry far = geometry_;
  far.origin.x += 12.5;  // the second half
  const auto values =
      otherValues(pyramid, test::buildField(
                               folder_, Index3(50, 49, 43), [](const glm::dvec3& p) { return p.y; },
                               options_, far, "far.isb"));
  std::size_t with = 0, without = 0;
  for (const SurfaceChunk& chunk : chunksWith(pyramid, *values, 0.5)) {
    for (const SurfaceVertex& vertex : chunk.vertices) {
      const double x = chunk.origin.x + static_cast<double>(vertex.position.x);
      if (std::abs(x - 24.5) < 0.01) continue;
      ASSERT_EQ(vertex.value == kNoVertexValue, x < 24.5) << x;
      ++(vertex.value == kNoVertexValue ? without : with);
    }
  }
  EXPECT_GT(with, 100u);
  EXPECT_GT(without, 100u);
}

TEST(VertexValueTest, SharesKeepSixteenBits) {
  EXPECT_EQ(packValue(0.0), -32766);
  EXPECT_EQ(packValue(1.0), 32767);
  EXPECT_EQ(packValue(-5.0), -32766);
  EXPECT_EQ(packValue(5.0), 32767);
  EXPECT_EQ(packValue(std::nan("")), kNoVertexValue);
}

}  // namespace
}  // namespace isobrick
