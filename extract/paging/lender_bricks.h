// The finer bricks that lend samples to a mixed one, found before it is meshed.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <unordered_set>
#include <vector>

#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/extract/session/mesh_context.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

// Finds the finer bricks whose samples a brick may need, if the surface crosses a leaf of it beside
// finer leaves: corners and crossings there are made of them (BrickFamily::finer()).
//
// A leaf lies in one tile of the finer level, whose range takes in all that the leaf's corners can
// be (rule 7). The finer leaves that touch it are at most a cell away from that tile.
class LenderBricks {
 public:
  // `tiles`: of the brick, whose level is above 0. `planned`: rows of the bricks whose ranges are
  // announced. All outlive the object.
  LenderBricks(const MeshContext& context, const BrickWork& work, const CrossedTiles& tiles,
               const std::unordered_set<std::size_t>& planned);

  // Their samples. Reads ranges of planned bricks.
  std::vector<PyramidParts::PartAddress> find();

 private:
  void visitTile(const IndexBox& leaves);
  bool mayTouchFiner(const IndexBox& coarse) const;
  bool mayBeCrossed(const Index3& finer_tile);
  void addLenders(const IndexBox& coarse);
  void addLender(const Index3& fine);
  std::size_t rowOf(const Index3& finer_brick) const {
    return context_.pyramid.parts().brickRow(finer_, finer_brick);
  }

  const MeshContext& context_;
  const CrossedTiles& tiles_;
  const std::unordered_set<std::size_t>& planned_;
  const BrickLayout& layout_;
  const LeafClassifier classifier_;
  const int level_, finer_;
  const IndexBox cells_;                             // of the brick
  const Index3 all_, all_finer_;                     // cells of both levels
  std::map<std::size_t, CrossedTiles> finer_tiles_;  // by row; of planned bricks
  std::set<std::size_t> rows_;                       // of lenders
  std::vector<PyramidParts::PartAddress> samples_;
};

}  // namespace isobrick
