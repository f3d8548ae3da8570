#include "interruptible_call.h"

#include <nanobind/stl/string.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

// A thread that does one thing after the other. It is never ended: it may be idle when the
// interpreter goes, and a process that ends needs no farewell.
class Helper {
 public:
  Helper() : thread_([this] { loop(); }) { thread_.detach(); }

  void start(std::function<void()> task) {
    {
      const std::lock_guard lock(mutex_);
      task_ = std::move(task);
      is_done_ = false;
    }
    changed_.notify_all();
  }
  // True once the task is done.
  bool waitFor(std::chrono::milliseconds longest) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, longest, [this] { return is_done_; });
  }

 private:
  void loop() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [this] { return task_.has_value(); });
      const std::function<void()> task = *std::move(task_);
      task_.reset();
      lock.unlock();
      task();
      lock.lock();
      is_done_ = true;
      changed_.notify_all();
    }
  }

  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::optional<std::function<void()>> task_;
  bool is_done_ = false;
  std::thread thread_;
};

// Idle helpers. A child of fork() has none of its parent's threads, so it begins with none.
class HelperPool {
 public:
  std::unique_ptr<Helper> take() {
    forgetIfForked();
    const std::lock_guard lock(*mutex_);
    if (idle_.empty()) return std::make_unique<Helper>();
    auto helper = std::move(idle_.back());
    idle_.pop_back();
    return helper;
  }
  void giveBack(std::unique_ptr<Helper> helper) {
    const std::lock_guard lock(*mutex_);
    idle_.push_back(std::move(helper));
  }

 private:
  void forgetIfForked() {
    const pid_t pid = ::getpid();
    if (pid == pid_) return;
    for (auto& helper : idle_) (void)helper.release();
    idle_.clear();
    mutex_ = new std::mutex;  // another thread may have held the old one
    pid_ = pid;
  }

  pid_t pid_ = ::getpid();
  std::mutex* mutex_ = new std::mutex;
  std::vector<std::unique_ptr<Helper>> idle_;
};

HelperPool& helperPool() {
  static auto* const pool = new HelperPool;
  return *pool;
}

}  // namespace

void CallState::report(std::string_view phase, double fraction) {
  fraction_.store(static_cast<float>(fraction), std::memory_order_relaxed);
  const std::lock_guard lock(mutex_);
  phase_ = phase;
}

std::string CallState::phase() const {
  const std::lock_guard lock(mutex_);
  return phase_;
}

void runInterruptibly(const CallOptions& options, const std::function<void(CallState&)>& work) {
  CallState state;
  std::exception_ptr failure, interruption;
  std::unique_ptr<Helper> helper = helperPool().take();
  helper->start([&] {
    try {
      if (options.threads == 0) {
        work(state);
      } else {
        tbb::task_arena arena(options.threads);
        arena.execute([&] { work(state); });
      }
    } catch (...) {
      failure = std::current_exception();
    }
  });
  {
    nb::gil_scoped_release unlocked;
    float told = -1;
    while (!helper->waitFor(std::chrono::milliseconds(4))) {
      if (options.cancel != nullptr && options.cancel->flag.requested()) state.cancel().request();
      if (interruption) continue;
      const nb::gil_scoped_acquire locked;
      try {
        if (PyErr_CheckSignals() != 0) throw nb::python_error();
        const float fraction = state.fraction().load(std::memory_order_relaxed);
        if (!options.progress.is_none() && fraction != told) {
          options.progress(state.phase(), fraction);
          told = fraction;
        }
      } catch (...) {
        interruption = std::current_exception();
        state.cancel().request();
      }
    }
  }
  helperPool().giveBack(std::move(helper));
  // A call that was done before its interruption could end it is interrupted all the same.
  if (interruption) std::rethrow_exception(interruption);
  if (failure) std::rethrow_exception(failure);
  if (!options.progress.is_none()) options.progress(state.phase(), 1.0F);
}

}  // namespace isobrick::python
