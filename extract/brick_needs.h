// Which parts of a brick a query takes.
#pragma once

#include <algorithm>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// What has to be resident of a brick so that its cells can be meshed, and so that the oracles can
// say which of them are refined, without a read. A value; its pyramid outlives it.
class BrickNeeds {
 public:
  BrickNeeds(const Pyramid& pyramid, const Query& query)
      : pyramid_(&pyramid),
        isovalue_(static_cast<float>(query.isovalue)),
        culls_(query.cull_by_ranges) {
    add(query);
    for (const DetailChoice& choice : query.or_finer) add(choice);
  }

  const Pyramid& pyramid() const { return *pyramid_; }

  // Asks has(kind, level, brick) for one needed part after the other: those of other bricks too
  // that the error oracle looks at. Ends with false at the first that it has not; a brick's ranges
  // are asked for before its samples.
  template <typename F>
  bool areMet(int level, const Index3& brick, F&& has) const {
    using enum PartKind;
    if (level == 0 && takes_curvature_ && !(has(kRanges, 0, brick) && has(kCurvature, 0, brick)))
      return false;
    if (!hasRanges(level, brick, has)) return false;
    if (!isQuiet(level, brick, has) && !has(kSamples, level, brick)) return false;
    if (!takes_errors_) return true;
    if (level >= kFirstErrorLevel && level <= pyramid_->spec().error_level &&
        !(has(kRanges, level, brick) && has(kError, level, brick)))
      return false;
    if (level > 0) return true;
    const Index3 first = glm::max(brick - Index3(1), Index3(0));
    const Index3 end = glm::min(brick + Index3(2), pyramid_->layout().bricks(0));
    bool are_met = true;
    forEachIndex({first, end - first}, [&](const Index3& other) {
      are_met = are_met && hasRanges(0, other, has) &&
                (isQuiet(0, other, has) ||
                 (has(kSamples, 0, other) && has(kSamples, 1, other / std::int64_t{2})));
    });
    return are_met;
  }

  // True where no leaf of the brick's level or of the next coarser one, within the brick, holds a
  // part of the surface: the tiles hold all corners of the coarser leaf that a corner of it can
  // hang on if they have at least four cells (rule 7). Unknown, so false, without the brick's
  // ranges, which are asked for where they decide.
  template <typename F>
  bool isQuiet(int level, const Index3& brick, F&& has) const {
    if (!culls_) return false;
    if (!pyramid_->brickRange(level, brick).crosses(isovalue_)) return true;
    if (!has(PartKind::kRanges, level, brick)) return false;
    if (pyramid_->layout().tileCells() < 4) return false;
    std::vector<std::uint8_t> crossed;
    pyramid_->crossedTiles(level, brick, isovalue_, crossed);
    return std::find(crossed.begin(), crossed.end(), 1) == crossed.end();
  }

 private:
  // Where they decide.
  template <typename F>
  bool hasRanges(int level, const Index3& brick, F&& has) const {
    return !culls_ || !pyramid_->brickRange(level, brick).crosses(isovalue_) ||
           has(PartKind::kRanges, level, brick);
  }
  void add(const DetailChoice& choice) {
    takes_curvature_ = takes_curvature_ || choice.curvature_tolerance.has_value();
    takes_errors_ = takes_errors_ || choice.tolerance.has_value();
  }

  const Pyramid* pyramid_;
  float isovalue_;
  bool culls_;
  bool takes_curvature_ = false, takes_errors_ = false;
};

}  // namespace isobrick
