#include "isobrick/extract/session/mesh_pipeline.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <glm/matrix.hpp>

#include "isobrick/extract/paging/read_ahead.h"
#include "isobrick/storage/isolated_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

// Batches that may wait for their turn, for every thread: one brick may take as long as many others
// do.
constexpr std::size_t kBatchesPerThread = 16;

// Bytes of its memory, in use or not.
std::uint64_t keptBytes(const PlacedBatch& placed) {
  const auto of = [](const auto& elements) { return elements.capacity() * sizeof elements[0]; };
  return of(placed.batch.positions) + of(placed.batch.normals) + of(placed.batch.triangles) +
         of(placed.batch.shared) + of(placed.known) + of(placed.numbers) + of(placed.bytes) +
         of(placed.world) + of(placed.values) + of(placed.components);
}

std::optional<SimplifySpace> simplifySpace(const MeshContext& context) {
  const std::optional<SimplifyOptions>& options = context.query.simplify;
  if (!options) return std::nullopt;
  // The world in units of the least spacing: squares of squares of its own might leave the floats.
  const glm::dvec3& spacing = context.pyramid.spec().geometry.spacing;
  const double unit = context.pyramid.spec().geometry.leastSpacing();
  SimplifySpace space{.distance = static_cast<float>(options->in_world ? options->distance / unit
                                                                       : options->distance),
                      .drops_small = options->drop_small};
  if (spacing == glm::dvec3(unit)) return space;
  // Turned as the index axes are.
  const glm::dmat3 to_space(glm::dvec3(spacing.x / unit, 0, 0), glm::dvec3(0, spacing.y / unit, 0),
                            glm::dvec3(0, 0, spacing.z / unit));
  space.to_space = to_space;
  space.to_voxels = glm::inverse(to_space);
  return space;
}

}  // namespace

BatchRing::BatchRing(std::size_t count) {
  while (batches_.size() < count) batches_.push_back(std::make_unique<PlacedBatch>());
}

void BatchRing::begin() {
  if (idle_.size() == batches_.size()) return;
  idle_.clear();
  idle_bytes_ = 0;
  for (const auto& batch : batches_) giveBack(batch.get());
}

PlacedBatch* BatchRing::take() {
  PlacedBatch* const batch = idle_.back();
  idle_.pop_back();
  idle_bytes_ -= keptBytes(*batch);
  return batch;
}

void BatchRing::giveBack(PlacedBatch* batch) {
  if (idle_bytes_ + keptBytes(*batch) > kMostIdleBytes) *batch = PlacedBatch();
  idle_bytes_ += keptBytes(*batch);
  idle_.push_back(batch);
}

JobBoard::JobBoard(BatchRing& ring, std::size_t jobs, const CancelFlag* cancel)
    : ring_(ring), jobs_(jobs), cancel_(cancel), meshed_(ring.size()) {
  ring_.begin();
}

JobBoard::Task JobBoard::next() {
  // A signal handler can only set the flag, so no call wakes this thread.
  constexpr auto kBetweenLooks = std::chrono::milliseconds(1);
  std::unique_lock lock(mutex_);
  while (true) {
    if (has_failed_) return {};
    if (auto task = taskAtHand()) return *task;
    if (isAllDone()) return {};
    if (cancel_ == nullptr)
      changed_.wait(lock);
    else
      changed_.wait_for(lock, kBetweenLooks);
  }
}

// Tasks that make room come first.
std::optional<JobBoard::Task> JobBoard::taskAtHand() {
  if (!to_write_.empty()) {
    const Task task{Step::kWrite, to_write_.front()};
    to_write_.pop_front();
    return task;
  }
  std::optional<Job>& first = meshed_[placed_ % meshed_.size()];
  if (!is_placing_ && first) {
    is_placing_ = true;
    const Task task{Step::kPlace, *first};
    first.reset();
    return task;
  }
  const bool is_cancelled = cancel_ != nullptr && cancel_->requested();
  if (begun_ == jobs_ || is_cancelled || bytes_ > kMostBytes || !ring_.hasIdle())
    return std::nullopt;
  return Task{Step::kMesh, {begun_++, ring_.take(), 0}};
}

