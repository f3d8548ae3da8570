// Long calls from Python: without the interpreter's lock, ended by Ctrl-C, with progress.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>

namespace isobrick::python {

// Ends calls from another thread; what Python knows as `Cancel`.
struct CancelRequest {
  CancelFlag flag;
};

// The link to a call that is under way: requests go in, progress comes out.
class CallState {
 public:
  // To be handed to the library.
  CancelFlag& cancel() { return cancel_; }
  // Written by the library or by report().
  std::atomic<float>& fraction() { return fraction_; }
  // As the library's callbacks have it; from any thread.
  void report(std::string_view phase, double fraction);
  // As reported last.
  std::string phase() const;

 private:
  CancelFlag cancel_;
  std::atomic<float> fraction_{0};
  mutable std::mutex mutex_;  // guards phase_
  std::string phase_;
};

// How a call runs.
struct CallOptions {
  nanobind::object progress = nanobind::none();  // called with (phase, fraction), or None
  int threads = 0;                               // 0: all cores
  const CancelRequest* cancel = nullptr;         // may be null
};

// Runs `work` on a thread of its own, in an arena of as many threads as the options want, while the
// caller, which holds the interpreter's lock and gives it away meanwhile, looks every 4 ms whether
// Python has a signal for it. If it has, or if the progress callback throws, `work` is cancelled
// and waited for, and the exception goes on. Throws what `work` throws.
//
// Threads are kept for the next call. In a child of fork() they are made anew.
void runInterruptibly(const CallOptions& options, const std::function<void(CallState&)>& work);

}  // namespace isobrick::python
