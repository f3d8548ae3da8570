#include "isobrick/extract/meshing/transition_face.h"

namespace isobrick {

TransitionFace makeTransitionFace(const Lattice& lattice, int level, const Index3& cell, int face,
                                  const TileCorners& corners) {
  TransitionFace out;
  out.axis = face / 2;
  out.side = face % 2;
  out.b = (out.axis + 1) % 3;
  out.c = (out.axis + 2) % 3;
  const int fine = level - 1;
  const Index3 last = lattice.samples(fine) - Index3(1);
  out.parts_b = 2 * cell[out.b] + 2 <= last[out.b] ? 2 : 1;
  out.parts_c = 2 * cell[out.c] + 2 <= last[out.c] ? 2 : 1;
  // Of the finer samples, those on the coarse lattice are the coarse face's corners; the last one
  // may be odd.
  const auto cornerValue = [&](const Index3& sample) {
    return corners.at((sample + Index3(1)) / std::int64_t{2}).value;
  };
  Index3 sample = std::int64_t{2} * cell;
  sample[out.axis] = std::min(2 * (cell[out.axis] + out.side), last[out.axis]);
  const Index3 first = sample;
  for (int j = 0; j <= out.parts_c; ++j)
    for (int i = 0; i <= out.parts_b; ++i) {
      sample[out.b] = first[out.b] + i;
      sample[out.c] = first[out.c] + j;
      out.points[j][i] = {valueOnCoarserLeaf(lattice, fine, sample, cornerValue), fine, sample};
    }
  return out;
}

}  // namespace isobrick
