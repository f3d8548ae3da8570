#include "isobrick/extract/brick_fetcher.h"

#include <algorithm>
#include <exception>
#include <system_error>
#include <utility>

#include "isobrick/extract/read_ahead.h"

namespace isobrick {
namespace {

// A part that comes in may be unpacked from a copy beside it, which is smaller.
constexpr std::uint64_t kComingFactor = 2;

// Of all of the brick's parts.
std::uint64_t heldBytes(const Pyramid& pyramid, const MissingBrick& brick) try {
  std::uint64_t bytes = 0;
  for (const PartKind kind : kPartKinds) bytes += pyramid.heldBytes(kind, brick.level, brick.brick);
  return bytes;
} catch (const std::exception&) {  // as of a damaged row: BrickFetcher::fetch() says so
  return 0;
}

}  // namespace

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
  most_bytes_ -= std::min(most_bytes_, came_bytes_);
  came_bytes_ = 0;
  fetched_.clear();
}

void BrickFetcher::announce(const BrickNeeds& needs, std::vector<MissingBrick> bricks,
                            std::uint64_t most_bytes) {
  const std::lock_guard lock(mutex_);
  needs_ = needs;
  bricks_ = std::move(bricks);
  next_ = 0;
  ++announcement_;
  most_bytes_ = most_bytes;
  is_taken_back_ = is_crowded_ = is_alone_ = false;
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

// Room for what is being brought in, where there is some.
class BrickFetcher::Coming {
 public:
  Coming(BrickFetcher& fetcher, std::uint64_t bytes) : fetcher_(fetcher), bytes_(bytes) {
    const std::lock_guard lock(fetcher_.mutex_);
    has_room_ = fetcher_.hasRoomFor(bytes_);
    if (has_room_)
      fetcher_.coming_bytes_ += bytes_;
    else if (fetcher_.busy_ > 1)
      fetcher_.is_crowded_ = true;
  }
  ~Coming() {
    const std::lock_guard lock(fetcher_.mutex_);
    if (has_room_) fetcher_.coming_bytes_ -= bytes_;
  }
  Coming(const Coming&) = delete;

  bool hasRoom() const { return has_room_; }

 private:
  BrickFetcher& fetcher_;
  const std::uint64_t bytes_;
  bool has_room_ = false;
};

// A brick is begun only where there is room for all of it beside what the others are at, so that
// however late a thread comes to run nobody takes the room of what was announced before. What lies
// beside the brick shows on the way: where nothing came in as the threads left each other no room
// for that, they go over the announcement once more, one at a time.
void BrickFetcher::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock,
               [&] { return stops_ || (next_ < bricks_.size() && !(is_alone_ && busy_ > 0)); });
    if (stops_) return;
    const MissingBrick brick = bricks_[next_];
    const BrickNeeds needs = *needs_;
    const std::uint64_t bytes = kComingFactor * heldBytes(needs.pyramid(), brick);
    if (!hasRoomFor(bytes)) {
      if (busy_ > 0) {
        wake_.wait(lock);
        continue;
      }
      next_ = bricks_.size();
      noteEnded();
      continue;
    }
    ++next_;
    ++busy_;
    coming_bytes_ += bytes;
    const std::uint64_t announcement = announcement_;
    lock.unlock();
    const bool is_there = fetch(needs, brick, announcement);
    lock.lock();
    coming_bytes_ -= bytes;
    --busy_;
    if (!is_there && !failed_) failed_ = brick;
    noteEnded();
  }
}

void BrickFetcher::noteEnded() {
  if (isIdle() && is_crowded_ && !has_come_ && !is_taken_back_) {
    is_crowded_ = false;
    is_alone_ = true;
    next_ = 0;
  }
  if (isIdle()) idle_.notify_all();
  wake_.notify_all();
}

bool BrickFetcher::fetch(const BrickNeeds& needs, const MissingBrick& brick,
                         std::uint64_t announcement) try {
  const Pyramid& pyramid = needs.pyramid();
  bool is_there = true;
  const auto has = [&](PartKind kind, int level, const Index3& of) {
    const bool is_own = level == brick.level && of == brick.brick;
    const std::uint64_t bytes = pyramid.heldBytes(kind, level, of);
    const Coming coming(*this, is_own ? 0 : kComingFactor * bytes);
    if (isEnded(announcement) || !coming.hasRoom()) return false;
    const BrickPager::Fetched fetched = pyramid.fetch(kind, level, of);
    noteFetched(pyramid, fetched, bytes, {level, of});
    is_there = is_there && fetched != BrickPager::Fetched::kNever;
    return is_there;
  };
  bool is_whole = needs.areMet(brick.level, brick.brick, has);
  if (brick.needs_samples) is_whole = has(PartKind::kSamples, brick.level, brick.brick);
  if (is_whole && (brick.lacks_parts || brick.needs_samples)) noteCome();
  return is_there;
} catch (const std::exception&) {
  return false;
}

// Also where another one has taken the announcement's place.
bool BrickFetcher::isEnded(std::uint64_t announcement) {
  const std::lock_guard lock(mutex_);
  return announcement != announcement_ || is_taken_back_ || stops_;
}

// For what others brought in since the query looked, too.
void BrickFetcher::noteCome() {
  const std::lock_guard lock(mutex_);
  has_come_ = true;
}

void BrickFetcher::noteFetched(const Pyramid& pyramid, BrickPager::Fetched fetched,
                               std::uint64_t bytes, const MissingBrick& brick) {
  using enum BrickPager::Fetched;
  if (fetched != kNow && fetched != kKept) return;
  const std::lock_guard lock(mutex_);
  if (is_taken_back_) {
    pyramid.withdraw(brick.level, brick.brick);
    return;
  }
  has_come_ = has_come_ || fetched == kNow;
  came_bytes_ += bytes;
  fetched_.push_back(brick);
}

}  // namespace isobrick
