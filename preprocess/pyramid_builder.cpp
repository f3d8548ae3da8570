#include "preprocess/pyramid_builder.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "preprocess/curvature_bricks.h"
#include "preprocess/low_pass.h"
#include "preprocess/node_ranges.h"
#include "storage/pyramid_writer.h"

namespace isobrick {
namespace {

// Slices per request to the source: enough to amortise a call, little beside the volume.
constexpr std::int64_t kSlicesPerRead = 16;

// One build, phase by phase; T is the voxel type. The levels are plain arrays in memory.
template <typename T>
class Build {
 public:
  Build(VolumeSource& source, const std::string& path, const BuildOptions& options)
      : source_(source),
        options_(options),
        spec_(makeSpec(source.info(), options)),
        layout_(spec_.layout()),
        lattice_(layout_.lattice()),
        writer_(path, spec_) {}

  BuildReport run() {
    const auto begin = Clock::now();
    phase("read", [&] { readVoxels(); });
    phase("low-pass", [&] { makeLevels(); });
    phase("ranges", [&] { makeRanges(); });
    phase(options_.with_curvature ? "curvature and write" : "write", [&] { writeBricks(); });
    phase("publish", [&] { report_.file_bytes = writer_.finish(voxel_range_, provenance()); });
    report_.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    return std::move(report_);
  }

 private:
  using Clock = std::chrono::steady_clock;

  static PyramidSpec makeSpec(const VolumeInfo& info, const BuildOptions& options) {
    PyramidSpec spec;
    spec.voxels = info.voxels;
    spec.voxel_type = info.voxel_type;
    spec.geometry = info.geometry;
    spec.filter = options.filter;
    spec.brick_cells = options.brick_cells;
    spec.tile_cells = options.tile_cells;
    spec.has_curvature = options.with_curvature;
    spec.curvature_epsilon = options.curvature_epsilon;
    return spec;
  }

  template <typename F>
  void phase(const char* name, F&& work) {
    phase_name_ = name;
    progress(0);
    const auto begin = Clock::now();
    work();
    report_.phases.push_back({name, std::chrono::duration<double>(Clock::now() - begin).count()});
    // Not a place to stop: what is published stays published.
    if (options_.progress) options_.progress(phase_name_, 1);
  }

  void progress(double fraction) {
    if (options_.cancel != nullptr) options_.cancel->check();
    if (options_.progress) options_.progress(phase_name_, fraction);
  }

  void readVoxels() {
    const Index3 dims = spec_.voxels;
    levels_.resize(static_cast<std::size_t>(lattice_.levels()));
    levels_[0].resize(static_cast<std::size_t>(elementCount(dims)));
    for (std::int64_t z = 0; z < dims.z; z += kSlicesPerRead) {
      const std::int64_t count = std::min(kSlicesPerRead, dims.z - z);
      T* slices = levels_[0].data() + z * dims.y * dims.x;
      source_.readSlices(z, count, slices);
      checkFinite(slices, z, count);
      progress(static_cast<double>(z + count) / static_cast<double>(dims.z));
    }
    const auto [least, greatest] = std::minmax_element(levels_[0].begin(), levels_[0].end());
    voxel_range_ = {static_cast<float>(*least), static_cast<float>(*greatest)};
  }

  // Refuses or replaces the voxels that no isovalue can be compared with.
  void checkFinite(T* slices, std::int64_t first, std::int64_t count) {
    if constexpr (std::is_floating_point_v<T>) {
      const Index3 dims = spec_.voxels;
      const std::int64_t voxels = count * dims.y * dims.x;
      for (std::int64_t i = 0; i < voxels; ++i) {
        if (std::isfinite(slices[i])) continue;
        if (!options_.nan_as.has_value())
          throw Error(
              "'" + source_.info().source + "' has a voxel that is " +
              (std::isnan(slices[i]) ? "not a number" : "infinite, or too large for float32,") +
              " at (" + std::to_string(i % dims.x) + "," + std::to_string(i / dims.x % dims.y) +
              "," + std::to_string(first + i / (dims.x * dims.y)) +
              "); give the value to put there with --nan-as V");
        slices[i] = *options_.nan_as;
        ++report_.replaced_voxels;
      }
    }
  }

