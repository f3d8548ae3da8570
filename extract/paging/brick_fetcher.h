// Bringing in what a progressive query lacks, while its caller looks at what there was.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "isobrick/extract/oracles/residency_oracle.h"
#include "isobrick/extract/paging/query_needs.h"

namespace isobrick {

// Some threads that fetch announced bricks in their order. They begin with the first announcement
// and end with this object, each with the part that it is at. A brick that cannot be read is passed
// over and remembered. Used by one other thread at a time; the pyramid outlives it.
//
// Which bytes there are is the pager's to know (BrickPager::reserve()): room is set aside for one
// brick after the other, in their order, before it is begun, so that a brick never takes the room
// of one that was announced before it. The first brick without room ends the announcement.
//
// Behind a URL the parts of the next bricks are announced to the server before a thread is at them,
// as far as it is known by then which parts these are.
class BrickFetcher {
 public:
  BrickFetcher() = default;
  ~BrickFetcher();
  BrickFetcher(const BrickFetcher&) = delete;
  BrickFetcher& operator=(const BrickFetcher&) = delete;

  // A progressive query looks at what is there: wait() counts from here on.
  void beginQuery();
  // Takes the place of what is left of the announcement before. Nothing goes for these bricks that
  // a query from number `since` on (PyramidParts::beginQuery()) took or fetched.
  void announce(const QueryNeeds& needs, std::vector<MissingBrick> bricks, std::uint64_t since);
  // Ends the announcement. Waits for nothing: each thread ends the part that it is at.
  void takeBack();
  // Waits until all has come in that was announced, at most `longest`. False if nothing has come
  // in since the query began and nothing will.
  bool wait(std::chrono::nanoseconds longest);

  // A brick of the announcement that could not be read, once.
  std::optional<MissingBrick> takeFailed();

  // Bricks whose parts are asked of a server ahead of the first that is not admitted, and the
  // threads that wait for its answers.
  static constexpr std::size_t kBricksAhead = 48, kThreadsFar = 16;

 private:
  enum class Outcome { kDone, kNoRoom, kFailed };
  // A brick of an announcement.
  struct Job {
    std::shared_ptr<const QueryNeeds> needs;  // a copy would take memory, and may not find it
    MissingBrick brick;
    std::size_t number;
    std::uint64_t announcement;
    std::uint64_t since;
    bool is_alone;
  };

  void start();
  void run();
  Outcome admit(const Job& job, std::shared_ptr<BrickPager::Room>& room) const;
  void announceNext(std::unique_lock<std::mutex>& lock);
  Outcome fetch(const Job& job, const std::shared_ptr<BrickPager::Room>& room);
  bool isEnded(std::uint64_t announcement);
  void noteCome();
  // All with the lock.
  bool mayAdmit() const {
    return next_ < bricks_.size() && !is_admitting_ && !(is_alone_ && busy_ > 0);
  }
  Job nextJob() const { return {needs_, bricks_[next_], next_, announcement_, since_, is_alone_}; }
  bool isCurrent(const Job& job) const { return job.announcement == announcement_; }
  void noteOutcome(const Job& job, Outcome outcome);
  void end() { next_ = bricks_.size(); }
  bool isIdle() const { return next_ == bricks_.size() && busy_ == 0; }

  CancelFlag stop_;   // ends what waits for a server
  std::mutex mutex_;  // guards all below
  std::condition_variable wake_, idle_;
  bool stops_ = false;
  std::shared_ptr<const QueryNeeds> needs_;
  std::vector<MissingBrick> bricks_;
  std::uint64_t since_ = 0;
  std::size_t next_ = 0;            // of them, to admit
  std::size_t busy_ = 0;            // threads that are at one
  std::uint64_t announcement_ = 0;  // its number
  bool is_admitting_ = false;       // some thread, the next one
  bool is_alone_ = false;           // one thread at a time
  bool has_come_ = false;           // anything, since the query began
  std::optional<MissingBrick> failed_;
  std::vector<std::thread> threads_;
};

}  // namespace isobrick
