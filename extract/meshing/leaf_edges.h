// The edges on which a leaf's vertices lie (rule 8).
#pragma once

#include "isobrick/extract/meshing/leaf_rows.h"

namespace isobrick {

// The edge that carries the crossing of a leaf's edge: itself, or the twice as long edge of a
// coarser leaf of which it is a half.
struct LeafEdge {
  int axis = 0;
  Index3 low{0}, high{0};      // samples of the leaf's level
  bool is_of_coarser = false;  // the values of its ends are their own samples
  bool is_shared = false;      // another brick may have the same vertex
};

// The edge from sample `base` of a leaf of the brick along `axis`. `brick`: the brick's cells.
LeafEdge leafEdge(const Lattice& lattice, const LeafRows& leaves, const IndexBox& brick,
                  const Index3& base, int axis);

}  // namespace isobrick
