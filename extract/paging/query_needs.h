// The parts of a brick that a query takes.
#pragma once

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/extract/cap_border.h"
#include "isobrick/extract/query.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

// The answers that QueryNeeds asks for: whether a brick's row of the brick table is at hand, and
// whether a part of it is. Either function may see to it that it is.
template <typename Row, typename Part>
struct BrickAnswers {
  Row row;    // bool row(int level, const Index3& brick)
  Part part;  // bool part(PartKind kind, int level, const Index3& brick)
};
template <typename Row, typename Part>
BrickAnswers(Row, Part) -> BrickAnswers<Row, Part>;  // clang 14 deduces no aggregate

// Reads a row that is not at hand; throws Error if it is damaged.
template <typename Part>
auto answersThatReadRows(const Pyramid& pyramid, Part part) {
  return BrickAnswers{[&pyramid](int level, const Index3& brick) {
                        static_cast<void>(pyramid.parts().brickRowOf(level, brick));
                        return true;
                      },
                      std::move(part)};
}

// The parts of a brick that must be resident so that its cells can be meshed, and so that the
// oracles can say which of them are refined, without a read. A value; its pyramid outlives it.
class QueryNeeds {
 public:
  QueryNeeds(const Pyramid& pyramid, const Query& query)
      : pyramid_(&pyramid),
        border_(pyramid.lattice(), query),
        isovalue_(pyramid.storedIsovalue(query.isovalue)),
        culls_(query.cull_by_ranges) {
    const auto any = [&](auto has) {
      return has(query) || std::any_of(query.or_finer.begin(), query.or_finer.end(), has);
    };
    if (any([](const DetailChoice& choice) { return choice.curvature_tolerance.has_value(); }))
      kinds_.push_back(PartKind::kCurvature);
  }

  const Pyramid& pyramid() const { return *pyramid_; }

  // The kinds of a brick's own parts that areMet() may ask for.
  std::span<const PartKind> kinds() const { return kinds_; }

  // False if neither the isosurface nor a cap reaches the brick (rule 7). The brick's row is at
  // hand.
  bool mayCross(int level, const Index3& brick) const {
    return !culls_ || border_.reachesBrick(*pyramid_, level, brick, isovalue_);
  }

  // Asks for one needed row or part after the other. Ends with false at the first that is not
  // there; a brick's row is asked for before its ranges, and those before its samples.
  template <typename Answers>
  bool areMet(int level, const Index3& brick, const Answers& has) const {
    using enum PartKind;
    if (!has.row(level, brick)) return false;
    if (level == 0 && takes(kCurvature) &&
        !(has.part(kRanges, 0, brick) && has.part(kCurvature, 0, brick)))
      return false;
    if (!hasRanges(level, brick, has)) return false;
    return isQuiet(level, brick, has) || has.part(kSamples, level, brick);
  }

  // False unless the brick's samples are there, or no coarser leaf beside it can need them: such a
  // leaf takes the values of corners that touch it from them, or from those of the brick of this
  // level that the leaf itself covers a part of. A leaf that holds a part of the surface covers one
  // that is not quiet.
  template <typename Answers>
  bool hasBorder(int level, const Index3& brick, const Answers& has) const {
    if (has.part(PartKind::kSamples, level, brick)) return true;
    const Index3 first = glm::max(brick - Index3(1), Index3(0));
    const Index3 end = glm::min(brick + Index3(2), pyramid_->layout().bricks(level));
    bool has_all = true;
    forEachIndex({first, end - first}, [&](const Index3& other) {
      has_all =
          has_all && (isQuiet(level, other, has) || has.part(PartKind::kSamples, level, other));
    });
    return has_all;
  }

  // True if no leaf of the brick's level or of the next coarser one, within the brick, holds a
  // part of the surface: the tiles hold all corners of the coarser leaf that a corner of it can
  // hang on if they have at least four cells (rule 7). Unknown, so false, without the brick's
  // row and ranges, which are asked for if they decide.
  template <typename Answers>
  bool isQuiet(int level, const Index3& brick, const Answers& has) const {
    if (!culls_ || !has.row(level, brick)) return false;
    if (!mayCross(level, brick)) return true;
    if (!has.part(PartKind::kRanges, level, brick)) return false;
    if (pyramid_->layout().tileCells() < 4) return false;
    std::vector<std::uint8_t> crossed;
    border_.findTiles(*pyramid_, level, brick, isovalue_, crossed);
    return std::find(crossed.begin(), crossed.end(), 1) == crossed.end();
  }

 private:
  // Whether the ranges are there, unless the row alone decides.
  template <typename Answers>
  bool hasRanges(int level, const Index3& brick, const Answers& has) const {
    return !culls_ || (has.row(level, brick) &&
                       (!mayCross(level, brick) || has.part(PartKind::kRanges, level, brick)));
  }
  bool takes(PartKind kind) const {
    return std::find(kinds_.begin(), kinds_.end(), kind) != kinds_.end();
  }

  const Pyramid* pyramid_;
  CapBorder border_;
  float isovalue_;
  bool culls_;
  std::vector<PartKind> kinds_ = {PartKind::kRanges, PartKind::kSamples};
};

}  // namespace isobrick
