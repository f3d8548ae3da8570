#include "isobrick/extract/brick_fetcher.h"

#include <exception>
#include <system_error>
#include <utility>

#include "isobrick/extract/read_ahead.h"

namespace isobrick {

BrickFetcher::~BrickFetcher() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void BrickFetcher::beginQuery() {
  const std::lock_guard lock(mutex_);
  has_come_ = false;
}

void BrickFetcher::announce(const BrickNeeds& needs, std::vector<MissingBrick> bricks,
                            std::uint64_t most_bytes) {
  const std::lock_guard lock(mutex_);
  needs_ = needs;
  bricks_ = std::move(bricks);
  next_ = 0;
  most_bytes_ = most_bytes;
  came_bytes_ = 0;
  is_taken_back_ = false;
  if (bricks_.empty()) fetched_.clear();
  if (!bricks_.empty()) start();
  wake_.notify_all();
}

void BrickFetcher::takeBack() {
  const std::lock_guard lock(mutex_);
  if (!needs_) return;
  next_ = bricks_.size();
  is_taken_back_ = true;
  for (const MissingBrick& fetched : fetched_)
    needs_->pyramid().withdraw(fetched.level, fetched.brick);
  fetched_.clear();
}

bool BrickFetcher::wait(std::chrono::nanoseconds longest) {
  std::unique_lock lock(mutex_);
  idle_.wait_for(lock, longest, [&] { return isIdle(); });
  return has_come_ || !isIdle();
}

std::optional<MissingBrick> BrickFetcher::takeFailed() {
  const std::lock_guard lock(mutex_);
  return std::exchange(failed_, std::nullopt);
}

// Where there are no threads to be had nothing comes in, and wait() says so.
void BrickFetcher::start() try {
  while (threads_.size() < ReadAhead::kThreads) threads_.emplace_back([this] { run(); });
} catch (const std::system_error&) {
  if (threads_.empty()) next_ = bricks_.size();
}

void BrickFetcher::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [&] { return stops_ || next_ < bricks_.size(); });
    if (stops_) return;
    const MissingBrick brick = bricks_[next_++];
    const BrickNeeds needs = *needs_;
    if (!hasRoomFor(needs, brick)) {
      next_ = bricks_.size();
      if (isIdle()) idle_.notify_all();
      continue;
    }
    ++busy_;
    lock.unlock();
    const bool is_there = fetch(needs, brick);
    lock.lock();
    --busy_;
    if (!is_there && !failed_) failed_ = brick;
    if (isIdle()) idle_.notify_all();
  }
}

// For what all threads together may be at. With the lock.
bool BrickFetcher::hasRoomFor(const BrickNeeds& needs, const MissingBrick& brick) const try {
  const std::uint64_t bytes = needs.pyramid().heldSampleBytes(brick.level, brick.brick);
  return came_bytes_ + ReadAhead::kThreads * bytes <= most_bytes_;
} catch (const std::exception&) {  // its row is damaged: fetch() meets the same, and says so
  return true;
}

bool BrickFetcher::fetch(const BrickNeeds& needs, const MissingBrick& brick) try {
  const Pyramid& pyramid = needs.pyramid();
  bool is_there = true;
  const auto has = [&](PartKind kind, int level, const Index3& of) {
    if (isTakenBack()) return false;
    const BrickPager::Fetched fetched = pyramid.fetch(kind, level, of);
    if (fetched == BrickPager::Fetched::kNow) noteFetched(pyramid, kind, {level, of, false});
    is_there = is_there && fetched != BrickPager::Fetched::kNever;
    return is_there;
  };
  needs.areMet(brick.level, brick.brick, has);
  if (brick.needs_samples) has(PartKind::kSamples, brick.level, brick.brick);
  return is_there;
} catch (const std::exception&) {
  return false;
}

bool BrickFetcher::isTakenBack() {
  const std::lock_guard lock(mutex_);
  return is_taken_back_ || stops_;
}

void BrickFetcher::noteFetched(const Pyramid& pyramid, PartKind kind, const MissingBrick& brick) {
  const std::lock_guard lock(mutex_);
  if (is_taken_back_) {
    pyramid.withdraw(brick.level, brick.brick);
    return;
  }
  has_come_ = true;
  if (kind == PartKind::kSamples) came_bytes_ += pyramid.heldSampleBytes(brick.level, brick.brick);
  fetched_.push_back(brick);
}

}  // namespace isobrick
