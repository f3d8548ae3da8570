#include "isobrick/storage/abandonable.h"

#include <exception>
#include <utility>

namespace isobrick {

LoadThreads::~LoadThreads() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

bool LoadThreads::run(std::function<void()> job) noexcept try {
  {
    const std::lock_guard lock(mutex_);
    if (jobs_.size() >= idle_ && threads_.size() < most_threads_) {
      try {
        threads_.emplace_back([this] { work(); });
      } catch (const std::exception&) {  // the existing threads do the work
      }
    }
    if (threads_.empty()) return false;
    jobs_.push_back(std::move(job));
  }
  wake_.notify_one();
  return true;
} catch (const std::exception&) {
  return false;
}

void LoadThreads::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    ++idle_;
    wake_.wait(lock, [&] { return stops_ || !jobs_.empty(); });
    --idle_;
    if (stops_) return;
    std::function<void()> job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    job();
    job = nullptr;  // what it holds on to may take its time to go
    lock.lock();
  }
}

}  // namespace isobrick
