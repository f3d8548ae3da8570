#include "isobrick/preprocess/brick_pipeline.h"

#include <algorithm>

namespace isobrick {

BrickPipeline::BrickPipeline(const BuildPlan& plan, Write write)
    : windows_(kBuildWindows),
      batches_(kBuildWindows),
      free_windows_(kBuildWindows),
      full_windows_(kBuildWindows),
      free_batches_(kBuildWindows),
      full_batches_(kBuildWindows) {
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
      const auto window = full_windows_.pop();
      const auto batch = window ? free_batches_.pop() : std::nullopt;
      if (!batch) break;  // a stage failed
      make(**window, **batch);
      if (!free_windows_.push(*window) || !full_batches_.push(*batch)) break;
    }
  } catch (...) {
    fail(std::current_exception());
  }
  reader.join();
  throwFailure();
}

void BrickPipeline::finish() {
  full_batches_.close();
  writer_.join();
  throwFailure();
}

void BrickPipeline::readAll(std::int64_t windows, const Read& read) {
  try {
    for (std::int64_t i = 0; i < windows; ++i) {
      const auto window = free_windows_.pop();
      if (!window) return;
      read(i, **window);
      if (!full_windows_.push(*window)) return;
    }
  } catch (...) {
    fail(std::current_exception());
  }
}

void BrickPipeline::writeAll(const Write& write) {
  try {
    while (const auto batch = full_batches_.pop()) {
      write(**batch);
      if (!free_batches_.push(*batch)) return;
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
  free_windows_.abort();
  full_windows_.abort();
  free_batches_.abort();
  full_batches_.abort();
}

void BrickPipeline::throwFailure() {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
}

}  // namespace isobrick
