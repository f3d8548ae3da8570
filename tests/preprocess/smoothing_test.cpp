// Smoothing (Derivation::denoise): what stays where it is, what becomes round, and that nothing
// depends on how a volume is read.
#include "isobrick/preprocess/kernels/smoothing.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <cmath>
#include <functional>
#include <glm/glm.hpp>
#include <limits>
#include <memory>

#include "isobrick/extract/extractor.h"
#include "isobrick/preprocess/brick_stream.h"
#include "isobrick/preprocess/derived_volume.h"
#include "tests/support/array_source.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

constexpr double kSigma = 1.25;
constexpr double kBallRadius = 20;
const glm::dvec3 kMiddle{31.3, 31.1, 31.7};
constexpr Index3 kBallVoxels{64, 63, 65};

double radiusAt(const Index3& i) { return glm::length(glm::dvec3(i) - kMiddle); }
std::vector<std::uint8_t> ballMask() {
  return arrayOfField<std::uint8_t>(kBallVoxels,
                                    [](const Index3& i) { return radiusAt(i) <= kBallRadius; });
}
std::vector<float> ballDistance() {
  return arrayOfField<float>(kBallVoxels,
                             [](const Index3& i) { return kBallRadius - radiusAt(i); });
}

template <typename T>
std::unique_ptr<VolumeSource> smoothed(const Index3& voxels, const std::vector<T>& values,
                                       double sigma,
                                       std::shared_ptr<std::vector<SurfaceShift>> shifts = {}) {
  return derivedVolume(std::make_unique<ArraySource<T>>(voxels, values),
                       {.label = {}, .denoise = sigma, .shifts = std::move(shifts)});
}

// All voxels, `rows` rows at a time.
std::vector<float> readByRows(VolumeSource& source, std::int64_t rows) {
  const Index3 n = source.info().voxels;
  std::vector<float> values(static_cast<std::size_t>(elementCount(n)));
  for (std::int64_t row = 0; row < n.y * n.z; row += rows)
    source.readRows(row, std::min(rows, n.y * n.z - row), values.data() + row * n.x);
  return values;
}

template <typename T>
std::vector<float> smooth(const Index3& voxels, const std::vector<T>& values, double sigma,
                          std::int64_t rows = 7) {
  return readByRows(*smoothed(voxels, values, sigma), rows);
}

// In double, voxel by voxel.
template <typename T>
std::vector<double> slowlySmoothed(const Index3& n, const std::vector<T>& values, double sigma) {
  const std::vector<float> weights = smoothingWeights(sigma);
  std::vector<double> now(values.begin(), values.end());
  for (int axis = 2; axis >= 0; --axis) {
    const std::vector<double> before = now;
    const auto at = [&](Index3 i, std::int64_t step) {
      i[axis] += step;
      return before[static_cast<std::size_t>(i.x + n.x * (i.y + n.y * i.z))];
    };
    std::size_t place = 0;
    for (Index3 i(0); i.z < n.z; ++i.z)
      for (i.y = 0; i.y < n.y; ++i.y)
        for (i.x = 0; i.x < n.x; ++i.x, ++place)
          for (std::int64_t k = 1; k <= static_cast<std::int64_t>(weights.size()); ++k) {
            if (k > std::min(i[axis], n[axis] - 1 - i[axis])) break;
            const double pair = at(i, -k) + at(i, k) - 2 * at(i, 0);
            if (std::isfinite(pair))
              now[place] += static_cast<double>(weights[static_cast<std::size_t>(k) - 1]) * pair;
          }
  }
  return now;
}

struct BallMesh {
  MeshReport report;
  double mean_angle = 0;  // of the triangles to the true normal, by area, in degrees
};
template <typename T>
BallMesh ballMeshOf(const Index3& voxels, const std::vector<T>& values, double isovalue) {
  VolumeInfo info;
  info.voxels = voxels;
  info.voxel_type = voxelTypeOf<T>();
  info.source = "ball";
  const auto pyramid = pyramidOfArray(info, {values.data(), voxels.x, voxels.x * voxels.y});
  SurfaceMesh mesh;
  Query query;
  query.isovalue = isovalue;
  extractIsosurface(*pyramid, query, mesh);
  std::vector<glm::dvec3> positions;
  for (std::uint64_t v = 0; v < mesh.positions().size(); ++v)
    positions.push_back(mesh.worldPosition(v));
  BallMesh ball{checkMesh(positions, mesh.triangles(), indexOptions(voxels))};
  EXPECT_TRUE(ball.report.ok()) << ball.report.summary();
  double areas = 0;
  for (std::size_t t = 0; t < mesh.triangles().size(); t += 3) {
    const glm::dvec3 a = positions[mesh.triangles()[t]], b = positions[mesh.triangles()[t + 1]],
                     c = positions[mesh.triangles()[t + 2]];
    const glm::dvec3 normal = glm::cross(b - a, c - a);
    const glm::dvec3 outward = glm::normalize((a + b + c) / 3.0 - kMiddle);
    const double area = glm::length(normal);
    ball.mean_angle +=
        area * glm::degrees(std::acos(std::min(1.0, glm::dot(normal / area, outward))));
    areas += area;
  }
  ball.mean_angle /= areas;
  return ball;
}

