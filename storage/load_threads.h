// Threads for work that a caller may stop waiting for.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace isobrick {

// Jobs are begun in their order, on threads that stay. The destructor drops jobs that have not
// begun and waits for the others. All members are thread-safe.
class LoadThreads {
 public:
  // Enough for reads that wait for a disk, and for unpacking on all cores.
  explicit LoadThreads(std::size_t most_threads = std::max(16u,
                                                           std::thread::hardware_concurrency()))
      : most_threads_(most_threads) {}
  ~LoadThreads();
  LoadThreads(const LoadThreads&) = delete;
  LoadThreads& operator=(const LoadThreads&) = delete;

  // `job` throws nothing. False if there is no thread or no memory for it; then it is not done.
  bool run(std::function<void()> job) noexcept;

 private:
  void work();

  const std::size_t most_threads_;
  std::mutex mutex_;  // guards all below
  std::condition_variable wake_;
  std::deque<std::function<void()>> jobs_;
  std::size_t idle_ = 0;
  bool stops_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace isobrick
