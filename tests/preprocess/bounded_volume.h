// Volumes with their pyramids' curvature bounds, and the samples that these speak of: read by the
// plain reader and evaluated in double precision, with nothing taken from preprocess/ but the
// builder.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/geometric.hpp>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "isobrick/preprocess/kernels/curvature_fit.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "tests/support/array_source.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/trilinear_jet.h"

namespace isobrick::test {

// A trilinear cell in double precision, with nothing taken from preprocess/.
struct TrilinearCell {
  std::array<double, 8> corners;  // x fastest

  static double blend(double t, int side) { return side == 1 ? t : 1 - t; }
  static double slope(int side) { return side == 1 ? 1 : -1; }
  template <typename X, typename Y, typename Z>
  double sum(X&& x, Y&& y, Z&& z) const {
    double result = 0;
    for (int i = 0; i < 8; ++i)
      result += corners[static_cast<std::size_t>(i)] * x(i & 1) * y(i >> 1 & 1) * z(i >> 2);
    return result;
  }
  double value(const glm::dvec3& p) const {
    return sum([&](int s) { return blend(p.x, s); }, [&](int s) { return blend(p.y, s); },
               [&](int s) { return blend(p.z, s); });
  }
  glm::dvec3 gradient(const glm::dvec3& p) const {
    const auto bx = [&](int s) { return blend(p.x, s); };
    const auto by = [&](int s) { return blend(p.y, s); };
    const auto bz = [&](int s) { return blend(p.z, s); };
    return {sum(slope, by, bz), sum(bx, slope, bz), sum(bx, by, slope)};
  }
  // Squared Frobenius norm of the tangential Hessian over |g|^2: kappa1^2 + kappa2^2; then / 4.
  double totalCurvatureAt(const glm::dvec3& p) const {
    const auto bx = [&](int s) { return blend(p.x, s); };
    const auto by = [&](int s) { return blend(p.y, s); };
    const auto bz = [&](int s) { return blend(p.z, s); };
    const double xy = sum(slope, slope, bz), xz = sum(slope, by, slope), yz = sum(bx, slope, slope);
    const glm::dvec3 g = gradient(p);
    const double length = glm::length(g);
    const glm::dvec3 n = g / length;
    const glm::dvec3 hn(xy * n.y + xz * n.z, xy * n.x + yz * n.z, xz * n.x + yz * n.y);
    const double nhn = glm::dot(n, hn);
    // |PHP|^2 = |H|^2 - 2 |Hn|^2 + (n'Hn)^2 with P = I - n n'.
    const double h2 = 2 * (xy * xy + xz * xz + yz * yz);
    return std::max(0.0, h2 - 2 * glm::dot(hn, hn) + nhn * nhn) / (4 * length * length);
  }
};

using Field = std::function<double(const glm::dvec3& voxel)>;

inline Field whiteNoise(double low, double high) {
  return [random = Random(6), low, high](const glm::dvec3&) mutable {
    return randomReal(random, low, high);
  };
}

inline Field smoothWaves(double amplitude, double offset) {
  return [=](const glm::dvec3& p) {
    const double wave = std::sin(0.11 * p.x + 0.07 * p.y) + std::cos(0.09 * p.y - 0.13 * p.z) +
                        std::sin(0.15 * p.z + 0.05 * p.x + 1) * std::cos(0.08 * p.y);
    return offset + amplitude * wave / 3;
  };
}

// A head as a CT sees it: air, skin, a bright shell of bone, a brain with little contrast, and
// noise everywhere; edges about two voxels wide.
inline Field headLike(double size) {
  return [random = Random(7), size](const glm::dvec3& voxel) mutable {
    const glm::dvec3 p = (voxel - glm::dvec3(size / 2)) / (size * glm::dvec3(0.38, 0.45, 0.42));
    const double radius = glm::length(p);
    const auto step = [&](double at) {  // 1 inside
      return 0.5 - 0.5 * std::tanh((radius - at) * size * 0.4);
    };
    const double folds = 0.03 * std::sin(9 * p.x) * std::sin(8 * p.y) * std::sin(10 * p.z);
    double value = 1000 * step(1.0) + 1200 * (step(0.93) - step(0.85 + folds));
    value += 40 * std::sin(14 * p.x + 3) * std::cos(13 * p.y) * step(0.8);
    return std::max(0.0, value + std::normal_distribution<double>(24, 8)(random));
  };
}

// One volume's pyramid, with the voxels beside it.
struct BoundedVolume {
  PlainPyramid pyramid;
  PlainIndex dims{};
  std::vector<float> voxels;

