#include "isobrick/extract/paging/brick_fetcher.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "isobrick/extract/paging/read_ahead.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

BrickFetcher::~BrickFetcher() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  stop_.request();
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void BrickFetcher::beginQuery() {
  const std::lock_guard lock(mutex_);
  has_come_ = false;
}

void BrickFetcher::announce(const QueryNeeds& needs, std::vector<MissingBrick> bricks,
                            std::uint64_t since) {
  auto kept = std::make_shared<const QueryNeeds>(needs);
  const std::lock_guard lock(mutex_);
  needs_ = std::move(kept);
  bricks_ = std::move(bricks);
  since_ = since;
  next_ = 0;
  ++announcement_;
  is_alone_ = false;
  if (!bricks_.empty()) start();
  wake_.notify_all();
}

void BrickFetcher::takeBack() {
  const std::lock_guard lock(mutex_);
  ++announcement_;
  end();
}

bool BrickFetcher::wait(std::chrono::nanoseconds longest) {
  // Longer is for ever; the clock cannot count to it.
  constexpr std::chrono::nanoseconds kLongest = std::chrono::hours(24 * 365);
  std::unique_lock lock(mutex_);
  idle_.wait_for(lock, std::min(longest, kLongest), [&] { return isIdle(); });
  return has_come_ || !isIdle();
}

std::optional<MissingBrick> BrickFetcher::takeFailed() {
  const std::lock_guard lock(mutex_);
  return std::exchange(failed_, std::nullopt);
}

// If there are no threads, nothing comes in, and wait() says so.
void BrickFetcher::start() try {
  const bool is_far = needs_->pyramid().parts().isRemote();
  while (threads_.size() < (is_far ? kThreadsFar : ReadAhead::kThreads))
    threads_.emplace_back([this] { run(); });
} catch (const std::exception&) {
  if (threads_.empty()) end();
}

// One thread admits at a time, so that room is set aside in the order of the announcement, however
// late a thread comes to run. A brick's needs of its neighbours show on the way, and may find no
// room beside what the other threads are at. Then the threads go on from there one at a time.
void BrickFetcher::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [&] { return stops_ || mayAdmit(); });
    if (stops_) return;
    const Job job = nextJob();
    std::shared_ptr<BrickPager::Room> room;
    is_admitting_ = true;
    ++busy_;
    lock.unlock();
    Outcome outcome = admit(job, room);
    lock.lock();
    is_admitting_ = false;
    if (isCurrent(job) && outcome != Outcome::kNoRoom) next_ = job.number + 1;
    wake_.notify_all();
    if (job.needs->pyramid().parts().isRemote()) announceNext(lock);
    lock.unlock();
    if (outcome == Outcome::kDone) outcome = fetch(job, room);
    room.reset();
    lock.lock();
    --busy_;
    if (isCurrent(job)) noteOutcome(job, outcome);
    if (isIdle()) idle_.notify_all();
    wake_.notify_all();
  }
}

// The first part that each of the next bricks lacks: which one comes after it shows in that.
void BrickFetcher::announceNext(std::unique_lock<std::mutex>& lock) {
  const std::shared_ptr<const QueryNeeds> needs = needs_;
  const auto first = bricks_.begin() + static_cast<std::ptrdiff_t>(next_ > 0 ? next_ - 1 : 0);
  const auto count = std::min<std::ptrdiff_t>(bricks_.end() - first, kBricksAhead);
  const std::vector<MissingBrick> next(first, first + count);
  lock.unlock();
  try {
    const PyramidParts& parts = needs->pyramid().parts();
    std::vector<PyramidParts::PartAddress> lacking;
    const BrickAnswers answers{
        [&](int level, const Index3& brick) { return parts.isRowAtHand(level, brick); },
        [&](PartKind kind, int level, const Index3& brick) {
          if (parts.holdIfResident(kind, level, brick)) return true;
          lacking.push_back({kind, level, brick});
          return false;
        }};
    for (const MissingBrick& missing : next)
      static_cast<void>(needs->areMet(missing.level, missing.brick, answers));
    parts.announce(lacking);
  } catch (const std::exception&) {  // the thread that fetches the brick meets the same
  }
  lock.lock();
}

void BrickFetcher::noteOutcome(const Job& job, Outcome outcome) {
  if (outcome == Outcome::kFailed && !failed_) failed_ = job.brick;
  if (outcome != Outcome::kNoRoom) return;
  if (job.is_alone)
    end();
  else
    next_ = std::min(next_, job.number);
  is_alone_ = true;
}

BrickFetcher::Outcome BrickFetcher::admit(const Job& job,
                                          std::shared_ptr<BrickPager::Room>& room) const try {
  const auto& [level, brick, needs_samples, lacks_parts] = job.brick;
  room = job.needs->pyramid().parts().reserve(job.needs->kinds(), level, brick, job.since);
  return room ? Outcome::kDone : Outcome::kNoRoom;
} catch (const std::exception&) {  // such as a damaged row
  return Outcome::kFailed;
}

BrickFetcher::Outcome BrickFetcher::fetch(const Job& job,
                                          const std::shared_ptr<BrickPager::Room>& room) try {
  using enum BrickPager::Fetched;
  const Pyramid& pyramid = job.needs->pyramid();
  const MissingBrick& brick = job.brick;
  // A disk is waited for, a server is not.
  const bool is_far = pyramid.parts().isRemote();
  Outcome outcome = Outcome::kDone;
  const auto bring = [&](PartKind kind, int level, const Index3& of) {
    if (isEnded(job.announcement)) return false;
    const BrickPager::Fetched fetched =
        pyramid.parts().fetch(kind, level, of, is_far ? &stop_ : nullptr, room);
    if (fetched == kNow) noteCome();
    if (fetched == kNoRoom) outcome = Outcome::kNoRoom;
    if (fetched == kNever) outcome = Outcome::kFailed;
    return outcome == Outcome::kDone;
  };
  bool is_whole = job.needs->areMet(brick.level, brick.brick, answersThatReadRows(pyramid, bring));
  if (brick.needs_samples && outcome == Outcome::kDone)
    is_whole = bring(PartKind::kSamples, brick.level, brick.brick);
  // Others may have brought it in since the query looked.
  if (is_whole && (brick.lacks_parts || brick.needs_samples)) noteCome();
  return outcome;
} catch (const std::exception&) {
  return Outcome::kFailed;
}

bool BrickFetcher::isEnded(std::uint64_t announcement) {
  const std::lock_guard lock(mutex_);
  return announcement != announcement_ || stops_;
}

void BrickFetcher::noteCome() {
  const std::lock_guard lock(mutex_);
  has_come_ = true;
}

}  // namespace isobrick
