// The threads of a build: one reads, those of the TBB arena make bricks, one writes.
#pragma once

#include <tbb/concurrent_queue.h>

#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "isobrick/preprocess/brick_window.h"
#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/scratch_volume.h"
#include "isobrick/storage/brick_encoder.h"

namespace isobrick {

// One window on its way from reading to making.
struct BrickWindow {
  IndexBox bricks;
  IndexBox sample_box;  // of `samples`, dense
  LargeBuffer samples;
  bool has_samples = false;  // false: all its bricks exist already, nothing was read
};

// Bricks on their way from making to writing, in the order of the brick table.
struct BrickBatch {
  std::vector<EncodedBrick> bricks;
  std::size_t first = 0, count = 0;  // those to be written
};

// Moves windows and batches between three stages. A buffer that is under way belongs to the stage
// that took it last; if all are under way, a stage that needs one waits. The first failure of any
// stage stops all, and is thrown by run() or finish() on the caller's thread.
class BrickPipeline {
 public:
  using Read = std::function<void(std::int64_t window, BrickWindow&)>;
  using Make = std::function<void(const BrickWindow&, BrickBatch&)>;
  using Write = std::function<void(const BrickBatch&)>;

  // Starts the writing thread.
  BrickPipeline(const BuildPlan& plan, Write write);
  ~BrickPipeline();
  BrickPipeline(const BrickPipeline&) = delete;
  BrickPipeline& operator=(const BrickPipeline&) = delete;

  // Takes windows 0 .. windows - 1 through reading (a thread of its own, in order) and making (the
  // caller's thread, in order), and passes the batches on to the writing thread.
  void run(std::int64_t windows, const Read& read, const Make& make);
  // Waits until all batches were written. Afterwards nothing can be run.
  void finish();

 private:
  void readAll(std::int64_t windows, const Read& read);
  void writeAll(const Write& write);
  void fail(std::exception_ptr failure);
  void throwFailure();
  // Waits for the next one. Null: there is none, or a stage failed.
  template <typename T>
  T* take(tbb::concurrent_bounded_queue<T*>& queue) {
    T* next = nullptr;
    queue.pop(next);
    return is_over_ ? nullptr : next;
  }

  std::vector<BrickWindow> windows_;
  std::vector<BrickBatch> batches_;
  // Each has one stage that takes from it, which ends at a null.
  tbb::concurrent_bounded_queue<BrickWindow*> free_windows_, full_windows_;
  tbb::concurrent_bounded_queue<BrickBatch*> free_batches_, full_batches_;
  std::atomic<bool> is_over_{false};  // before its time
  std::mutex mutex_;                  // guards failure_
  std::exception_ptr failure_;
  std::thread writer_;  // last: it uses all the others
};

}  // namespace isobrick
