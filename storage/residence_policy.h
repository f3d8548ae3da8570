// Decides which part goes when the budget is exceeded.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace isobrick {

// Queries read a file in the same order again and again, each taking most parts of the one before
// (an isovalue that is moved, a focus that wanders). If such a cycle exceeds the budget, a queue of
// the least recently used keeps just the parts that are needed last, and no part is there when it
// is needed; the queues of S3-FIFO are little better, as parts return after more others than they
// remember. The best choice is to let the newest go, as it is needed last. So:
//
//   settled   parts that stay as long as queries take them
//   arrivals  parts that came in lately: a sixteenth of the budget, or what is left over by the
//             settled; they serve for what is taken twice within a query, and the oldest goes
//
// An arrival settles if there is room among the settled. A settled part that neither this query nor
// the one before took is stale: it goes first, and makes that room. All parts are examined once a
// query for that.
//
// Kinds and levels are treated alike: to let ranges or coarse levels go last made traces of sweeps,
// focus points and dragging read 6 % less to 17 % more (docs/lab.md).
//
// While no query was announced nothing settles, and the part that was taken longest ago goes; one
// that was taken twice stays for one more round.
//
// Taking a part again moves nothing and only leaves a note with its owner, so it takes no lock of
// this object. Allocates nothing. Used by one thread at a time.
class ResidencePolicy {
 public:
  // A part that may go, as a member of its owner's record. Changed by the policy alone.
  struct Member {
    std::uint64_t id = 0;
    std::uint64_t bytes = 0;  // its cost
    Member* newer = nullptr;
    Member* older = nullptr;
  };
  // Which of the idle parts is meant: any, one that was not read ahead for this query, one that was
  // not taken since the last call either, or a stale one.
  enum class Which { kAny, kNotAhead, kTakenOnce, kStale };

  explicit ResidencePolicy(std::uint64_t budget_bytes)
      : most_settled_bytes_(budget_bytes - budget_bytes / 16) {}

  void beginQuery() {
    has_queries_ = true;
    unlooked_ = settled_.count;
  }

  void add(Member& member) { pushNewest(arrivals_, member); }

  // Takes out the part that goes; nullptr if all are in use. The owner's `takes(member, which)`
  // returns true if it is such a part, and no thread can get it any more.
  template <typename F>
  Member* takeVictim(F&& takes) {
    for (; unlooked_ > 0; --unlooked_)
      if (Member* victim = takeOldest(settled_, Which::kStale, takes)) {
        --unlooked_;
        return victim;
      }
    // Twice round: for the notes, and for the parts that had one.
    for (std::size_t left = 2 * arrivals_.count; left > 0; --left) {
      if (has_queries_ && settles(*arrivals_.oldest)) {
        Member& member = *arrivals_.oldest;
        unlink(arrivals_, member);
        pushNewest(settled_, member);
        if (arrivals_.count == 0) break;
      } else if (Member* victim = takeOldest(arrivals_, Which::kTakenOnce, takes)) {
        return victim;
      }
    }
    for (const Which which : {Which::kNotAhead, Which::kAny})
      for (std::size_t left = settled_.count; left > 0; --left)
        if (Member* victim = takeOldest(settled_, which, takes)) return victim;
    return nullptr;
  }

  // Takes out members for which the owner's `takes(member)` is true, the oldest first, as long as
  // its `lacks()` is true. All others keep their places.
  template <typename Takes, typename Lacks>
  void takeWhile(Lacks&& lacks, Takes&& takes) {
    for (Queue* queue : {&arrivals_, &settled_})
      for (Member* member = queue->oldest; member != nullptr && lacks();) {
        Member* const newer = member->newer;
        if (takes(*member)) unlink(*queue, *member);
        member = newer;
      }
    unlooked_ = std::min(unlooked_, settled_.count);
  }

 private:
  struct Queue {
    Member* newest = nullptr;
    Member* oldest = nullptr;
    std::uint64_t bytes = 0;
    std::size_t count = 0;
  };

  bool settles(const Member& member) const {
    return settled_.bytes + member.bytes <= most_settled_bytes_;
  }

  // nullptr if the oldest may not go: then it is the newest.
  template <typename F>
  static Member* takeOldest(Queue& queue, Which which, F&& takes) {
    Member& member = *queue.oldest;
    const bool goes = takes(member, which);
    unlink(queue, member);
    if (goes) return &member;
    pushNewest(queue, member);
    return nullptr;
  }

  static void pushNewest(Queue& queue, Member& member) {
    member.newer = nullptr;
    member.older = queue.newest;
    (queue.newest != nullptr ? queue.newest->newer : queue.oldest) = &member;
    queue.newest = &member;
    queue.bytes += member.bytes;
    ++queue.count;
  }
  static void unlink(Queue& queue, Member& member) {
    (member.newer != nullptr ? member.newer->older : queue.newest) = member.older;
    (member.older != nullptr ? member.older->newer : queue.oldest) = member.newer;
    queue.bytes -= member.bytes;
    --queue.count;
  }

  const std::uint64_t most_settled_bytes_;
  Queue arrivals_, settled_;
  std::size_t unlooked_ = 0;  // settled ones that may be stale
  bool has_queries_ = false;
};

}  // namespace isobrick