TEST(SmoothingTest, SecondMomentsOfTheKernelVanish) {
  for (const double sigma : {0.3, 0.7, 1.0, 1.25, 2.5, 5.0, 10.0}) {
    double second = 0, absolute = 0, sum = 0, k = 1;
    for (const float weight : smoothingWeights(sigma)) {
      second += k * k * static_cast<double>(weight);
      absolute += k * k * static_cast<double>(std::abs(weight));
      sum += 2 * static_cast<double>(weight);
      ++k;
    }
    EXPECT_NEAR(second, 0, 1e-5 * absolute) << sigma;
    EXPECT_LT(sum, 1) << "the middle weighs, too";
    EXPECT_GT(sum, 0) << sigma;
  }
}

TEST(SmoothingTest, ConstantsAndLinearFieldsStayToTheBorder) {
  const Index3 voxels(23, 17, 19);
  const auto constant = arrayOfField<std::int16_t>(voxels, [](const Index3&) { return 1000; });
  for (const float value : smooth(voxels, constant, 1.7)) ASSERT_EQ(value, 1000.0F);
  const auto linear = arrayOfField<std::int16_t>(
      voxels, [](const Index3& i) { return 100 + 3 * i.x - 5 * i.y + 2 * i.z; });
  const std::vector<float> result = smooth(voxels, linear, 1.7);
  for (std::size_t i = 0; i < linear.size(); ++i)
    ASSERT_EQ(result[i], static_cast<float>(linear[i])) << i;
}

TEST(SmoothingTest, IsWhatTheSlowOneSays) {
  Random random(7);
  for (const Index3& voxels : {Index3(37, 11, 9), Index3(2, 2, 2), Index3(5, 40, 33)})
    for (const double sigma : {0.4, 1.0, 2.2}) {
      const auto values = arrayOfField<std::uint16_t>(
          voxels, [&](const Index3&) { return randomBelow(random, 4096); });
      const std::vector<float> fast = smooth(voxels, values, sigma);
      const std::vector<double> slow = slowlySmoothed(voxels, values, sigma);
      for (std::size_t i = 0; i < values.size(); ++i)
        ASSERT_NEAR(static_cast<double>(fast[i]), slow[i], 0.01) << i;
    }
}

TEST(SmoothingTest, DependsOnNeitherRowsNorThreads) {
  const Index3 voxels(45, 31, 40);
  Random random(3);
  const auto values =
      arrayOfField<float>(voxels, [&](const Index3&) { return randomReal(random, 0, 100); });
  const std::vector<float> wanted = smooth(voxels, values, 1.5, voxels.y * voxels.z);
  for (const std::int64_t rows : {1, 13, 31, 100}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(smooth(voxels, values, 1.5, rows), wanted) << rows;
  }
  // From the middle on, as for a box.
  const auto source = smoothed(voxels, values, 1.5);
  std::vector<float> some(static_cast<std::size_t>(voxels.x * 70));
  source->readRows(17 * voxels.y + 5, 70, some.data());
  EXPECT_TRUE(
      std::equal(some.begin(), some.end(), wanted.begin() + (17 * voxels.y + 5) * voxels.x));
}

TEST(SmoothingTest, WhatIsNotFiniteStaysAndDoesNotSpread) {
  const Index3 voxels(20, 18, 22);
  Random random(5);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kMost = std::numeric_limits<float>::max();
  auto values = arrayOfField<float>(voxels, [&](const Index3& i) {
    return i.x + i.y < 9 ? kNan : static_cast<float>(randomBelow(random, 1000));
  });
  values[4000] = std::numeric_limits<float>::infinity();
  const std::vector<float> fast = smooth(voxels, values, 1.0);
  const std::vector<double> slow = slowlySmoothed(voxels, values, 1.0);
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_EQ(std::isfinite(values[i]), std::isfinite(fast[i])) << i;
    if (std::isfinite(values[i])) {
      ASSERT_NEAR(static_cast<double>(fast[i]), slow[i], 0.01) << i;
    }
  }
  // Numbers so large that their sums are infinite are still numbers.
  const auto large = arrayOfField<float>(
      voxels, [&](const Index3& i) { return (i.x + i.y + i.z) % 2 == 0 ? kMost : -kMost; });
  for (const float value : smooth(voxels, large, 1.0)) ASSERT_TRUE(std::isfinite(value));
}

