#include "isobrick/extract/oracles/cells_beyond.h"

#include <array>
#include <map>
#include <optional>

#include "isobrick/extract/oracles/cell_error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

IndexBox grown(const IndexBox& box, std::int64_t by) {
  return {box.first - Index3(by), box.count + Index3(2 * by)};
}

// A bit for each corner of a cell, x + 2y + 4z, that the cell at an offset from it has too.
unsigned cornersTouching(const Index3& offset) {
  static constexpr unsigned kCorners[3][3] = {
      {0x55, 0xFF, 0xAA}, {0x33, 0xFF, 0xCC}, {0x0F, 0xFF, 0xF0}};
  return kCorners[0][offset.x + 1] & kCorners[1][offset.y + 1] & kCorners[2][offset.z + 1];
}

bool isEven(const Index3& cell) { return (cell.x + cell.y + cell.z) % 2 == 0; }

// T is the voxel type.
template <typename T>
class BrickDecision {
 public:
  BrickDecision(const MeshContext& context, const Index3& brick, const ErrorBound& bound,
                const FoundAround& around)
      : context_(context),
        brick_(brick),
        bound_(bound),
        around_(around),
        cells_(coarseCellsOf(context.pyramid.layout(), brick)),
        may_be_beyond_(grown(cells_, 1)),
        are_beyond_(grown(cells_, 2)) {
    forEachIndex({Index3(-1), Index3(3)}, [&](const Index3& offset) {
      const auto& found = around.at(offset);
      if (!found) return;
      may_be_beyond_.add(found->may_be_beyond);
      are_beyond_.add(found->are_beyond);
    });
  }

  CellBits run() {
    CellBits beyond(cells_);
    beyond.add(may_be_beyond_);
    // A brick that has found nothing is crossed in no cell that is asked for.
    if (around_.at(Index3(0))->may_be_beyond.box().size() == 0) return beyond;
    for (std::int64_t z = cells_.first.z; z < cells_.end().z; ++z)
      for (std::int64_t y = cells_.first.y; y < cells_.end().y; ++y)
        keepBitsWhere(beyond.row(y, z), beyond.words(), [&](std::int64_t i) {
          return isBeyond({cells_.first.x + i, y, z});
        });
    return beyond;
  }

 private:
  // Whether a cell that may be beyond the tolerance is refined.
  bool isBeyond(const Index3& cell) {
    if (are_beyond_.has(cell)) return true;
    CellError<T>& error = errorsAround(cell);
    error.load(cell);
    if (!error.isCrossed()) return true;
    if (isEven(cell)) return isEvenBeyond(cell);
    const unsigned fine_corners = firstCorners(cell);
    if (!error.isBeyond(fine_corners)) return false;
    const unsigned more = fine_corners | cornersWhere(cell, [&](const Index3& touching) {
                            return isEven(touching) && isEvenBeyond(touching);
                          });
    if (more == fine_corners) return true;
    error.load(cell);
    return error.isBeyond(more);
  }

  // Of a cell of the brick or beside it, whether it is one of the second kind.
  bool isEvenBeyond(const Index3& cell) {
    if (!contains({Index3(0), context_.lattice().cells(1)}, cell)) return false;
    if (!may_be_beyond_.has(cell) || are_beyond_.has(cell)) return false;
    const auto [known, is_new] = even_.try_emplace(
        linearIndex(cell - may_be_beyond_.box().first, may_be_beyond_.box().count), false);
    if (!is_new) return known->second;
    if (around_.at(offsetOf(cell))->may_be_beyond.box().size() == 0) return false;
    CellError<T>& error = errorsAround(cell);
    error.load(cell);
    return known->second = error.isCrossed() && error.isBeyond(firstCorners(cell));
  }

  // Those that touch a cell of the first kind that is crossed.
  unsigned firstCorners(const Index3& cell) const {
    return cornersWhere(cell, [&](const Index3& touching) { return are_beyond_.has(touching); });
  }

  // A bit for each corner, x + 2y + 4z, that a cell has for which f(cell) holds.
  template <typename F>
  static unsigned cornersWhere(const Index3& cell, F&& f) {
    unsigned corners = 0;
    forEachIndex({Index3(-1), Index3(3)}, [&](const Index3& offset) {
      if (offset != Index3(0) && f(cell + offset)) corners |= cornersTouching(offset);
    });
    return corners;
  }

  // Of the brick that holds the cell, from brick_.
  Index3 offsetOf(const Index3& cell) const {
    return std::int64_t{2} * cell / context_.pyramid.layout().brickCells() - brick_;
  }

  CellError<T>& errorsAround(const Index3& cell) {
    const Index3 offset = offsetOf(cell);
    auto& samples = samples_[static_cast<std::size_t>(linearIndex(offset + Index3(1), Index3(3)))];
    if (!samples) {
      const Index3 brick = brick_ + offset;
      samples.emplace(context_.samples(0, brick), context_.samples(1, brick / std::int64_t{2}),
                      context_.lattice(), bound_);
    }
    return samples->error;
  }

  struct Samples {
    Samples(BrickSamples of_voxels, BrickSamples of_samples, const Lattice& lattice,
            const ErrorBound& bound)
        : voxels(std::move(of_voxels)),
          samples(std::move(of_samples)),
          error(lattice, voxels, samples, bound) {}
    BrickSamples voxels, samples;
    CellError<T> error;
  };

  const MeshContext& context_;
  const Index3 brick_;
  const ErrorBound& bound_;
  const FoundAround& around_;
  const IndexBox cells_;
  CellBits may_be_beyond_, are_beyond_;
  std::map<std::int64_t, bool> even_;
  std::array<std::optional<Samples>, 27> samples_;
};

}  // namespace

CellBits cellsBeyond(const MeshContext& context, const Index3& brick, const ErrorBound& bound,
                     const FoundAround& around) {
  CellBits beyond;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    beyond = BrickDecision<typename decltype(tag)::Type>(context, brick, bound, around).run();
  });
  context.throwIfReadsFailed();
  return beyond;
}

}  // namespace isobrick
