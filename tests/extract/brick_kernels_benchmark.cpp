// The cost of a triangle, by phase of the uniform kernel, over the bricks of a volume in memory
// that is warm. ISOBRICK_BENCHMARK_SIZE: voxels per axis, 256 by default.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

constexpr std::int64_t kTile = 4;

// All bricks of one volume, as a pyramid stores them, with the rows of cells in tiles that the
// isosurface may cross.
template <typename T>
struct BricksInMemory {
  struct Brick {
    IndexBox cells, samples;
    std::vector<T> values;
    std::vector<std::uint8_t> crossed_rows;
  };
  Lattice lattice;
  float isovalue;
  WorldFrame frame{GridGeometry{}};
  std::vector<Brick> bricks;

  template <typename F>
  BricksInMemory(std::int64_t size, float iso, F&& value) : lattice(Index3(size)), isovalue(iso) {
    const BrickLayout layout(lattice, 64, kTile);
    const Index3 count = layout.bricks(0);
    for (std::int64_t n = 0; n < elementCount(count); ++n) {
      const Index3 at = indexAt(n, count);
      Brick brick;
      brick.cells = layout.brickCellBox(0, at);
      brick.samples = layout.brickSampleBox(0, at);
      for (std::int64_t i = 0; i < brick.samples.size(); ++i) {
        const Index3& c = brick.samples.count;
        brick.values.push_back(static_cast<T>(
            value(brick.samples.first + Index3(i % c.x, i / c.x % c.y, i / (c.x * c.y)))));
      }
      if (markCrossedRows(brick)) bricks.push_back(std::move(brick));
    }
  }

  bool markCrossedRows(Brick& brick) const {
    const Index3& cells = brick.cells.count;
    brick.crossed_rows.assign(static_cast<std::size_t>(cells.y * cells.z), 0);
    bool any = false;
    const Index3 inset = brick.cells.first - brick.samples.first;
    for (std::int64_t tz = 0; tz < cells.z; tz += kTile)
      for (std::int64_t ty = 0; ty < cells.y; ty += kTile)
        for (std::int64_t tx = 0; tx < cells.x; tx += kTile) {
          ValueRange range;
          const Index3 end = glm::min(Index3(tx, ty, tz) + Index3(kTile), cells);
          for (std::int64_t z = tz; z <= end.z; ++z)
            for (std::int64_t y = ty; y <= end.y; ++y)
              for (std::int64_t x = tx; x <= end.x; ++x)
                range.include(static_cast<float>(brick.values[static_cast<std::size_t>(
                    linearIndex(Index3(x, y, z) + inset, brick.samples.count))]));
          if (!range.crosses(isovalue)) continue;
          any = true;
          for (std::int64_t z = tz; z < end.z; ++z)
            for (std::int64_t y = ty; y < end.y; ++y)
              brick.crossed_rows[static_cast<std::size_t>(z * cells.y + y)] = 1;
        }
    return any;
  }
};

std::int64_t benchmarkSize() {
  const char* text = std::getenv("ISOBRICK_BENCHMARK_SIZE");
  return text != nullptr ? std::atoll(text) : 256;
}

// The least time of each phase in each brick over all passes: what others do on the machine
// disturbs some passes of every brick, but hardly all.
struct PhaseTimes {
  enum Phase { kCompare, kNumber, kCross, kMesh, kPhases };
  std::vector<std::array<double, kPhases>> least;

  explicit PhaseTimes(std::size_t bricks) : least(bricks, {1e9, 1e9, 1e9, 1e9}) {}
  double sum(Phase phase) const {
    double seconds = 0;
    for (const auto& brick : least) seconds += brick[phase];
    return seconds;
  }
};

// Measures phases one after the other.
class PhaseClock {
 public:
  explicit PhaseClock(std::array<double, PhaseTimes::kPhases>& least) : least_(least) {}
  void end(PhaseTimes::Phase phase) {
    const auto now = std::chrono::steady_clock::now();
    least_[phase] = std::min(least_[phase], std::chrono::duration<double>(now - begin_).count());
    begin_ = std::chrono::steady_clock::now();
  }