  void makeLevels() {
    for (int level = 0; level + 1 < lattice_.levels(); ++level) {
      const Index3 dims = lattice_.samples(level + 1);
      auto& coarse = levels_[static_cast<std::size_t>(level) + 1];
      coarse.resize(static_cast<std::size_t>(elementCount(dims)));
      tbb::parallel_for(std::int64_t{0}, dims.z, [&](std::int64_t z) {
        lowPassSlices(lattice_, level, spec_.filter,
                      levels_[static_cast<std::size_t>(level)].data(), z, 1,
                      coarse.data() + z * dims.y * dims.x);
      });
      progress(static_cast<double>(level + 1) / lattice_.levels());
    }
  }

  // node_ranges_[k] are the nodes of level tile_level_ + k, up to the bricks of the coarsest level.
  void makeRanges() {
    const int last = lattice_.levels() - 1 + log2Of(spec_.brick_cells);
    node_ranges_.push_back(nodeRangesFromSamples(lattice_, levels_, tile_level_));
    for (int node_level = tile_level_ + 1; node_level <= last; ++node_level) {
      node_ranges_.push_back(coarserNodeRanges(lattice_, levels_, node_ranges_.back(), node_level));
      progress(static_cast<double>(node_level) / last);
    }
  }

  const NodeRanges& nodesOfLevel(int node_level) const {
    return node_ranges_[static_cast<std::size_t>(node_level - tile_level_)];
  }

  // Bricks are encoded side by side and written in the order of the brick table, so that the file
  // is the same for any number of threads.
  void writeBricks() {
    struct Job {
      int level = 0;
      Index3 brick{0};
      EncodedBrick encoded;
    };
    // Owned here: what is in flight when a stage throws must not be lost. Jobs end in the order in
    // which they were taken, so a ring is enough.
    const auto in_flight = static_cast<std::size_t>(4 * tbb::this_task_arena::max_concurrency());
    std::vector<Job> jobs(in_flight);
    std::size_t taken = 0;
    std::int64_t total = 0, written = 0;
    for (int level = 0; level < lattice_.levels(); ++level)
      total += elementCount(layout_.bricks(level));
    int level = 0;
    std::int64_t next = 0;
    const auto take = [&](tbb::flow_control& control) -> Job* {
      if (level == lattice_.levels() ||
          (options_.cancel != nullptr && options_.cancel->requested())) {
        control.stop();
        return nullptr;
      }
      const Index3 bricks = layout_.bricks(level);
      Job* job = &jobs[taken++ % in_flight];
      job->level = level;
      job->brick = {next % bricks.x, next / bricks.x % bricks.y, next / (bricks.x * bricks.y)};
      if (++next == elementCount(bricks)) {
        next = 0;
        ++level;
      }
      return job;
    };
    const auto encode = [&](Job* job) {
      job->encoded = encodeOne(job->level, job->brick);
      return job;
    };
    const auto write = [&](Job* job) {
      writer_.write(job->level, job->brick, job->encoded);
      progress(static_cast<double>(++written) / static_cast<double>(total));
    };
    tbb::parallel_pipeline(
        in_flight, tbb::make_filter<void, Job*>(tbb::filter_mode::serial_in_order, take) &
                       tbb::make_filter<Job*, Job*>(tbb::filter_mode::parallel, encode) &
                       tbb::make_filter<Job*, void>(tbb::filter_mode::serial_in_order, write));
    if (options_.cancel != nullptr) options_.cancel->check();
  }