bool JobBoard::isAllDone() const {
  const bool is_cancelled = cancel_ != nullptr && cancel_->requested();
  return placed_ == begun_ && (begun_ == jobs_ || is_cancelled);
}

void JobBoard::finish(const Task& task) {
  {
    const std::lock_guard lock(mutex_);
    switch (task.step) {
      case Step::kMesh:
        bytes_ += task.job.bytes;
        meshed_[task.job.work % meshed_.size()] = task.job;
        break;
      case Step::kPlace:
        is_placing_ = false;
        ++placed_;
        to_write_.push_back(task.job);
        break;
      case Step::kWrite:
        bytes_ -= task.job.bytes;
        ring_.giveBack(task.job.batch);
        break;
      case Step::kEnd:
        break;
    }
  }
  changed_.notify_all();
}

void JobBoard::fail() {
  {
    const std::lock_guard lock(mutex_);
    has_failed_ = true;
  }
  changed_.notify_all();
}

void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts, const WorkPart& part) {
  const int threads = tbb::this_task_arena::max_concurrency();
  JobBoard board(memory.ringOf(kBatchesPerThread * static_cast<std::size_t>(threads)), work.size(),
                 context.query.cancel);
  ReadAhead ahead(context, work);
  const std::optional<SimplifySpace> space = simplifySpace(context);

  // A sink that waits for tasks of its own must not begin one that waits for this sink.
  const auto give = [](const auto& call) { tbb::this_task_arena::isolate(call); };
  std::atomic<std::size_t> meshed{0};
  const auto mesh = [&](JobBoard::Job& job) {
    MeshBatch& batch = job.batch->batch;
    batch.clear();
    ahead.reached(job.work);
    batch.level = work[job.work].level;
    batch.brick = work[job.work].brick;
    batch.is_uniform = !work[job.work].adaptive;
    batch.fraction_done =
        part.at(static_cast<double>(job.work + 1) / static_cast<double>(work.size()));
    MeshWorker& worker = memory.workers.local();
    try {
      if (work[job.work].adaptive)
        worker.adaptive.mesh(context, work[job.work], batch);
      else
        worker.uniform.mesh(context, work[job.work], batch);
      if (space) worker.simplifier.simplify(*space, context.query.cancel, batch);
      if (!batch.triangles.empty()) give([&] { sink.prepare(*job.batch); });
    } catch (const Cancelled&) {
      batch.clear();
    }
    context.throwIfReadsFailed();
    context.noteDone(part.at(static_cast<double>(++meshed) / static_cast<double>(work.size())));
    job.bytes = batch.bytes();
  };
  const auto place = [&](const JobBoard::Job& job) {
    const MeshBatch& batch = job.batch->batch;
    const BrickWork& item = work[job.work];
    if (batch.triangles.empty() || context.isCancelled()) return;
    context.read_log.note(context.pyramid.parts().brickRow(item.level, item.brick),
                          ReadLog::kActive);
    LevelCounts& level = counts[static_cast<std::size_t>(item.level)];
    level.cells += batch.cells;
    level.transition_cells += batch.transition_cells;
    level.triangles += batch.triangles.size() / 3;
    level.cap_triangles += batch.cap_indices / 3;
    give([&] { sink.place(*job.batch); });
  };
  const auto write = [&](const JobBoard::Job& job) {
    if (!job.batch->batch.triangles.empty() && !context.isCancelled())
      give([&] { sink.write(*job.batch); });
  };
  const auto workOn = [&](int) {
    try {
      for (auto task = board.next(); task.step != JobBoard::Step::kEnd; task = board.next()) {
        if (task.step == JobBoard::Step::kMesh) mesh(task.job);
        if (task.step == JobBoard::Step::kPlace) place(task.job);
        if (task.step == JobBoard::Step::kWrite) write(task.job);
        board.finish(task);
      }
    } catch (...) {
      board.fail();
      throw;
    }
  };
  isolatedForEach(0, threads, workOn);
}

}  // namespace isobrick