 private:
  std::array<double, PhaseTimes::kPhases>& least_;
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

template <typename T>
void meshBricks(benchmark::State& state, const BricksInMemory<T>& volume) {
  BrickRows rows;
  CornerSpacing spacing;
  std::vector<float> positions, normals;
  std::vector<std::uint32_t> triangles;
  PhaseTimes times(volume.bricks.size());
  std::size_t vertex = 0, index = 0;
  bool is_warm = false;
  const auto pass = [&] {
    vertex = index = 0;
    for (std::size_t n = 0; n < volume.bricks.size(); ++n) {
      const auto& brick = volume.bricks[n];
      PhaseClock clock(times.least[n]);
      const BrickGrid<T> grid = {brick.values.data(), brick.samples.count,
                                 brick.cells.first - brick.samples.first, brick.cells.count};
      rows.resize(brick.cells.count);
      for (std::int64_t k = 0, row = 0; k < rows.cells.z; ++k)
        for (std::int64_t j = 0; j < rows.cells.y; ++j, ++row)
          if (brick.crossed_rows[static_cast<std::size_t>(row)] != 0)
            rows.wantedCells(j, k)[0] = cellBits(rows.cells.x, 0);
      compareRows(grid, *insideThreshold<T>(volume.isovalue), rows);
      clock.end(PhaseTimes::kCompare);
      numberRows(rows);
      clock.end(PhaseTimes::kNumber);
      if (!is_warm) {
        positions.resize(3 * (vertex + rows.ownCrossings()));
        normals.resize(positions.size());
        triangles.resize(index + 3 * static_cast<std::size_t>(rows.triangles));
      }
      spacing.set(volume.lattice, 0, brick.cells, brick.samples);
      makeCrossings(grid, rows, spacing, volume.frame, volume.isovalue,
                    positions.data() + 3 * vertex, normals.data() + 3 * vertex);
      clock.end(PhaseTimes::kCross);
      makeTriangles(rows, firstVertices(rows, static_cast<std::uint32_t>(vertex)), false,
                    triangles.data() + index);
      clock.end(PhaseTimes::kMesh);
      vertex += rows.ownCrossings();
      index += 3 * static_cast<std::size_t>(rows.triangles);
    }
  };
  pass();
  is_warm = true;
  for (auto _ : state) pass();
  const double triangle_count = static_cast<double>(index) / 3;
  double all = 0;
  const auto report = [&](const char* name, PhaseTimes::Phase phase, double count) {
    state.counters[name] = 1e9 * times.sum(phase) / count;
    all += times.sum(phase);
  };
  state.counters["triangles"] = triangle_count;
  report("compare_ns_tri", PhaseTimes::kCompare, triangle_count);
  report("number_ns_tri", PhaseTimes::kNumber, triangle_count);
  report("cross_ns_vertex", PhaseTimes::kCross, static_cast<double>(vertex));
  report("mesh_ns_tri", PhaseTimes::kMesh, triangle_count);
  state.counters["all_ns_tri"] = 1e9 * all / triangle_count;
}

void meshGyroid(benchmark::State& state) {
  const std::int64_t size = benchmarkSize();
  static const BricksInMemory<std::uint8_t> volume(size, 127.5f, [](const Index3& p) {
    const glm::dvec3 q = 0.32 * glm::dvec3(p);
    const double v = std::sin(q.x) * std::cos(q.y) + std::sin(q.y) * std::cos(q.z) +
                     std::sin(q.z) * std::cos(q.x);
    return 127.5 + 80 * v;
  });
  meshBricks(state, volume);
}
void meshShells(benchmark::State& state) {
  const std::int64_t size = benchmarkSize();
  static const BricksInMemory<std::uint16_t> volume(size, 600.5f, [size](const Index3& p) {
    const glm::dvec3 q = glm::dvec3(p) - 0.5 * static_cast<double>(size);
    const double r = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z) / static_cast<double>(size);
    return 600 + 400 * std::sin(28 * r) + static_cast<double>((p.x * 7 + p.y * 13 + p.z * 5) % 16);
  });
  meshBricks(state, volume);
}
BENCHMARK(meshGyroid)->Unit(benchmark::kMillisecond);
BENCHMARK(meshShells)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isobrick
