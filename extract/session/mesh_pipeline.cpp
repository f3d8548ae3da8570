#include "isobrick/extract/session/mesh_pipeline.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <utility>

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
  const auto takeFirst = [](std::deque<Job>& jobs, Step step) {
    Task task{step, std::move(jobs.front())};
    jobs.pop_front();
    return task;
  };
  if (!to_write_.empty()) return takeFirst(to_write_, Step::kWrite);
  for (Line* const line : {&of_bricks_, &of_groups_}) {
    if (is_placing_ || !line->made.contains(line->placed)) continue;
    is_placing_ = true;
    return Task{Step::kPlace, std::move(line->made.extract(line->placed).mapped())};
  }
  if (isCancelled()) return std::nullopt;
  if (!groups_to_make_.empty()) return takeFirst(groups_to_make_, Step::kMake);
  if (of_bricks_.begun == bricks_ || bytes_ > kMostBytes || !ring_.hasIdle()) return std::nullopt;
  return Task{Step::kMake, {of_bricks_.begun++, ring_.take(), nullptr, 0}};
}

bool JobBoard::isAllDone() const {
  return of_bricks_.placed == of_bricks_.begun &&
         (isCancelled() || (of_bricks_.begun == bricks_ && of_groups_.placed == of_groups_.begun));
}

void JobBoard::finish(Task task) {
  change([&] {
    Job& job = task.job;
    Line& line = lineOf(job);
    if (task.step == Step::kMake) {
      const std::uint64_t made = job.group ? job.group->bytes() : job.batch->batch.bytes();
      bytes_ += made - std::exchange(job.bytes, made);
      line.made.emplace(job.number, std::move(job));
    } else if (task.step == Step::kPlace) {
      is_placing_ = false;
      ++line.placed;
      to_write_.push_back(std::move(job));
    } else if (task.step == Step::kWrite) {
      bytes_ -= job.bytes;
      if (job.group == nullptr) ring_.giveBack(job.batch);
    }
  });
}

void JobBoard::add(GroupSorter::Groups groups) {
  change([&] {
    for (std::unique_ptr<BatchGroup>& group : groups) {
      const std::uint64_t bytes = group->bytes();
      bytes_ += bytes;
      groups_to_make_.push_back({of_groups_.begun++, nullptr, std::move(group), bytes});
    }
  });
}

void JobBoard::fail() {
  change([&] { has_failed_ = true; });
}

std::unique_ptr<GroupSorter> makeGroupSorter(const MeshContext& context, const TriangleSink& sink) {
  if (!simplifiesGroups(context.query) || sink.takesRemains()) return nullptr;
  return std::make_unique<GroupSorter>(context.pyramid.layout().brickCells());
}

namespace {

// The bricks of some work on their way to a sink; each member is a step of a job.
class BrickLine {
 public:
  BrickLine(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
            TriangleSink& sink, std::vector<LevelCounts>& counts, GroupSorter* groups,
            const WorkPart& part)
      : context_(context),
        work_(work),
        memory_(memory),
        sink_(sink),
        counts_(counts),
        groups_(groups),
        part_(part),
        threads_(tbb::this_task_arena::max_concurrency()),
        board_(memory.ringOf(kBatchesPerThread * static_cast<std::size_t>(threads_)), work.size(),
               context.query.cancel),
        ahead_(context, work),
        keeps_remains_(simplifiesGroups(context.query)) {
    if (context.query.simplify)
      space_ = SimplifySpace::of(*context.query.simplify, context.pyramid.spec().geometry,
                                 context.pyramid.spec().voxels);
  }

  void run() {
    if (work_.empty()) endGroups();
    isolatedForEach(0, threads_, [&](int) {
      try {
        for (auto task = board_.next(); task.step != JobBoard::Step::kEnd; task = board_.next()) {
          if (task.step == JobBoard::Step::kMake) make(task.job);
          if (task.step == JobBoard::Step::kPlace) place(task.job);
          if (task.step == JobBoard::Step::kWrite) write(task.job);
          board_.finish(std::move(task));
        }
      } catch (...) {
        board_.fail();
        throw;
      }
    });
  }

 private:
  // A sink that waits for tasks of its own must not begin one that waits for this sink.
  static void give(const auto& call) { tbb::this_task_arena::isolate(call); }
  // Bricks that become groups do not reach the sink themselves.
  bool isForSink(const JobBoard::Job& job) const {
    return groups_ == nullptr || job.group != nullptr;
  }

