// A thread that works on the latest request alone, and the clock of the viewer.
#pragma once

#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {

inline double clockSeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The words of a failure; fewer, which need no memory, if there is none for them.
inline std::string failureWords(const std::exception& failure) noexcept try {
  if (dynamic_cast<const std::bad_alloc*>(&failure) != nullptr) return "no memory left";
  return failure.what();
} catch (const std::exception&) {
  return "no memory left";
}

// Calls `work(request, cancel)` on a thread of its own. A newer request cancels the current one.
// request(), cancel() and poll() are for one other thread and never wait for the work.
template <typename Request, typename Result>
class LatestWorker {
 public:
  using Work = std::function<Result(const Request&, const CancelFlag&)>;
  struct Outcome {
    Request request;
    std::optional<Result> result;
    std::string error;  // if there is no result
  };

  explicit LatestWorker(Work work) : work_(std::move(work)), thread_([this] { run(); }) {}
  ~LatestWorker() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
      if (cancel_ != nullptr) cancel_->request();
    }
    wake_.notify_all();
    thread_.join();
  }
  LatestWorker(const LatestWorker&) = delete;
  LatestWorker& operator=(const LatestWorker&) = delete;

  void request(Request request) {
    auto cancel = std::make_shared<CancelFlag>();
    const std::lock_guard lock(mutex_);
    waiting_ = std::move(request);
    waiting_cancel_ = std::move(cancel);
    outcome_.reset();
    if (cancel_ != nullptr) cancel_->request();
    wake_.notify_all();
  }
  // Ends the current work; it has no outcome then.
  void cancel() {
    const std::lock_guard lock(mutex_);
    waiting_.reset();
    outcome_.reset();
    if (cancel_ != nullptr) cancel_->request();
  }
  // The outcome of a request that no other one followed, once.
  std::optional<Outcome> poll() {
    const std::lock_guard lock(mutex_);
    return std::exchange(outcome_, std::nullopt);
  }
  bool busy() const {
    const std::lock_guard lock(mutex_);
    return waiting_ || cancel_ != nullptr || outcome_;
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [&] { return stopping_ || waiting_; });
      if (stopping_) return;
      Outcome outcome{std::move(*waiting_), {}, {}};
      waiting_.reset();
      const std::shared_ptr<CancelFlag> cancel = std::move(waiting_cancel_);
      cancel_ = cancel;
      lock.unlock();
      try {
        outcome.result = work_(outcome.request, *cancel);
      } catch (const std::exception& failure) {
        outcome.error = failureWords(failure);
      }
      lock.lock();
      cancel_.reset();
      if (!cancel->requested()) outcome_ = std::move(outcome);
    }
  }

  const Work work_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::optional<Request> waiting_;
  std::shared_ptr<CancelFlag> waiting_cancel_;  // made by request(), which can report a failure
  std::shared_ptr<CancelFlag> cancel_;          // of the current work
  std::optional<Outcome> outcome_;
  bool stopping_ = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace isobrick