TEST(SmoothingTest, ABallKeepsItsVolumeAndBecomesRound) {
  const auto mask = ballMask();
  const BallMesh rough = ballMeshOf(kBallVoxels, mask, 0.5);
  const BallMesh smooth_mask = ballMeshOf(kBallVoxels, smooth(kBallVoxels, mask, kSigma), 0.5);
  EXPECT_NEAR(smooth_mask.report.volume / rough.report.volume, 1, 0.005);
  EXPECT_LT(smooth_mask.mean_angle, rough.mean_angle / 3);
  EXPECT_EQ(smooth_mask.report.euler, 2);

  const auto field = ballDistance();
  const double volume = ballMeshOf(kBallVoxels, field, 0).report.volume;
  for (const double sigma : {1.0, 2.0, 3.0})
    EXPECT_NEAR(
        ballMeshOf(kBallVoxels, smooth(kBallVoxels, field, sigma), 0).report.volume / volume, 1,
        0.0005)
        << sigma;
}

TEST(SmoothingTest, AtTheBorderTheSurfaceSlidesInTheFaceAlone) {
  // Half a ball, cut by the face x = 0: the rim is a circle of the same radius, and nothing else of
  // the surface reaches the face or leaves it.
  const Index3 voxels(40, 64, 64);
  const glm::dvec3 middle(0, 31.3, 31.6);
  const auto field = arrayOfField<float>(
      voxels, [&](const Index3& i) { return kBallRadius - glm::length(glm::dvec3(i) - middle); });
  const std::vector<float> result = smooth(voxels, field, 2.0);
  VolumeInfo info;
  info.voxels = voxels;
  info.voxel_type = VoxelType::kFloat32;
  const auto pyramid = pyramidOfArray(info, {result.data(), voxels.x, voxels.x * voxels.y});
  SurfaceMesh mesh;
  extractIsosurface(*pyramid, Query(), mesh);
  std::size_t in_face = 0;
  for (std::uint64_t v = 0; v < mesh.positions().size(); ++v) {
    const glm::dvec3 place = mesh.worldPosition(v);
    if (place.x > 0) continue;
    ++in_face;
    EXPECT_EQ(place.x, 0);
    EXPECT_NEAR(glm::length(place - middle), kBallRadius, 0.05);
  }
  EXPECT_GT(in_face, 100u);
}

TEST(SmoothingTest, SaysHowFarTheSurfaceMoved) {
  const auto mask = ballMask();
  const auto shifts = std::make_shared<std::vector<SurfaceShift>>(
      std::vector<SurfaceShift>{{.isovalue = 0.5}, {.isovalue = 7}});
  const auto source = smoothed(kBallVoxels, mask, kSigma, shifts);
  readByRows(*source, 50);
  const SurfaceShift& shift = shifts->front();
  // The crossings of a mask lie half way along edges: their distances to the sphere are known.
  double sum = 0, most = 0;
  std::uint64_t crossings = 0;
  for (Index3 i(0); i.z < kBallVoxels.z; ++i.z)
    for (i.y = 0; i.y < kBallVoxels.y; ++i.y)
      for (i.x = 0; i.x < kBallVoxels.x; ++i.x)
        for (int axis = 0; axis < 3; ++axis) {
          Index3 next = i;
          if (++next[axis] == kBallVoxels[axis]) continue;
          if ((radiusAt(i) <= kBallRadius) == (radiusAt(next) <= kBallRadius)) continue;
          const glm::dvec3 place = (glm::dvec3(i) + glm::dvec3(next)) / 2.0;
          const double distance = std::abs(glm::length(place - kMiddle) - kBallRadius);
          sum += distance;
          most = std::max(most, distance);
          ++crossings;
        }
  EXPECT_EQ(shift.crossings + shift.gone, crossings);
  EXPECT_EQ(shift.gone, 0u);
  EXPECT_NEAR(shift.mean(), sum / static_cast<double>(crossings), 0.05);
  EXPECT_NEAR(shift.most, most, 0.25);
  EXPECT_EQ((*shifts)[1].crossings, 0u);

  // A single voxel is gone, and a plane stays.
  const Index3 voxels(24, 24, 24);
  const auto dot = arrayOfField<std::uint8_t>(
      voxels, [](const Index3& i) { return i == Index3(12, 12, 12) ? 1 : 0; });
  const auto plane =
      arrayOfField<std::uint8_t>(voxels, [](const Index3& i) { return i.z > 12 ? 1 : 0; });
  for (const auto& [values, moves] : {std::pair(dot, true), std::pair(plane, false)}) {
    const auto one =
        std::make_shared<std::vector<SurfaceShift>>(std::vector<SurfaceShift>{{.isovalue = 0.5}});
    readByRows(*smoothed(voxels, values, 2.0, one), 24);
    EXPECT_EQ(one->front().gone > 0, moves);
    if (!moves) {
      EXPECT_NEAR(one->front().most, 0, 1e-5);
      EXPECT_EQ(one->front().crossings, 24u * 24u);
    }
  }
}

}  // namespace
}  // namespace isobrick::test
