// Bricks meshed in parallel and passed on in order.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "isobrick/extract/meshing/adaptive_mesher.h"
#include "isobrick/extract/meshing/uniform_mesher.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/simplify/batch_group.h"
#include "isobrick/extract/simplify/batch_simplifier.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// The working memory of one thread.
struct MeshWorker {
  UniformMesher uniform;
  AdaptiveMesher adaptive;
  BatchSimplifier simplifier;
};

// Batches that are reused: they go to a mesher, in the order of the work to their receiver, and
// back. The batch that came back last is taken first, so that no more of them grow than are in use
// at once. Used by one thread at a time.
class BatchRing {
 public:
  // The most bytes that idle batches keep.
  static constexpr std::uint64_t kMostIdleBytes = std::uint64_t{16} << 20;

  explicit BatchRing(std::size_t count);
  std::size_t size() const { return batches_.size(); }

  // All are idle, those too that an exception kept from coming back.
  void begin();
  bool hasIdle() const { return !idle_.empty(); }
  PlacedBatch* take();
  void giveBack(PlacedBatch* batch);

 private:
  std::vector<std::unique_ptr<PlacedBatch>> batches_;
  std::vector<PlacedBatch*> idle_;
  std::uint64_t idle_bytes_ = 0;  // that they keep
};

// Decides the next task of a thread. Bricks 0, 1, 2, ... are meshed by any threads, placed in their
// order by one at a time, and written by any. Groups, which come up when bricks are placed, go the
// same way beside them, in the order in which they came.
//
// No brick is begun while what is made and not written yet holds more than kMostBytes; one batch
// for each thread comes on top. A job that was begun never waits for room, so there is always one
// that goes on. All members are thread-safe.
class JobBoard {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{16} << 20;

  struct Job {
    std::size_t number = 0;             // among the bricks, or among the groups
    PlacedBatch* batch = nullptr;       // of a brick
    std::shared_ptr<BatchGroup> group;  // or the group
    std::uint64_t bytes = 0;            // that count for it

    PlacedBatch& placed() const { return group != nullptr ? group->placed : *batch; }
  };
  enum class Step { kMake, kPlace, kWrite, kEnd };
  struct Task {
    Step step = Step::kEnd;
    Job job;
  };

  // `ring` has as many batches as bricks may be under way; `cancel` may be null. Both outlive it.
  JobBoard(BatchRing& ring, std::size_t bricks, const CancelFlag* cancel)
      : ring_(ring), bricks_(bricks), cancel_(cancel) {
    ring_.begin();
  }

  // Waits for something to do. kEnd if no task is left for this thread: all jobs are placed, those
  // that were begun before a request to cancel are, or fail() was called.
  Task next();
  // Reports a task of next() as done.
  void finish(Task task);
  // Before a task is reported as done.
  void add(GroupSorter::Groups groups);
  // Ends all waiting; no task is given out any more.
  void fail();

 private:
  // Jobs of one kind.
  struct Line {
    std::size_t begun = 0, placed = 0;
    std::map<std::size_t, Job> made;  // and not placed, by number
  };
  Line& lineOf(const Job& job) { return job.group != nullptr ? of_groups_ : of_bricks_; }
  void change(const auto& how) {
    {
      const std::lock_guard lock(mutex_);
      how();
    }
    changed_.notify_all();
  }
  bool isCancelled() const { return cancel_ != nullptr && cancel_->requested(); }
  bool isAllDone() const;
  std::optional<Task> taskAtHand();

  BatchRing& ring_;
  const std::size_t bricks_;
  const CancelFlag* const cancel_;
  std::mutex mutex_;  // guards all below, and the ring
  std::condition_variable changed_;
  Line of_bricks_, of_groups_;
  bool is_placing_ = false, has_failed_ = false;
  std::deque<Job> groups_to_make_, to_write_;
  std::uint64_t bytes_ = 0;  // of what is made and not written
};

// The memory that stays from query to query. Serves one query at a time.
struct MeshMemory {
  tbb::enumerable_thread_specific<MeshWorker> workers;
  std::unique_ptr<BatchRing> ring;

  BatchRing& ringOf(std::size_t batches) {
    if (ring == nullptr || ring->size() != batches) ring = std::make_unique<BatchRing>(batches);
    return *ring;
  }
};

// Which part of all bricks some work is: from where to where, all being 0 .. 1.
struct WorkPart {
  double begin = 0, end = 1;

  double at(double share) const { return begin + share * (end - begin); }
};

// The groups of a query that simplifies them while it is meshed, or null. With groups the work is
// in the order of the brick table.
std::unique_ptr<GroupSorter> makeGroupSorter(const MeshContext& context, const TriangleSink& sink);

// Meshes all of `work` on the calling TBB arena. Batches with triangles are counted in
// `counts[level]`, noted as active, and passed to the sink: place() in the order of the work, then
// write(). With `groups`, these are passed on in their place, the last ones when `part` ends.
// Batches are reused, so memory does not grow with the mesh: if the sink is slow, or batches are
// large, no more are begun. Stops early, without an exception, if the query is cancelled. Rethrows
// the exceptions of meshers and of the sink.
void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts, GroupSorter* groups,
                 const WorkPart& part = {});

}  // namespace isobrick
