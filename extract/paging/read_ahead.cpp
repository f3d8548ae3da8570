#include "isobrick/extract/paging/read_ahead.h"

#include <algorithm>
#include <exception>
#include <map>
#include <set>
#include <utility>

#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"
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
    if (!has_started_) start();
  }
  wake_.notify_all();
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
  // Whoever meshes the brick meets the same, and says so.
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
  std::vector<PyramidParts::PartAddress> samples;
  if (is_needed) samples.push_back({PartKind::kSamples, level, brick});
  if (is_needed && is_far_ && adaptive) addLenders(work_[work], samples);
  pyramid.parts().announce(samples);
  lock.lock();
  if (work < reached_) return;
  if (is_needed)
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

// Finer bricks whose samples the brick may need, if the surface crosses a leaf of it beside finer
// leaves: corners and crossings there are made of them (BrickFamily::finer()). Of a local file they
// are left to the mesher.
//
// A leaf lies in one tile of the finer level, whose range takes in all that the leaf's corners can
// be (rule 7). The finer leaves that touch it are at most a cell away from that tile.
void ReadAhead::addLenders(const BrickWork& work,
                           std::vector<PyramidParts::PartAddress>& samples) const {
  CrossedTiles tiles;
  if (work.level == 0 || !tiles.load(context_, work.level, work.brick)) return;
  const int level = work.level, finer = level - 1;
  const BrickLayout& layout = context_.pyramid.layout();
  const Index3 all = context_.lattice().cells(level), all_finer = context_.lattice().cells(finer);
  const IndexBox cells = layout.brickCellBox(level, work.brick);
  const LeafClassifier classifier(context_);
  const auto around = [](const IndexBox& box, const Index3& end_of_all) {
    const Index3 first = glm::max(box.first - Index3(1), Index3(0));
    return IndexBox{first, glm::min(box.end() + Index3(1), end_of_all) - first};
  };
  std::map<std::size_t, CrossedTiles> finer_tiles;  // by row; of bricks that the plan has
  std::set<std::size_t> lenders;

  // Of a tile of the finer level.
  const auto mayBeCrossed = [&](const Index3& tile) {
    const Index3 first = tile * layout.tileCells();
    const Index3 brick = first / layout.brickCells();
    const std::size_t row = context_.pyramid.parts().brickRow(finer, brick);
    if (!context_.query.cull_by_ranges || context_.pyramid.parts().isRowAbsent(row)) return true;
    if (!context_.pyramid.brickRange(finer, brick).crosses(context_.isovalue)) return false;
    const IndexBox own = layout.brickCellBox(finer, brick);
    if (!rows_of_work_.contains(row)) return true;
    const auto [found, is_new] = finer_tiles.try_emplace(row);
    if (is_new) {
      context_.pyramid.parts().fetch(PartKind::kRanges, finer, brick, context_.query.cancel);
      found->second.load(context_, finer, brick);
    }
    return found->second.isCrossed((first - own.first) / layout.tileCells());
  };
  // As BrickFamily::brickWith() chooses the brick that a corner is taken from.
  const auto isRefined = [&](const Index3& cell) {
    return classifier.mayRefine(level, {cell, Index3(1)});
  };
  const auto worthOf = [&](const Index3& brick, const Index3& fine) {
    const IndexBox own = layout.brickCellBox(finer, brick);
    const Index3 first =
        glm::max((fine - Index3(1)) / std::int64_t{2}, own.first / std::int64_t{2});
    const Index3 last = glm::min(fine / std::int64_t{2}, (own.end() - Index3(1)) / std::int64_t{2});
    bool has_leaf = false;
    forEachIndex({first, last - first + Index3(1)},
                 [&](const Index3& cell) { has_leaf = has_leaf || isRefined(cell); });
    if (!has_leaf ||
        context_.pyramid.parts().isRowAbsent(context_.pyramid.parts().brickRow(finer, brick)))
      return 0;
    return context_.pyramid.brickRange(finer, brick).crosses(context_.isovalue) ? 2 : 1;
  };
  const auto addLender = [&](const Index3& fine) {
    const Index3 first = glm::max(fine - Index3(1), Index3(0)) / layout.brickCells();
    const Index3 last = glm::min(fine / layout.brickCells(), layout.bricks(finer) - Index3(1));
    int best = 0;
    Index3 lender(0);
    forEachIndex({first, last - first + Index3(1)}, [&](const Index3& brick) {
      const int worth = best == 2 ? 0 : worthOf(brick, fine);
      if (worth <= best) return;
      best = worth;
      lender = brick;
    });
    if (best > 0 && lenders.insert(context_.pyramid.parts().brickRow(finer, lender)).second)
      samples.push_back({PartKind::kSamples, finer, lender});
  };
  // Of leaves within the tile. Where all of them lie in one brick that is known already, there is
  // nothing to find.
  const auto addLenders = [&](const IndexBox& coarse) {
    const Index3 first = glm::max(coarse.first * std::int64_t{2} - Index3(1), Index3(0));
    const Index3 last = glm::min(coarse.end() * std::int64_t{2}, all_finer - Index3(1));
    if (first / layout.brickCells() == last / layout.brickCells() &&
        lenders.contains(context_.pyramid.parts().brickRow(finer, first / layout.brickCells())))
      return;
    forEachIndex(coarse, [&](const Index3& cell) {
      if (!classifier.mayHoldLeaf(level, {cell, Index3(1)})) return;
      for (int corner = 0; corner < 8; ++corner)
        addLender(
            glm::min((cell + Index3(corner & 1, corner >> 1 & 1, corner >> 2)) * std::int64_t{2},
                     all_finer));
    });
  };
  forEachIndex({Index3(0), tiles.dims()}, [&](const Index3& tile) {
    if (!tiles.isCrossed(tile)) return;
    const IndexBox leaves =
        CrossedTiles::cellsOf({tile.x, tile.x + 1}, tile.y, tile.z, cells, layout.tileCells());
    if (!overlapsQueryBox(context_, level, leaves) || !classifier.mayHoldLeaf(level, leaves) ||
        !classifier.mayRefine(level, around(leaves, all)))
      return;
    const Index3 fine_first = leaves.first * std::int64_t{2};
    const Index3 fine_end = glm::min(leaves.end() * std::int64_t{2}, all_finer);
    const Index3 first = fine_first / layout.tileCells();
    const Index3 end = (fine_end - Index3(1)) / layout.tileCells() + Index3(1);
    forEachIndex({first, end - first}, [&](const Index3& finer_tile) {
      const Index3 from = finer_tile * layout.tileCells();
      const Index3 to = glm::min(from + Index3(layout.tileCells()), all_finer);
      const IndexBox coarse{from / std::int64_t{2},
                            (to + Index3(1)) / std::int64_t{2} - from / std::int64_t{2}};
      if (classifier.mayHoldLeaf(level, coarse) &&
          classifier.mayRefine(level, around(coarse, all)) && mayBeCrossed(finer_tile))
        addLenders(coarse);
    });
  });
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
