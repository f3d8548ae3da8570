// The vertices of the brick at hand, one for each edge.
#pragma once

#include "isobrick/extract/edge_vertex_map.h"
#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Makes vertices in a batch, whose origin is set, behind those that it has. `numbers`, empty at
// first, remembers the edges that have one made here. T: the voxel type.
template <typename T>
class BrickVertices {
 public:
  BrickVertices(const MeshContext& context, BrickFamily<T>& family,
                EdgeVertexMap<std::uint32_t>& numbers, MeshBatch& batch)
      : context_(context), family_(family), numbers_(numbers), batch_(batch) {}

  // The vertex on the edge along `axis` from `low` to `high`, made where there is none yet.
  // `is_shared`: other bricks may have it too.
  std::uint32_t vertexOn(int axis, const LatticePoint& low, const LatticePoint& high,
                         bool is_shared) {
    const Lattice& lattice = context_.lattice();
    const Index3 base = lattice.position(low.level, low.sample);
    const EdgeKey key = makeEdgeKey(base, axis);
    bool inserted = false;
    const std::uint32_t number =
        numbers_.findOrInsert(key, static_cast<std::uint32_t>(batch_.positions.size()), &inserted);
    if (!inserted) return number;
    const float t = crossingParameter(context_.isovalue, low.value, high.value);
    glm::vec3 position(base - batch_.origin);
    const std::int64_t end = lattice.position(high.level, axis, high.sample[axis]);
    position[axis] = crossingCoordinate(static_cast<float>(end - batch_.origin[axis]),
                                        static_cast<float>(end - base[axis]), t);
    batch_.positions.push_back(position);
    batch_.normals.push_back(context_.frame.normal(gradientAt(gradientOf(low), gradientOf(high), t),
                                                   axis, low.value >= context_.isovalue));
    if (is_shared) batch_.shared.push_back({number, 0, key});
    return number;
  }

 private:
  glm::vec3 gradientOf(const LatticePoint& point) {
    return family_.at(point.level, point.sample).gradient(point.sample);
  }

  const MeshContext& context_;
  BrickFamily<T>& family_;
  EdgeVertexMap<std::uint32_t>& numbers_;
  MeshBatch& batch_;
};

}  // namespace isobrick
