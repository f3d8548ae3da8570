#include "isobrick/extract/paging/read_ahead.h"

#include <algorithm>
#include <exception>
#include <utility>

#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/extract/paging/lender_bricks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

ReadAhead::ReadAhead(const MeshContext& context, std::span<const BrickWork> work)
    : context_(context),
      work_(work),
      misses_before_(context.pyramid.parts().missCount()),
      is_far_(context.pyramid.parts().isRemote()) {
  const std::lock_guard lock(mutex_);
  if (!is_far_ || work_.empty()) return;
  for (const auto& [level, brick, adaptive] : work_)
    rows_of_work_.insert(context_.pyramid.parts().brickRow(level, brick));
  start();
}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
  // Those of a query that ended early.
  for (std::size_t work = reached_; work < looked_; ++work)
    context_.pyramid.parts().withdraw(work_[work].level, work_[work].brick);
}

void ReadAhead::noteReached(std::size_t work) {
  {
    const std::lock_guard lock(mutex_);
    if (work < reached_) return;
    for (; reached_ <= work && !bytes_.empty(); ++reached_) {
      ahead_bytes_ -= bytes_.front();
      bytes_.pop_front();
    }
    reached_ = work + 1;
    looked_ = std::max(looked_, reached_);
    ranges_ = std::max(ranges_, reached_);
    // A mesher reads the parts that it needs at once itself.
    std::erase_if(announced_, [&](std::size_t announced) { return announced < reached_; });
    if (!has_started_ && !isAheadCached()) start();
  }
  wake_.notify_all();
}

bool ReadAhead::isAheadCached() {
  const PyramidParts& parts = context_.pyramid.parts();
  const std::size_t end = std::min(work_.size(), reached_ + kMostAnnounced);
  for (cached_ = std::max(cached_, reached_); cached_ < end; ++cached_)
    for (const PartKind kind : {PartKind::kRanges, PartKind::kSamples})
      if (!parts.isCached(kind, work_[cached_].level, work_[cached_].brick)) return false;
  return true;
}

// Threads are a help only: if the system gives none the meshers read for themselves.
void ReadAhead::start() try {
  has_started_ = true;
  most_ahead_bytes_ = std::min(context_.pyramid.budgetBytes() / 32, kMostBytes);
  const BrickLayout& layout = context_.pyramid.layout();
  brick_bytes_ =
      static_cast<std::uint64_t>(layout.brickSampleBox(work_[0].level, work_[0].brick).size()) *
      voxelBytes(context_.pyramid.spec().voxel_type);
  if (most_ahead_bytes_ < brick_bytes_ || reached_ >= work_.size()) return;
  while (threads_.size() < std::min(kThreads, work_.size()))
    threads_.emplace_back([this] { run(); });
} catch (const std::exception&) {
}

bool ReadAhead::mayLook() const {
  return looked_ < work_.size() && ahead_bytes_ + brick_bytes_ <= most_ahead_bytes_ &&
         announced_.size() < (is_far_ ? kMostAnnouncedFar : kMostAnnounced);
}

// Bricks are looked at before any is loaded, so that the disk has as much to do at once as it may.
void ReadAhead::run() try {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [&] {
      return stops_ || mayLook() || !announced_.empty() || looked_ == work_.size();
    });
    if (stops_ || context_.isCancelled()) return;
    if (mayLook())
      look(lock);
    else if (!announced_.empty())
      load(lock);
    else
      return;
  }
} catch (const std::exception&) {
  // The thread that meshes the brick meets the same, and says so.
}

// Gives the lock back meanwhile.
void ReadAhead::look(std::unique_lock<std::mutex>& lock) {
  const Pyramid& pyramid = context_.pyramid;
  const std::size_t work = looked_;
  const auto& [level, brick, adaptive] = work_[work];
  const std::uint64_t bytes = pyramid.parts().heldBytes(PartKind::kSamples, level, brick);
  bytes_.push_back(bytes);
  ahead_bytes_ += bytes;
  ++looked_;
  const std::size_t end = std::min(work_.size(), work + (is_far_ ? kRangesAheadFar : kRangesAhead));
  const std::size_t begin = std::exchange(ranges_, std::max(ranges_, end));
  lock.unlock();
  if (context_.query.cull_by_ranges) {
    std::vector<PyramidParts::PartAddress> ranges;
    for (std::size_t n = begin; n < end; ++n)
      ranges.push_back({PartKind::kRanges, work_[n].level, work_[n].brick});
    pyramid.parts().announce(ranges);
  }
  const bool is_needed = isNeeded(work_[work]);
  const bool is_loaded = is_needed && !pyramid.parts().isCached(PartKind::kSamples, level, brick);
  std::vector<PyramidParts::PartAddress> samples;
  if (is_loaded) samples.push_back({PartKind::kSamples, level, brick});
  if (is_needed && is_far_ && adaptive) addLenders(work_[work], samples);
  pyramid.parts().announce(samples);
  lock.lock();
  if (work < reached_) return;
  if (is_loaded)
    announced_.push_back(work);
  else
    ahead_bytes_ -= std::exchange(bytes_[work - reached_], 0);
  wake_.notify_all();
}

// As look().
void ReadAhead::load(std::unique_lock<std::mutex>& lock) {
  const auto& [level, brick, adaptive] = work_[announced_.front()];
  announced_.pop_front();
  lock.unlock();
  context_.pyramid.parts().fetch(PartKind::kSamples, level, brick, context_.query.cancel);
  lock.lock();
}

// Only behind a URL: those of a local file are left to the mesher.
void ReadAhead::addLenders(const BrickWork& work,
                           std::vector<PyramidParts::PartAddress>& samples) const {
  CrossedTiles tiles;
  if (work.level == 0 || !tiles.load(context_, work.level, work.brick)) return;
  const auto lent = LenderBricks(context_, work, tiles, rows_of_work_).find();
  samples.insert(samples.end(), lent.begin(), lent.end());
}

bool ReadAhead::isNeeded(const BrickWork& work) const {
  if (!context_.query.cull_by_ranges) return true;
  context_.pyramid.parts().fetch(PartKind::kRanges, work.level, work.brick, context_.query.cancel);
  CrossedTiles tiles;
  if (!tiles.load(context_, work.level, work.brick)) return false;
  if (!work.adaptive) return true;
  const BrickLayout& layout = context_.pyramid.layout();
  const IndexBox cells = layout.brickCellBox(work.level, work.brick);
  const LeafClassifier classifier(context_);
  bool is_needed = false;
  for (std::int64_t z = 0; z < tiles.dims().z; ++z)
    for (std::int64_t y = 0; y < tiles.dims().y && !is_needed; ++y) {
      const CrossedTiles::Span span = tiles.crossedSpan(y, z);
      if (span.begin == span.end) continue;
      const IndexBox crossed = CrossedTiles::cellsOf(span, y, z, cells, layout.tileCells());
      is_needed = overlapsQueryBox(context_, work.level, crossed) &&
                  classifier.mayHoldLeaf(work.level, crossed);
    }
  return is_needed;
}

}  // namespace isobrick
