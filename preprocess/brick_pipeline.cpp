#include "isobrick/preprocess/brick_pipeline.h"

#include <algorithm>

namespace isobrick {

BrickPipeline::BrickPipeline(const BuildPlan& plan, Write write)
    : windows_(kBuildWindows), batches_(kBuildWindows) {
  std::size_t most_bricks = 1;
  for (const BuildPlan::WindowShape& shape : plan.windows)
    most_bricks = std::max(most_bricks, static_cast<std::size_t>(shape.x * shape.y));
  for (BrickWindow& window : windows_) {
    window.samples = LargeBuffer(plan.window_bytes);
    free_windows_.push(&window);
  }
  for (BrickBatch& batch : batches_) {
    batch.bricks.resize(most_bricks);
    free_batches_.push(&batch);
  }
  writer_ = std::thread([this, write] { writeAll(write); });
}

BrickPipeline::~BrickPipeline() {
  if (!writer_.joinable()) return;
  fail(nullptr);
  writer_.join();
}

void BrickPipeline::run(std::int64_t windows, const Read& read, const Make& make) {
  std::thread reader([&] { readAll(windows, read); });
  try {
    for (std::int64_t i = 0; i < windows; ++i) {
      BrickWindow* const window = take(full_windows_);
      BrickBatch* const batch = window != nullptr ? take(free_batches_) : nullptr;
      if (batch == nullptr) break;  // a stage failed
      make(*window, *batch);
      free_windows_.push(window);
      full_batches_.push(batch);
    }
  } catch (...) {
    fail(std::current_exception());
  }
  reader.join();
  throwFailure();
}

void BrickPipeline::finish() {
  full_batches_.push(nullptr);
  writer_.join();
  throwFailure();
}

void BrickPipeline::readAll(std::int64_t windows, const Read& read) {
  try {
    for (std::int64_t i = 0; i < windows; ++i) {
      BrickWindow* const window = take(free_windows_);
      if (window == nullptr) return;
      read(i, *window);
      full_windows_.push(window);
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

void BrickPipeline::writeAll(const Write& write) {
  try {
    while (BrickBatch* const batch = take(full_batches_)) {
      write(*batch);
      free_batches_.push(batch);
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

// Without a failure, just stops.
void BrickPipeline::fail(std::exception_ptr failure) {
  {
    const std::lock_guard lock(mutex_);
    if (!failure_) failure_ = failure;
  }
  is_over_ = true;
  for (auto* const queue : {&free_windows_, &full_windows_}) queue->push(nullptr);
  for (auto* const queue : {&free_batches_, &full_batches_}) queue->push(nullptr);
}

void BrickPipeline::throwFailure() {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
}

}  // namespace isobrick
