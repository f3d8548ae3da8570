#include "isobrick/extract/read_ahead.h"

#include <algorithm>
#include <system_error>

#include "isobrick/storage/error.h"

namespace isobrick {

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  // Those of a query that ended early.
  for (std::size_t work = reached_; work < next_; ++work)
    context_.pyramid.withdraw(work_[work].level, work_[work].brick);
}

void ReadAhead::noteReached(std::size_t work) {
  {
    const std::lock_guard lock(mutex_);
    if (work < reached_) return;
    for (std::size_t passed = reached_; passed <= work && passed < next_; ++passed)
      ahead_bytes_ -= context_.pyramid.heldSampleBytes(work_[passed].level, work_[passed].brick);
    reached_ = work + 1;
    next_ = std::max(next_, reached_);
    if (!has_started_) start();
  }
  wake_.notify_all();
}

// Threads are a help only: where there are none to be had the meshers read for themselves.
void ReadAhead::start() try {
  has_started_ = true;
  most_ahead_bytes_ = std::min(context_.pyramid.budgetBytes() / 32, kMostBytes);
  const BrickLayout& layout = context_.pyramid.layout();
  const std::uint64_t brick_bytes =
      static_cast<std::uint64_t>(layout.brickSampleBox(work_[0].level, work_[0].brick).size()) *
      voxelBytes(context_.pyramid.spec().voxel_type);
  if (most_ahead_bytes_ < brick_bytes || reached_ >= work_.size()) return;
  while (threads_.size() < std::min(kThreads, work_.size()))
    threads_.emplace_back([this] { run(); });
} catch (const std::system_error&) {
}

void ReadAhead::run() try {
  for (std::size_t work = 0; waitForTurn(&work);) fetch(work);
} catch (const std::exception&) {
  // Whoever meshes the brick meets the same, and says so.
}

bool ReadAhead::waitForTurn(std::size_t* work) {
  std::unique_lock lock(mutex_);
  wake_.wait(lock,
             [&] { return stops_ || next_ == work_.size() || ahead_bytes_ < most_ahead_bytes_; });
  if (stops_ || next_ == work_.size() || context_.isCancelled()) return false;
  *work = next_++;
  ahead_bytes_ += context_.pyramid.heldSampleBytes(work_[*work].level, work_[*work].brick);
  return true;
}

void ReadAhead::fetch(std::size_t work) {
  const auto& [level, brick, adaptive] = work_[work];
  const Pyramid& pyramid = context_.pyramid;
  if (context_.query.cull_by_ranges) {
    pyramid.fetch(PartKind::kRanges, level, brick, context_.query.cancel);
    std::vector<std::uint8_t> crossed;
    pyramid.crossedTiles(level, brick, context_.isovalue, crossed, context_.query.cancel);
    if (std::find(crossed.begin(), crossed.end(), 1) == crossed.end()) return;
    if (context_.isCancelled()) return;
  }
  pyramid.fetch(PartKind::kSamples, level, brick, context_.query.cancel);
}

}  // namespace isobrick