  EncodedBrick encodeOne(int level, const Index3& brick) const {
    const IndexBox box = layout_.brickSampleBox(level, brick);
    const Index3 dims = lattice_.samples(level);
    const T* from = levels_[static_cast<std::size_t>(level)].data();
    std::vector<T> samples(static_cast<std::size_t>(box.size()));
    T* to = samples.data();
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; ++y, to += box.count.x)
        std::copy_n(from + (z * dims.y + y) * dims.x + box.first.x, box.count.x, to);

    const NodeRanges& tiles = nodesOfLevel(level + tile_level_);
    const Index3 tile_count = layout_.brickTiles(level, brick);
    const Index3 first_tile = brick * (spec_.brick_cells / spec_.tile_cells);
    std::vector<T> ranges;
    ranges.reserve(static_cast<std::size_t>(2 * elementCount(tile_count)));
    Index3 tile;
    for (tile.z = 0; tile.z < tile_count.z; ++tile.z)
      for (tile.y = 0; tile.y < tile_count.y; ++tile.y)
        for (tile.x = 0; tile.x < tile_count.x; ++tile.x) {
          const ValueRange& range = tiles.at(first_tile + tile);
          ranges.push_back(static_cast<T>(range.min));
          ranges.push_back(static_cast<T>(range.max));
        }
    std::vector<std::uint8_t> curvature;
    if (level == 0 && spec_.has_curvature)
      curvature = brickCurvature(layout_, brick, samples.data(), nodesOfLevel(tile_level_),
                                 spec_.curvature_epsilon);
    return encodeBrick(spec_.voxel_type, std::as_bytes(std::span(samples)),
                       std::as_bytes(std::span(ranges)), curvature,
                       nodesOfLevel(level + log2Of(spec_.brick_cells)).at(brick));
  }

  std::string provenance() const {
    const VolumeInfo& info = source_.info();
    nlohmann::json json = {
        {"tool", "isobrick " + options_.tool_version},
        {"source", info.source},
        {"format", info.format},
        {"filter", spec_.filter == format::Filter::kAverage ? "average" : "subsample"},
        {"notes", info.notes}};
    if (report_.replaced_voxels > 0)
      json["notes"].push_back(std::to_string(report_.replaced_voxels) +
                              " voxels that were not finite were replaced");
    // A path need not be UTF-8; a provenance that cannot be written would lose the whole build.
    return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }

  static int log2Of(std::int64_t power) {
    return std::countr_zero(static_cast<std::uint64_t>(power));
  }

  VolumeSource& source_;
  const BuildOptions& options_;
  const PyramidSpec spec_;
  const BrickLayout layout_;
  const Lattice lattice_;
  const int tile_level_ = log2Of(spec_.tile_cells);
  PyramidWriter writer_;
  LevelArrays<T> levels_;
  std::vector<NodeRanges> node_ranges_;
  ValueRange voxel_range_;
  BuildReport report_;
  const char* phase_name_ = "";
};

}  // namespace

BuildReport buildPyramid(VolumeSource& source, const std::string& path,
                         const BuildOptions& options) {
  if (options.nan_as.has_value() && !std::isfinite(*options.nan_as))
    throw Error("the value that replaces NaN and infinite voxels must itself be finite");
  const auto isPowerOfTwo = [](std::int64_t n) {
    return n > 0 && std::has_single_bit(static_cast<std::uint64_t>(n));
  };
  if (!isPowerOfTwo(options.brick_cells) || options.brick_cells < 4 || options.brick_cells > 256 ||
      !isPowerOfTwo(options.tile_cells) || options.tile_cells < 2 ||
      options.tile_cells > options.brick_cells)
    throw Error("a brick has 4 to 256 cells an axis and a tile 2 up to the brick's, powers of two");
  return visitVoxelType(source.info().voxel_type, [&](auto tag) {
    return Build<typename decltype(tag)::Type>(source, path, options).run();
  });
}

}  // namespace isobrick
