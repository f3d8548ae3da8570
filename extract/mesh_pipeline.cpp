#include "isobrick/extract/mesh_pipeline.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <chrono>

#include "isobrick/extract/read_ahead.h"

namespace isobrick {
namespace {

// Batches that may wait for their turn, for every thread.
constexpr std::size_t kBatchesPerThread = 4;

struct Job {
  std::size_t work = 0;
  PlacedBatch* batch = nullptr;  // null where it was cancelled before it was meshed
  std::uint64_t bytes = 0;       // of the batch, once it is meshed
};

// Of memory, in use or not.
std::uint64_t keptBytes(const PlacedBatch& placed) {
  const auto of = [](const auto& elements) { return elements.capacity() * sizeof elements[0]; };
  return of(placed.batch.positions) + of(placed.batch.normals) + of(placed.batch.triangles) +
         of(placed.batch.shared) + of(placed.known) + of(placed.numbers) + of(placed.bytes) +
         of(placed.world) + of(placed.values);
}

}  // namespace

BatchRing::BatchRing(std::size_t count) {
  while (batches_.size() < count) batches_.push_back(std::make_unique<PlacedBatch>());
}

void BatchRing::begin() {
  const std::lock_guard lock(mutex_);
  if (idle_.size() < batches_.size()) {
    idle_.clear();
    idle_bytes_ = 0;
    for (const auto& batch : batches_) {
      idle_.push_back(batch.get());
      idle_bytes_ += keptBytes(*batch);
    }
  }
  bytes_ = placed_ = 0;
  has_failed_ = false;
}

PlacedBatch* BatchRing::take() {
  const std::lock_guard lock(mutex_);
  PlacedBatch* const batch = idle_.back();
  idle_.pop_back();
  idle_bytes_ -= keptBytes(*batch);
  return batch;
}

bool BatchRing::waitForRoom(std::size_t work, const CancelFlag* cancel) {
  // A signal handler can set the flag and nothing more, so nobody wakes this thread.
  constexpr auto kBetweenLooks = std::chrono::milliseconds(1);
  const auto is_cancelled = [&] { return cancel != nullptr && cancel->requested(); };
  std::unique_lock lock(mutex_);
  while (bytes_ > kMostBytes && work > placed_ && !has_failed_ && !is_cancelled())
    changed_.wait_for(lock, kBetweenLooks);
  return !has_failed_ && !is_cancelled();
}

void BatchRing::add(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  bytes_ += bytes;
}

void BatchRing::notePlaced(std::size_t work) {
  {
    const std::lock_guard lock(mutex_);
    placed_ = work;
  }
  changed_.notify_all();
}

void BatchRing::giveBack(PlacedBatch* batch, std::uint64_t bytes) {
  {
    const std::lock_guard lock(mutex_);
    bytes_ -= bytes;
    if (idle_bytes_ + keptBytes(*batch) > kMostBytes) *batch = PlacedBatch();
    idle_bytes_ += keptBytes(*batch);
    idle_.push_back(batch);
  }
  changed_.notify_all();
}

void BatchRing::fail() {
  {
    const std::lock_guard lock(mutex_);
    has_failed_ = true;
  }
  changed_.notify_all();
}

void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts) {
  const auto in_flight =
      kBatchesPerThread * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  BatchRing& ring = memory.ringOf(in_flight);
  ring.begin();
  std::size_t next = 0;
  ReadAhead ahead(context, work);
  // An exception ends the pipeline, and nobody may wait for the job that threw it.
  const auto failing = [&](const auto& body) {
    return [&](Job job) {
      try {
        return body(job);
      } catch (...) {
        ring.fail();
        throw;
      }
    };
  };

  const auto take = [&](tbb::flow_control& control) -> Job {
    if (next == work.size() || context.isCancelled()) {
      control.stop();
      return {};
    }
    return {next++, nullptr, 0};
  };
  const auto mesh = [&](Job job) {
    if (!ring.waitForRoom(job.work, context.query.cancel)) return job;
    job.batch = ring.take();
    MeshBatch& batch = job.batch->batch;
    batch.clear();
    ahead.reached(job.work);
    batch.level = work[job.work].level;
    batch.fraction_done = static_cast<double>(job.work + 1) / static_cast<double>(work.size());
    MeshWorker& worker = memory.workers.local();
    try {
      if (work[job.work].adaptive)
        worker.adaptive.mesh(context, work[job.work], batch);
      else
        worker.uniform.mesh(context, work[job.work], batch);
    } catch (const Cancelled&) {  // no exception of the pipeline, which would lose its batches
      batch.clear();
    }
    context.throwIfReadsFailed();
    job.bytes = batch.bytes();
    ring.add(job.bytes);
    return job;
  };
  const auto place = [&](Job job) {
    ring.notePlaced(job.work + 1);
    if (job.batch == nullptr) return job;
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
    if (job.batch == nullptr) return;
    if (!job.batch->batch.triangles.empty() && !context.isCancelled()) sink.write(*job.batch);
    ring.giveBack(job.batch, job.bytes);
  };
  // Isolated: a caller's task group that is cancelled would end the pipeline without an exception,
  // and half a mesh would look whole.
  tbb::task_group_context isolated(tbb::task_group_context::isolated);
  tbb::parallel_pipeline(
      in_flight,
      tbb::make_filter<void, Job>(tbb::filter_mode::serial_in_order, take) &
          tbb::make_filter<Job, Job>(tbb::filter_mode::parallel, failing(mesh)) &
          tbb::make_filter<Job, Job>(tbb::filter_mode::serial_in_order, failing(place)) &
          tbb::make_filter<Job, void>(tbb::filter_mode::parallel, failing(write)),
      isolated);
}

}  // namespace isobrick