  void make(const JobBoard::Job& job) {
    PlacedBatch& placed = job.placed();
    if (job.group == nullptr) ahead_.reached(job.number);
    try {
      if (job.group != nullptr)
        memory_.workers.local().simplifier.simplifyGroup(*space_, context_.query.cancel,
                                                         *job.group);
      else
        mesh(work_[job.number], placed);
      if (isForSink(job) && !placed.batch.triangles.empty()) give([&] { sink_.prepare(placed); });
    } catch (const Cancelled&) {
      placed.batch.clear();
    }
    if (job.group != nullptr) return;
    context_.throwIfReadsFailed();
    context_.noteDone(shareOf(++meshed_));
  }

  void mesh(const BrickWork& work, PlacedBatch& placed) {
    MeshBatch& batch = placed.batch;
    batch.clear();
    batch.level = work.level;
    batch.brick = work.brick;
    batch.is_uniform = !work.adaptive;
    batch.fraction_done = shareOf(static_cast<std::size_t>(&work - work_.data()) + 1);
    MeshWorker& worker = memory_.workers.local();
    if (work.adaptive)
      worker.adaptive.mesh(context_, work, batch);
    else
      worker.uniform.mesh(context_, work, batch);
    if (context_.region != nullptr && context_.query.cap)
      solids_.local().move(batch);
    else if (context_.region != nullptr)
      cutters_.local().cut(batch);
    if (keeps_remains_ && placed.remains == nullptr)
      placed.remains = std::make_shared<SimplifyRemains>();
    if (space_)
      worker.simplifier.simplify(*space_, context_.query.cancel, batch,
                                 keeps_remains_ ? placed.remains.get() : nullptr);
  }

  void place(const JobBoard::Job& job) {
    PlacedBatch& placed = job.placed();
    const MeshBatch& batch = placed.batch;
    LevelCounts& level = counts_[static_cast<std::size_t>(batch.level)];
    if (!batch.triangles.empty() && !context_.isCancelled()) {
      if (job.group == nullptr) {
        context_.read_log.note(context_.pyramid.parts().brickRow(batch.level, batch.brick),
                               ReadLog::kActive);
        level.cells += batch.cells;
        level.transition_cells += batch.transition_cells;
      }
      if (isForSink(job)) {
        level.triangles += batch.triangles.size() / 3;
        level.cap_triangles += batch.cap_indices / 3;
        give([&] { sink_.place(placed); });
      } else {
        board_.add(groups_->add(placed));
      }
    }
    if (job.group == nullptr && job.number + 1 == work_.size()) endGroups();
  }

  void write(const JobBoard::Job& job) {
    PlacedBatch& placed = job.placed();
    if (isForSink(job) && !placed.batch.triangles.empty() && !context_.isCancelled())
      give([&] { sink_.write(placed); });
  }

  // When there is nothing more to place.
  void endGroups() {
    if (groups_ != nullptr && part_.end == 1) board_.add(groups_->takeRest());
  }
  // Of all bricks, when so many of the work are done.
  double shareOf(std::size_t bricks) const {
    return part_.at(static_cast<double>(bricks) / static_cast<double>(work_.size()));
  }

  const MeshContext& context_;
  const std::span<const BrickWork> work_;
  MeshMemory& memory_;
  TriangleSink& sink_;
  std::vector<LevelCounts>& counts_;
  GroupSorter* const groups_;
  const WorkPart part_;
  const int threads_;
  JobBoard board_;
  ReadAhead ahead_;
  const bool keeps_remains_;
  std::optional<SimplifySpace> space_;
  std::atomic<std::size_t> meshed_{0};
  tbb::enumerable_thread_specific<RegionCutter> cutters_{
      [this] { return RegionCutter(*context_.region, context_.query.cancel); }};
  tbb::enumerable_thread_specific<SolidCrossings> solids_{[this] {
    return SolidCrossings(*context_.region, context_.pyramid.spec().geometry,
                          context_.query.cancel);
  }};
};

}  // namespace

void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts, GroupSorter* groups,
                 const WorkPart& part) {
  BrickLine(context, work, memory, sink, counts, groups, part).run();
}

}  // namespace isobrick
