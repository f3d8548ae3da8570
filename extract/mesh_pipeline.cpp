#include "isobrick/extract/mesh_pipeline.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include "isobrick/extract/read_ahead.h"

namespace isobrick {
namespace {

// Batches that may wait for their turn, for every thread.
constexpr std::size_t kBatchesPerThread = 4;

struct Job {
  std::size_t work = 0;
  PlacedBatch* batch = nullptr;
};

}  // namespace

BatchRing::BatchRing(std::size_t count) {
  while (batches_.size() < count) {
    batches_.push_back(std::make_unique<PlacedBatch>());
    idle_.push(batches_.back().get());
  }
}

PlacedBatch* BatchRing::take() {
  PlacedBatch* batch = nullptr;
  while (!idle_.try_pop(batch)) {
  }
  return batch;
}

void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts) {
  const auto in_flight =
      kBatchesPerThread * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  BatchRing& ring = memory.ringOf(in_flight);
  std::size_t next = 0;
  ReadAhead ahead(context, work);

  const auto take = [&](tbb::flow_control& control) -> Job {
    if (next == work.size() || context.isCancelled()) {
      control.stop();
      return {};
    }
    return {next++, ring.take()};
  };
  const auto mesh = [&](Job job) {
    MeshBatch& batch = job.batch->batch;
    batch.clear();
    if (context.isCancelled()) return job;
    ahead.reached(job.work);
    batch.level = work[job.work].level;
    batch.fraction_done = static_cast<double>(job.work + 1) / static_cast<double>(work.size());
    MeshWorker& worker = memory.workers.local();
    if (work[job.work].adaptive)
      worker.adaptive.mesh(context, work[job.work], batch);
    else
      worker.uniform.mesh(context, work[job.work], batch);
    context.throwIfReadsFailed();
    return job;
  };
  const auto place = [&](Job job) {
    const MeshBatch& batch = job.batch->batch;
    const BrickWork& item = work[job.work];
    if (batch.triangles.empty() || context.isCancelled()) return job;
    context.read_log.note(context.pyramid.brickRow(item.level, item.brick), ReadLog::kActive);
    LevelCounts& level = counts[static_cast<std::size_t>(item.level)];
    level.cells += batch.cells;
    level.transition_cells += batch.transition_cells;
    level.triangles += batch.triangles.size() / 3;
    sink.place(*job.batch);
    return job;
  };
  const auto write = [&](Job job) {
    if (!job.batch->batch.triangles.empty() && !context.isCancelled()) sink.write(*job.batch);
    ring.giveBack(job.batch);
  };
  memory.ring_is_whole = false;
  // Isolated: a caller's task group that is cancelled would end the pipeline without an exception,
  // and half a mesh would look whole.
  tbb::task_group_context isolated(tbb::task_group_context::isolated);
  tbb::parallel_pipeline(in_flight,
                         tbb::make_filter<void, Job>(tbb::filter_mode::serial_in_order, take) &
                             tbb::make_filter<Job, Job>(tbb::filter_mode::parallel, mesh) &
                             tbb::make_filter<Job, Job>(tbb::filter_mode::serial_in_order, place) &
                             tbb::make_filter<Job, void>(tbb::filter_mode::parallel, write),
                         isolated);
  memory.ring_is_whole = true;
}

}  // namespace isobrick
