// Passes things from one thread to another, at most so many at a time.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>

namespace isobrick {

// A first-in first-out queue between threads. All members are thread-safe.
//
// After close() nothing more comes, and pop() still returns the things in the queue. abort() stops
// at once: all waiting calls return, and pop() returns nothing more.
template <typename T>
class BoundedQueue {
 public:
  explicit BoundedQueue(std::size_t capacity) : capacity_(capacity) {}

  // Waits for room. False after abort(): the thing was not taken.
  bool push(T thing) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return aborted_ || things_.size() < capacity_; });
    if (aborted_) return false;
    things_.push_back(std::move(thing));
    changed_.notify_all();
    return true;
  }
  // Waits for a thing. Nothing after abort(), or when the queue is closed and empty.
  std::optional<T> pop() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return aborted_ || closed_ || !things_.empty(); });
    if (aborted_ || things_.empty()) return std::nullopt;
    T thing = std::move(things_.front());
    things_.pop_front();
    changed_.notify_all();
    return thing;
  }
  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    changed_.notify_all();
  }
  void abort() {
    const std::lock_guard lock(mutex_);
    aborted_ = true;
    changed_.notify_all();
  }

 private:
  const std::size_t capacity_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<T> things_;
  bool closed_ = false, aborted_ = false;
};

}  // namespace isobrick
