#include "isobrick/extract/extractor.h"

#include <tbb/concurrent_queue.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <memory>
#include <string>

#include "isobrick/extract/adaptive_mesher.h"
#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/uniform_mesher.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Batches that may wait for their turn at the sink, for every thread.
constexpr std::size_t kBatchesPerThread = 4;

// In voxels from the volume's first voxel.
constexpr double kFarthestFocus = 0x1p30;

void checkQuery(const Pyramid& pyramid, const Query& query) {
  if (!std::isfinite(query.isovalue))
    throw Error("the isovalue is not a finite number; choose one within the volume's value range");
  if (query.focus && query.uniform_level)
    throw Error("a focus and a uniform level exclude each other; give one of them");
  if (query.focus) {
    for (int axis = 0; axis < 3; ++axis) {
      if (!std::isfinite(query.focus->center[axis]))
        throw Error("the focus point is not finite; give three numbers");
      // Squared distances beyond would be coarser than the room that rule 3 has for rounding.
      if (std::abs(query.focus->center[axis]) > kFarthestFocus)
        throw Error("the focus point is more than 2^30 voxels away; move it towards the volume");
    }
    if (!(query.focus->radius >= 0) || !std::isfinite(query.focus->radius))
      throw Error("the radius of interest must be a finite number >= 0");
  }
  if (query.uniform_level &&
      (*query.uniform_level < 0 || *query.uniform_level >= pyramid.lattice().levels()))
    throw Error("level " + std::to_string(*query.uniform_level) + " does not exist in '" +
                pyramid.path() + "'; its levels are 0 to " +
                std::to_string(pyramid.lattice().levels() - 1));
  if (query.curvature_tolerance) {
    if (!(*query.curvature_tolerance >= 0))
      throw Error("the curvature tolerance must be a number >= 0");
    if (query.uniform_level && *query.uniform_level > 0)
      throw Error("the curvature tolerance acts on level 0; leave out the uniform level");
    if (!pyramid.spec().has_curvature)
      throw Error(
          "'" + pyramid.path() + "' holds no curvature; build it with curvature to use a tolerance",
          {.path = pyramid.path()}, {Remedy::kBuildWithCurvature});
  }
  if (query.box)
    for (int axis = 0; axis < 3; ++axis)
      if (!(query.box->min[axis] < query.box->max[axis]))
        throw Error("the box is empty; its first corner must be below its second on every axis");
}

ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels) {
  ExtractionReport report;
  for (const LevelCounts& counts : levels) {
    report.triangles += counts.triangles;
    if (counts.triangles > 0) report.levels.push_back(counts);
  }
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 bricks = pyramid.layout().bricks(level);
    Index3 brick;
    for (brick.z = 0; brick.z < bricks.z; ++brick.z)
      for (brick.y = 0; brick.y < bricks.y; ++brick.y)
        for (brick.x = 0; brick.x < bricks.x; ++brick.x) {
          const std::size_t row = pyramid.brickRow(level, brick);
          if (!log.hasAny(row)) continue;
          ++report.bricks_read;
          if (log.has(row, ReadLog::kActive)) {
            ++report.bricks_active;
            report.bytes_active += pyramid.sampleBytes(level, brick);
          }
          if (log.has(row, ReadLog::kSamples))
            report.bytes_read += pyramid.sampleBytes(level, brick);
          if (log.has(row, ReadLog::kRanges)) report.bytes_read += pyramid.rangeBytes(level, brick);
          if (log.has(row, ReadLog::kCurvature)) report.bytes_read += pyramid.curvatureBytes(brick);
        }
  }
  return report;
}

}  // namespace

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink) {
  checkQuery(pyramid, query);
  const FocusOracle focus(pyramid.lattice(), query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log(pyramid.brickCount());
  const MeshContext context{pyramid, query, focus, frame, static_cast<float>(query.isovalue), log};
  const std::vector<BrickWork> work = traverseBricks(context);

  struct Worker {
    UniformMesher uniform;
    AdaptiveMesher adaptive;
  };
  tbb::enumerable_thread_specific<Worker> workers;
  // Batches go round: from here to a mesher, in the order of the work to the sink, and back.
  const auto in_flight =
      kBatchesPerThread * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  std::vector<std::unique_ptr<MeshBatch>> batches(in_flight);
  tbb::concurrent_queue<MeshBatch*> idle;
  for (auto& batch : batches) {
    batch = std::make_unique<MeshBatch>();
    idle.push(batch.get());
  }
  struct Job {
    std::size_t work = 0;
    MeshBatch* batch = nullptr;
  };
  std::vector<LevelCounts> counts(static_cast<std::size_t>(pyramid.lattice().levels()));
  for (std::size_t level = 0; level < counts.size(); ++level)
    counts[level].level = static_cast<int>(level);

  sink.begin({pyramid.spec().geometry, pyramid.spec().voxels});
  std::size_t next = 0;
  const auto take = [&](tbb::flow_control& control) -> Job {
    if (next == work.size() || (query.cancel != nullptr && query.cancel->requested())) {
      control.stop();
      return {};
    }
    // The pipeline lets no more than in_flight jobs run, so one batch is always idle.
    MeshBatch* batch = nullptr;
    while (!idle.try_pop(batch)) {
    }
    return {next++, batch};
  };
  const auto mesh = [&](Job job) -> Job {
    const BrickWork& item = work[job.work];
    job.batch->clear();
    job.batch->level = item.level;
    job.batch->fraction_done = static_cast<double>(job.work + 1) / static_cast<double>(work.size());
    Worker& worker = workers.local();
    if (item.adaptive)
      worker.adaptive.mesh(context, item, *job.batch);
    else
      worker.uniform.mesh(context, item, *job.batch);
    pyramid.throwIfReadsFailed();
    return job;
  };
  const auto deliver = [&](Job job) {
    const MeshBatch& batch = *job.batch;
    if (!batch.triangles.empty()) {
      log.note(pyramid.brickRow(batch.level, work[job.work].brick), ReadLog::kActive);
      LevelCounts& level = counts[static_cast<std::size_t>(batch.level)];
      level.cells += batch.cells;
      level.transition_cells += batch.transition_cells;
      level.triangles += batch.triangles.size() / 3;
      sink.accept(batch);
    }
    idle.push(job.batch);
  };
  tbb::parallel_pipeline(
      in_flight, tbb::make_filter<void, Job>(tbb::filter_mode::serial_in_order, take) &
                     tbb::make_filter<Job, Job>(tbb::filter_mode::parallel, mesh) &
                     tbb::make_filter<Job, void>(tbb::filter_mode::serial_in_order, deliver));
  if (query.cancel != nullptr) query.cancel->check();
  sink.finish();
  return makeReport(pyramid, log, counts);
}

}  // namespace isobrick
