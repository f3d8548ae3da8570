// Reading the bricks of a plan ahead of the threads that mesh them.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <span>
#include <thread>
#include <unordered_set>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

// Some threads that fetch, in the order of the work, the tile ranges of bricks, and the samples of
// those in which a leaf may lie in a tile that the isosurface crosses; the rest (what bricks of
// another level lend to a mixed one) is left to the meshers. They begin at the first part that a
// mesher does not find, so that a query whose parts are all resident starts no thread, and not
// before a disk or a server has to be waited for: what the page cache has is unpacked by the mesher
// that needs it, into its own cache.
//
// Each brick is looked at: its ranges, which were announced to the system some bricks before, are
// fetched, and its samples announced if they are needed. Announced samples are fetched by the
// threads that find nothing to look at, so the disk always has as much to do at once as may be.
//
// A server answers many requests in the time of one, and none before a round trip. So of a pyramid
// behind a URL the threads begin with the query, whose parts come in two round trips, all ranges
// and then all samples, as far as the bound allows.
//
// Parts announced or fetched and not yet reached by the meshers are at most a thirty-second of
// the budget, half of what the pager has for arrivals, and no more than kMostBytes; if that is less
// than a brick, nothing is read ahead. A request to cancel the query, or the end of this object,
// ends the threads: each ends the part that it is at. Parts that they fetched and no mesher reached
// are then withdrawn.
//
// reached() may be called by any threads at once; the rest by one. Changes nothing of the mesh and
// nothing of the report.
class ReadAhead {
 public:
  // Enough for a disk that serves several requests at once; they wait more than they work.
  static constexpr std::size_t kThreads = 4;
  static constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20;
  // Samples that are announced and not being fetched yet: more gain nothing (docs/lab.md),
  // and what is announced cannot be taken back from the system.
  static constexpr std::size_t kMostAnnounced = 16;
  // Bricks whose ranges are announced before the first of them is looked at.
  static constexpr std::size_t kRangesAhead = 32;
  // The same two of a pyramid behind a URL.
  static constexpr std::size_t kMostAnnouncedFar = 512, kRangesAheadFar = 1024;

  ReadAhead(const MeshContext& context, std::span<const BrickWork> work);
  ~ReadAhead();
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;

  // A mesher is about to take this brick of the work.
  void reached(std::size_t work) {
    if (is_far_ || context_.pyramid.parts().missCount() != misses_before_) noteReached(work);
  }

 private:
  void noteReached(std::size_t work);
  bool isAheadCached();
  void start();
  void run();
  bool mayLook() const;
  void look(std::unique_lock<std::mutex>& lock);
  void load(std::unique_lock<std::mutex>& lock);
  bool isNeeded(const BrickWork& work) const;
  void addLenders(const BrickWork& work, std::vector<PyramidParts::PartAddress>& samples) const;

  const MeshContext& context_;
  const std::span<const BrickWork> work_;
  const std::uint64_t misses_before_;
  const bool is_far_;                             // behind a URL
  std::unordered_set<std::size_t> rows_of_work_;  // of such a one; whose ranges are announced

  std::mutex mutex_;  // guards all below
  std::condition_variable wake_;
  bool has_started_ = false, stops_ = false;
  std::size_t reached_ = 0;            // bricks before this one are with the meshers
  std::size_t cached_ = 0;             // until it starts: the page cache has those before this one
  std::size_t looked_ = 0;             // bricks before this one were, or are being, looked at
  std::size_t ranges_ = 0;             // the ranges of bricks before this one were announced
  std::deque<std::uint64_t> bytes_;    // of the samples of the bricks from reached_ to looked_
  std::uint64_t ahead_bytes_ = 0;      // their sum
  std::deque<std::size_t> announced_;  // of these bricks: their samples, and not fetched
  std::uint64_t brick_bytes_ = 0;      // of the samples of the first, and of most
  std::uint64_t most_ahead_bytes_ = 0;
  std::vector<std::thread> threads_;
};

}  // namespace isobrick
