// The phases of the uniform kernel, each over all bricks of a gyroid of 256^3 voxels (uint8) in
// memory. Items are triangles, whatever the phase.
#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr float kIsovalue = 127.5f;

struct GyroidBrick {
  IndexBox cells, samples;
  std::vector<std::uint8_t> values;
  BrickRows rows;  // compared and numbered

  BrickGrid<std::uint8_t> grid() const {
    return {values.data(), samples.count, cells.first - samples.first, cells.count};
  }
};

void compare(GyroidBrick& brick) {
  compareRows(brick.grid(), *insideThreshold<std::uint8_t>(kIsovalue), brick.rows);
}

struct GyroidBricks {
  Lattice lattice{Index3(256)};
  std::vector<GyroidBrick> bricks;
  std::int64_t triangles = 0;
  std::size_t most_vertices = 0, most_triangles = 0;  // of a brick

  GyroidBricks() {
    const BrickLayout layout(lattice, 64, 4);
    const Index3 count = layout.bricks(0);
    for (std::int64_t n = 0; n < elementCount(count); ++n) {
      GyroidBrick& brick = bricks.emplace_back();
      brick.cells = layout.brickCellBox(0, indexAt(n, count));
      brick.samples = layout.brickSampleBox(0, indexAt(n, count));
      for (std::int64_t i = 0; i < brick.samples.size(); ++i) {
        const glm::dvec3 q =
            0.32 * glm::dvec3(brick.samples.first + indexAt(i, brick.samples.count));
        const double v = std::sin(q.x) * std::cos(q.y) + std::sin(q.y) * std::cos(q.z) +
                         std::sin(q.z) * std::cos(q.x);
        brick.values.push_back(static_cast<std::uint8_t>(127.5 + 80 * v));
      }
      brick.rows.resize(brick.cells.count);
      for (std::int64_t k = 0; k < brick.cells.count.z; ++k)
        for (std::int64_t j = 0; j < brick.cells.count.y; ++j)
          brick.rows.wantedCells(j, k)[0] = cellBits(brick.cells.count.x, 0);
      compare(brick);
      numberRows(brick.rows);
      triangles += static_cast<std::int64_t>(brick.rows.triangles);
      most_vertices = std::max(most_vertices, static_cast<std::size_t>(brick.rows.ownCrossings()));
      most_triangles = std::max(most_triangles, static_cast<std::size_t>(brick.rows.triangles));
    }
  }
};

template <typename Phase>
void forEachBrick(benchmark::State& state, Phase phase) {
  static GyroidBricks gyroid;
  std::vector<float> positions(3 * gyroid.most_vertices), normals(positions.size());
  std::vector<std::uint32_t> triangles(3 * gyroid.most_triangles);
  for (auto _ : state)
    for (GyroidBrick& brick : gyroid.bricks) phase(gyroid, brick, positions, normals, triangles);
  state.SetItemsProcessed(state.iterations() * gyroid.triangles);
}

void compareGyroid(benchmark::State& state) {
  forEachBrick(state, [](auto&, GyroidBrick& brick, auto&...) { compare(brick); });
}

void numberGyroid(benchmark::State& state) {
  forEachBrick(state, [](auto&, GyroidBrick& brick, auto&...) { numberRows(brick.rows); });
}

void crossGyroid(benchmark::State& state) {
  CornerSpacing spacing;
  const WorldFrame frame{GridGeometry{}};
  forEachBrick(state, [&](auto& gyroid, GyroidBrick& brick, auto& positions, auto& normals, auto&) {
    spacing.set(gyroid.lattice, 0, brick.cells, brick.samples);
    makeCrossings(brick.grid(), brick.rows, spacing, frame, kIsovalue, positions.data(),
                  normals.data());
  });
}

void meshGyroid(benchmark::State& state) {
  forEachBrick(state, [](auto&, GyroidBrick& brick, auto&, auto&, auto& triangles) {
    makeTriangles(brick.rows, firstVertices(brick.rows, 0), false, triangles.data());
  });
}

BENCHMARK(compareGyroid)->Unit(benchmark::kMillisecond);
BENCHMARK(numberGyroid)->Unit(benchmark::kMillisecond);
BENCHMARK(crossGyroid)->Unit(benchmark::kMillisecond);
BENCHMARK(meshGyroid)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isobrick
