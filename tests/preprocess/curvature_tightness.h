// How tight the curvature bound is at the samples that it was fitted to, and how it does on samples
// that it never saw.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "isobrick/preprocess/kernels/curvature_fit.h"
#include "isobrick/storage/curvature_code.h"
#include "tests/preprocess/bounded_volume.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {

struct TightnessCase {
  const char* name;
  VoxelType type;
  Field field;
};
// For volumes of `size` voxels an axis.
inline std::vector<TightnessCase> tightnessCases(int size) {
  return {{"noise", VoxelType::kUint8, whiteNoise(0, 256)},
          {"waves", VoxelType::kUint16, smoothWaves(30000, 32000)},
          {"head", VoxelType::kUint16, headLike(size)}};
}

// Coded coefficients fitted over the range of the node's own 27 voxels, for the same samples.
inline void fitOverOwnRange(const BoundedVolume& volume, const NodeBound& node, PlainRange* range,
                            std::uint8_t codes[3]) {
  CurvatureRow row(1);
  ValueRange own;
  for (std::int64_t z = 0; z < 3; ++z)
    for (std::int64_t y = 0; y < 3; ++y)
      for (std::int64_t x = 0; x < 3; ++x) {
        const float v = volume.voxel(std::min(node.first_cell[0] + x, volume.dims[0] - 1),
                                     std::min(node.first_cell[1] + y, volume.dims[1] - 1),
                                     std::min(node.first_cell[2] + z, volume.dims[2] - 1));
        row.voxels[static_cast<std::size_t>(3 * z + y)][static_cast<std::size_t>(x)] = v;
        own.include(v);
      }
  *range = {own.min, own.max};
  row.low[0] = own.min;
  row.high[0] = own.max;
  const auto tile_width = static_cast<double>(node.tile_range.max - node.tile_range.min);
  const auto own_width = static_cast<double>(own.max - own.min);
  CurvatureFitOptions options;
  if (own_width > 0) options.epsilon = volume.pyramid.curvature_epsilon * tile_width / own_width;
  fitCurvature(options, row);
  encodeCurvature(row, codes);
}

struct Tightness {
  std::vector<double> tile, own, constant;  // bound / curvature of every sample
  // How many of all samples may stay coarse at 1/(2 rho^2), by each bound and by the truth.
  static constexpr std::array<double, 3> kRadii = {2, 4, 8};
  std::array<std::array<std::int64_t, 4>, 3> accepted{};
  std::int64_t samples = 0, infinite = 0;
  std::int64_t below = 0;  // samples above one of their bounds
};

inline Tightness measureTightness(const BoundedVolume& volume) {
  const std::vector<glm::dvec3> points = fittedPoints();
  Tightness result;
  forAllNodes(volume, [&](const NodeBound& node) {
    if (!(node.tile_range.min < node.tile_range.max)) return;
    std::vector<CurvatureSample> samples;
    forAllCells(node, [&](const PlainIndex& cell) {
      forCountedSamples(volume, node, cell, points,
                        [&](const CurvatureSample& s) { samples.push_back(s); });
    });
    if (samples.empty()) return;
    double greatest = 0;
    for (const CurvatureSample& s : samples) greatest = std::max(greatest, s.curvature);
    const auto constant =
        static_cast<double>(CurvatureCode::decode(CurvatureCode::encodeUp(greatest)));
    PlainRange own_range;
    std::uint8_t own_codes[3];
    fitOverOwnRange(volume, node, &own_range, own_codes);
    for (const CurvatureSample& s : samples) {
      const double bounds[4] = {plainCurvatureBound(node.codes, node.tile_range, s.value),
                                plainCurvatureBound(own_codes, own_range, s.value), constant,
                                s.curvature};
      ++result.samples;
      if (bounds[0] < s.curvature || bounds[1] < s.curvature || bounds[2] < s.curvature)
        ++result.below;
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t b = 0; b < 4; ++b)
          if (bounds[b] <= 0.5 / (Tightness::kRadii[r] * Tightness::kRadii[r]))
            ++result.accepted[r][b];
      // Ratios to next to nothing say nothing: leave out what is flatter than radius 64. Nor do
      // infinite ones (coefficients above the greatest code).
      if (s.curvature < 0.5 / (64.0 * 64.0)) continue;
      if (std::isinf(bounds[0] + bounds[1] + bounds[2])) {
        ++result.infinite;
        continue;
      }
      result.tile.push_back(bounds[0] / s.curvature);
      result.own.push_back(bounds[1] / s.curvature);
      result.constant.push_back(bounds[2] / s.curvature);
    }
  });
  return result;
}

struct UnseenSamples {
  std::int64_t samples = 0, above = 0, unbounded = 0;
  std::vector<double> excess;  // curvature / bound where it is above
};

inline UnseenSamples measureUnseen(const BoundedVolume& volume, bool on_edges) {
  Random random(8);
  UnseenSamples result;
  forAllNodes(volume, [&](const NodeBound& node) {
    forAllCells(node, [&](const PlainIndex& cell) {
      std::array<glm::dvec3, 6> points;
      for (glm::dvec3& p : points) {
        p = {randomReal(random, 0, 1), randomReal(random, 0, 1), randomReal(random, 0, 1)};
        if (!on_edges) continue;
        const int along = static_cast<int>(random() % 3);
        for (int axis = 0; axis < 3; ++axis)
          if (axis != along) p[axis] = static_cast<double>(random() % 2);
      }
      forCountedSamples(volume, node, cell, points, [&](const CurvatureSample& s) {
        const double bound = plainCurvatureBound(node.codes, node.tile_range, s.value);
        ++result.samples;
        if (s.curvature <= bound) return;
        ++result.above;
        if (bound > 0)
          result.excess.push_back(s.curvature / bound);
        else
          ++result.unbounded;
      });
    });
  });
  return result;
}

}  // namespace isobrick::test
