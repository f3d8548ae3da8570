#include "isobrick/extract/session/mesh_pipeline.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>

#include "isobrick/extract/paging/read_ahead.h"
#include "isobrick/extract/region/region_cutter.h"
#include "isobrick/extract/region/region_solid.h"
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
  if (!context.query.simplify) return std::nullopt;
  return SimplifySpace::of(*context.query.simplify, context.pyramid.spec().geometry,
                           context.pyramid.spec().voxels);
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
  if (is_cancelled) return std::nullopt;
  if (!groups_to_do_.empty()) {
    Task task = std::move(groups_to_do_.front());
    groups_to_do_.pop_front();
    return task;
  }
  if (const auto next = groups_done_.find(groups_placed_);
      !is_placing_ && next != groups_done_.end()) {
    is_placing_ = true;
    Task task = std::move(next->second);
    groups_done_.erase(next);
    task.step = Step::kPlaceGroup;
    return task;
  }
  if (begun_ == jobs_ || bytes_ > kMostBytes || !ring_.hasIdle()) return std::nullopt;
  return Task{Step::kMesh, {begun_++, ring_.take(), 0}};
}

bool JobBoard::isAllDone() const {
  const bool is_cancelled = cancel_ != nullptr && cancel_->requested();
  return placed_ == begun_ && (is_cancelled || (begun_ == jobs_ && groups_placed_ == groups_));
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
      case Step::kSimplifyGroup:
        bytes_ += task.group->bytes();
        bytes_ -= task.bytes;
        groups_done_[task.number] = task;
        groups_done_[task.number].bytes = task.group->bytes();
        break;
      case Step::kPlaceGroup:
        is_placing_ = false;
        ++groups_placed_;
        groups_to_do_.push_front(task);
        groups_to_do_.front().step = Step::kWriteGroup;
        break;
      case Step::kWriteGroup:
        bytes_ -= task.bytes;
        break;
      case Step::kEnd:
        break;
    }
  }
  changed_.notify_all();
}

void JobBoard::add(GroupSorter::Groups groups) {
  {
    const std::lock_guard lock(mutex_);
    for (std::unique_ptr<BatchGroup>& group : groups) {
      const std::uint64_t bytes = group->bytes();
      bytes_ += bytes;
      groups_to_do_.push_back({Step::kSimplifyGroup, {}, groups_++, std::move(group), bytes});
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

std::unique_ptr<GroupSorter> makeGroupSorter(const MeshContext& context, const TriangleSink& sink) {
  if (!simplifiesGroups(context.query) || sink.takesRemains()) return nullptr;
  return std::make_unique<GroupSorter>(context.pyramid.layout().brickCells());
}

void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts, GroupSorter* groups,
                 const WorkPart& part) {
  const int threads = tbb::this_task_arena::max_concurrency();
  JobBoard board(memory.ringOf(kBatchesPerThread * static_cast<std::size_t>(threads)), work.size(),
                 context.query.cancel);
  ReadAhead ahead(context, work);
  const std::optional<SimplifySpace> space = simplifySpace(context);
  const bool keeps_remains = simplifiesGroups(context.query);
  tbb::enumerable_thread_specific<RegionCutter> cutters(
      [&] { return RegionCutter(*context.region, context.query.cancel); });
  tbb::enumerable_thread_specific<SolidCrossings> solids([&] {
    return SolidCrossings(*context.region, context.pyramid.spec().geometry, context.query.cancel);
  });

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
      if (context.region != nullptr && context.query.cap)
        solids.local().move(batch);
      else if (context.region != nullptr)
        cutters.local().cut(batch);
      if (keeps_remains && job.batch->remains == nullptr)
        job.batch->remains = std::make_shared<SimplifyRemains>();
      if (space)
        worker.simplifier.simplify(*space, context.query.cancel, batch,
                                   keeps_remains ? job.batch->remains.get() : nullptr);
      if (!batch.triangles.empty() && groups == nullptr) give([&] { sink.prepare(*job.batch); });
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
    if (groups != nullptr) {
      board.add(groups->add(*job.batch));
      return;
    }
    level.triangles += batch.triangles.size() / 3;
    level.cap_triangles += batch.cap_indices / 3;
    give([&] { sink.place(*job.batch); });
  };
  const auto write = [&](const JobBoard::Job& job) {
    if (!job.batch->batch.triangles.empty() && groups == nullptr && !context.isCancelled())
      give([&] { sink.write(*job.batch); });
  };
  const auto simplify = [&](BatchGroup& group) {
    try {
      memory.workers.local().simplifier.simplifyGroup(*space, context.query.cancel, group);
      give([&] { sink.prepare(group.placed); });
    } catch (const Cancelled&) {
      group.placed.batch.clear();
    }
  };
  const auto placeGroup = [&](BatchGroup& group) {
    const MeshBatch& batch = group.placed.batch;
    if (batch.triangles.empty() || context.isCancelled()) return;
    counts[0].triangles += batch.triangles.size() / 3;
    counts[0].cap_triangles += batch.cap_indices / 3;
    give([&] { sink.place(group.placed); });
  };
  const auto writeGroup = [&](BatchGroup& group) {
    if (!group.placed.batch.triangles.empty() && !context.isCancelled())
      give([&] { sink.write(group.placed); });
  };
  // When there is nothing more to place.
  const auto endGroups = [&] {
    if (groups != nullptr && part.end == 1) board.add(groups->takeRest());
  };
  if (work.empty()) endGroups();
  const auto workOn = [&](int) {
    try {
      for (auto task = board.next(); task.step != JobBoard::Step::kEnd; task = board.next()) {
        using enum JobBoard::Step;
        if (task.step == kMesh) mesh(task.job);
        if (task.step == kPlace) {
          place(task.job);
          if (task.job.work + 1 == work.size()) endGroups();
        }
        if (task.step == kWrite) write(task.job);
        if (task.step == kSimplifyGroup) simplify(*task.group);
        if (task.step == kPlaceGroup) placeGroup(*task.group);
        if (task.step == kWriteGroup) writeGroup(*task.group);
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
