// Bringing in what a query for now lacks, while its caller looks at what there was.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "isobrick/extract/brick_needs.h"
#include "isobrick/extract/oracles/residency_oracle.h"

namespace isobrick {

// Some threads that fetch announced bricks in their order. They begin with the first announcement
// and end with this object, each with the part that it is at. A brick that cannot be had is passed
// over and remembered. Used by one other thread at a time; the pyramid outlives it.
class BrickFetcher {
 public:
  BrickFetcher() = default;
  ~BrickFetcher();
  BrickFetcher(const BrickFetcher&) = delete;
  BrickFetcher& operator=(const BrickFetcher&) = delete;

  // A query for now looks at what is there: wait() counts from here on.
  void beginQuery();
  // Takes the place of what is left of the announcement before. Parts that count for at most
  // `most_bytes` (Pyramid::heldBytes()) come in, with those that did since the query began; the
  // rest of the bricks is left out.
  void announce(const BrickNeeds& needs, std::vector<MissingBrick> bricks,
                std::uint64_t most_bytes);
  // Ends the announcement, and withdraws what came in and was not used. Waits for nothing: each
  // thread ends the part that it is at.
  void takeBack();
  // Waits until all has come in that was announced, at most `longest`. False where nothing has come
  // in since the query began and nothing will.
  bool wait(std::chrono::nanoseconds longest);

  // Of the announcement a brick that could not be had, once.
  std::optional<MissingBrick> takeFailed();

 private:
  void start();
  void run();
  class Coming;
  // What it takes of the brick; false where a part cannot be had.
  bool fetch(const BrickNeeds& needs, const MissingBrick& brick, std::uint64_t announcement);
  bool isEnded(std::uint64_t announcement);
  void noteCome();
  void noteFetched(const Pyramid& pyramid, BrickPager::Fetched fetched, std::uint64_t bytes,
                   const MissingBrick& brick);
  // All with the lock.
  bool hasRoomFor(std::uint64_t bytes) const {
    return came_bytes_ + coming_bytes_ + bytes <= most_bytes_;
  }
  void noteEnded();
  bool isIdle() const { return next_ == bricks_.size() && busy_ == 0; }

  std::mutex mutex_;  // guards all below
  std::condition_variable wake_, idle_;
  bool stops_ = false;
  std::optional<BrickNeeds> needs_;
  std::vector<MissingBrick> bricks_;
  std::size_t next_ = 0;            // of them, to fetch
  std::size_t busy_ = 0;            // threads that are at one
  std::uint64_t announcement_ = 0;  // its number
  std::uint64_t most_bytes_ = 0;
  std::uint64_t came_bytes_ = 0;    // since the query began
  std::uint64_t coming_bytes_ = 0;  // for what the threads are at
  bool is_taken_back_ = false;
  bool is_crowded_ = false;            // some part had no room beside those of other threads
  bool is_alone_ = false;              // one thread at a time
  bool has_come_ = false;              // anything, since the query began
  std::vector<MissingBrick> fetched_;  // to be withdrawn, since the query began
  std::optional<MissingBrick> failed_;
  std::vector<std::thread> threads_;
};

}  // namespace isobrick