  float voxel(std::int64_t x, std::int64_t y, std::int64_t z) const {
    return voxels[static_cast<std::size_t>((z * dims[1] + y) * dims[0] + x)];
  }
  // The level-0 cell at `cell`.
  TrilinearCell cellAt(const PlainIndex& cell) const {
    TrilinearCell result;
    for (int i = 0; i < 8; ++i)
      result.corners[static_cast<std::size_t>(i)] =
          static_cast<double>(voxel(cell[0] + (i & 1), cell[1] + (i >> 1 & 1), cell[2] + (i >> 2)));
    return result;
  }
};

inline BoundedVolume makeBoundedVolume(const TemporaryFolder& folder, const Index3& dims,
                                       VoxelType type, const Field& field,
                                       std::int64_t brick_cells = 16, std::int64_t tile_cells = 4) {
  BuildOptions options;
  options.brick_cells = brick_cells;
  options.tile_cells = tile_cells;
  const std::string path = folder.file("volume.isb");
  visitVoxelType(type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    // The field is copied because those of noise have a state.
    ArraySource<T> source(
        dims, arrayOfField<T>(dims, [field](const Index3& at) { return field(glm::dvec3(at)); }));
    buildPyramid(source, path, options);
  });
  BoundedVolume volume;
  volume.pyramid = readPlainPyramid(path);
  volume.dims = volume.pyramid.dims;
  volume.voxels.resize(static_cast<std::size_t>(elementCount(dims)));
  for (const PlainBrick& brick : volume.pyramid.bricks) {
    if (brick.level > 0) continue;
    std::size_t i = 0;
    for (std::int64_t z = 0; z < brick.count[2]; ++z)
      for (std::int64_t y = 0; y < brick.count[1]; ++y)
        for (std::int64_t x = 0; x < brick.count[0]; ++x)
          volume.voxels[static_cast<std::size_t>(
              ((brick.first_sample[2] + z) * dims.y + brick.first_sample[1] + y) * dims.x +
              brick.first_sample[0] + x)] = brick.samples[i++];
  }
  return volume;
}

struct NodeBound {
  PlainIndex first_cell{};  // of level 0
  PlainIndex cells{};       // 1 or 2 per axis
  PlainRange tile_range;
  const std::uint8_t* codes = nullptr;
};

inline void forAllNodes(const BoundedVolume& volume,
                        const std::function<void(const NodeBound&)>& f) {
  for (const PlainBrick& brick : volume.pyramid.bricks) {
    if (brick.level > 0) continue;
    const std::uint8_t* codes = brick.codes.data();
    PlainIndex n;
    for (n[2] = 0; n[2] < brick.nodes[2]; ++n[2])
      for (n[1] = 0; n[1] < brick.nodes[1]; ++n[1])
        for (n[0] = 0; n[0] < brick.nodes[0]; ++n[0], codes += 3) {
          NodeBound node;
          for (std::size_t a = 0; a < 3; ++a) {
            node.first_cell[a] = brick.first_cell[a] + 2 * n[a];
            node.cells[a] = std::min<std::int64_t>(2, volume.dims[a] - 1 - node.first_cell[a]);
          }
          node.tile_range = brick.tileRangeOfCell(node.first_cell, volume.pyramid.tile_cells);
          node.codes = codes;
          f(node);
        }
  }
}

inline void forAllCells(const NodeBound& node, const std::function<void(const PlainIndex&)>& f) {
  PlainIndex c;
  for (c[2] = 0; c[2] < node.cells[2]; ++c[2])
    for (c[1] = 0; c[1] < node.cells[1]; ++c[1])
      for (c[0] = 0; c[0] < node.cells[0]; ++c[0])
        f({node.first_cell[0] + c[0], node.first_cell[1] + c[1], node.first_cell[2] + c[2]});
}

struct CurvatureSample {
  double value = 0, curvature = 0;
};

// The samples of the cell at `points` that count: gradient at least epsilon times the tile's range.
// The fit takes a hair less, so that its rounding does not decide.
template <typename Points, typename F>
inline void forCountedSamples(const BoundedVolume& volume, const NodeBound& node,
                              const PlainIndex& cell, const Points& points, F&& f) {
  const TrilinearCell trilinear = volume.cellAt(cell);
  const double width =
      static_cast<double>(node.tile_range.max) - static_cast<double>(node.tile_range.min);
  const double least = volume.pyramid.curvature_epsilon * width;
  for (const glm::dvec3& p : points) {
    const double length = glm::length(trilinear.gradient(p));
    if (length > 0 && length >= least)
      f(CurvatureSample{trilinear.value(p), trilinear.totalCurvatureAt(p)});
  }
}

inline std::vector<glm::dvec3> fittedPoints() {
  std::vector<glm::dvec3> points;
  for (const auto& p : kCellSamplePoints) points.push_back(glm::dvec3(p[0], p[1], p[2]) / 2.0);
  return points;
}

}  // namespace isobrick::test
