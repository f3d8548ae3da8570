// Work that cannot be interrupted, on threads that a caller may stop waiting for.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"

namespace isobrick {

// Runs `work()` on a thread of its own and returns what it returns, or throws what it throws. After
// a request to cancel, which is noticed within some milliseconds, throws Cancelled at once: `work`
// then goes on alone to its end, and its result is dropped there. So it must own, or share, all
// that it touches. The process may end meanwhile only by std::_Exit, which runs no destructors of
// global objects. Without a flag the calling thread does the work.
template <typename Work>
auto runAbandonable(const CancelFlag* cancel, Work work) {
  using Result = decltype(work());
  if (cancel == nullptr) return work();
  cancel->check();
  struct Shared {
    explicit Shared(Work w) : work(std::move(w)) {}
    std::optional<Work> work;
    std::mutex mutex;  // guards all below
    std::condition_variable changed;
    std::optional<Result> result;
    std::exception_ptr failure;
    bool is_done = false;
  };
  const auto shared = std::make_shared<Shared>(std::move(work));
  std::thread thread([shared] {
    std::optional<Result> result;
    std::exception_ptr failure;
    try {
      result.emplace((*shared->work)());
    } catch (...) {
      failure = std::current_exception();
    }
    shared->work.reset();  // destroys everything that only the work owned
    const std::lock_guard lock(shared->mutex);
    shared->result = std::move(result);
    shared->failure = failure;
    shared->is_done = true;
    shared->changed.notify_all();
  });

  // A signal handler can only set the flag, so no call wakes this thread.
  constexpr auto kBetweenLooks = std::chrono::milliseconds(5);
  std::unique_lock lock(shared->mutex);
  while (!shared->changed.wait_for(lock, kBetweenLooks, [&] { return shared->is_done; })) {
    if (!cancel->requested()) continue;
    thread.detach();
    throw Cancelled();
  }
  lock.unlock();
  // The thread's own data of a library is gone before the caller uses the library on, or ends the
  // process.
  thread.join();
  if (shared->failure) std::rethrow_exception(shared->failure);
  return std::move(*shared->result);
}

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
