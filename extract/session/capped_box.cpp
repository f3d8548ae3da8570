#include "isobrick/extract/session/capped_box.h"

#include <algorithm>
#include <glm/common.hpp>

#include "isobrick/extract/oracles/leaf_classifier.h"
#include "isobrick/extract/session/query_context.h"

namespace isobrick {
namespace {

// The coarsest level of which a leaf may lie across plane `plane` of `axis` within the box; 0 if
// there is none.
int levelAcross(const LeafClassifier& classifier, const Lattice& lattice, const Index3& low,
                const Index3& high, int axis, std::int64_t plane) {
  for (int level = lattice.levels() - 1; level > 0; --level) {
    IndexBox slab{low >> Index3(level), Index3(0)};
    slab.first[axis] = plane >> level;
    if (lattice.position(level, axis, slab.first[axis]) == plane) continue;
    const Index3 end = (high + Index3((std::int64_t{1} << level) - 1)) >> Index3(level);
    slab.count = end - slab.first;
    slab.count[axis] = 1;
    if (classifier.mayHoldLeaf(level, slab)) return level;
  }
  return 0;
}

}  // namespace

Query withCappedBox(const Pyramid& pyramid, const Query& query) {
  if (!query.cap || !query.box) return query;
  ReadLog log;
  const QueryContext context(pyramid, query, log);
  const LeafClassifier classifier(*context);
  const Lattice& lattice = pyramid.lattice();
  const glm::dvec3 last(lattice.voxels() - Index3(1));
  Index3 low(glm::floor(glm::clamp(query.box->min, glm::dvec3(0.0), last)));
  Index3 high(glm::ceil(glm::clamp(query.box->max, glm::dvec3(0.0), last)));
  bool grows = true;
  for (int axis = 0; axis < 3; ++axis) grows = grows && low[axis] < high[axis];
  while (grows) {
    grows = false;
    for (int axis = 0; axis < 3; ++axis)
      for (Index3* const corner : {&low, &high}) {
        std::int64_t& plane = (*corner)[axis];
        if (plane == lattice.voxels()[axis] - 1) continue;  // on the lattices of all levels
        const int level = levelAcross(classifier, lattice, low, high, axis, plane);
        if (level == 0) continue;
        const std::int64_t cell = plane >> level;
        plane = lattice.position(level, axis, corner == &low ? cell : cell + 1);
        grows = true;
      }
  }
  Query grown = query;
  grown.box = QueryBox{glm::dvec3(low), glm::dvec3(high)};
  return grown;
}

}  // namespace isobrick
