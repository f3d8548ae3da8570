// Vertices between lattice points of which the brick's own samples are not the whole truth.
#pragma once

#include "isobrick/extract/meshing/brick_family.h"
#include "isobrick/extract/meshing/corner_values.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Writes vertices of a batch whose origin is set. T: the voxel type.
template <typename T>
class BrickVertices {
 public:
  BrickVertices(const MeshContext& context, BrickFamily<T>& family, MeshBatch& batch)
      : context_(context), family_(family), batch_(batch) {}

  // Puts the crossing of the edge along `axis` from `low` to `high` in the place of vertex
  // `vertex`. `is_shared`: lists it as one that other bricks may have too.
  void put(std::uint32_t vertex, int axis, const LatticePoint& low, const LatticePoint& high,
           bool is_shared) {
    const Lattice& lattice = context_.lattice();
    const Index3 base = lattice.position(low.level, low.sample);
    const float t = crossingParameter(context_.isovalue, low.value, high.value);
    glm::vec3 position(base - batch_.origin);
    const std::int64_t end = lattice.position(high.level, axis, high.sample[axis]);
    position[axis] = crossingCoordinate(static_cast<float>(end - batch_.origin[axis]),
                                        static_cast<float>(end - base[axis]), t);
    batch_.positions[vertex] = position;
    batch_.normals[vertex] = context_.frame.normal(gradientAt(gradientOf(low), gradientOf(high), t),
                                                   axis, low.value >= context_.isovalue);
    if (is_shared) batch_.shared.push_back({vertex, 0, makeEdgeKey(base, axis)});
  }
  // The same behind the vertices that there are; returns its number.
  std::uint32_t append(int axis, const LatticePoint& low, const LatticePoint& high) {
    const auto vertex = static_cast<std::uint32_t>(batch_.positions.size());
    batch_.positions.emplace_back();
    batch_.normals.emplace_back();
    put(vertex, axis, low, high, true);
    return vertex;
  }

 private:
  glm::vec3 gradientOf(const LatticePoint& point) {
    return family_.at(point.level, point.sample).gradient(point.sample);
  }

  const MeshContext& context_;
  BrickFamily<T>& family_;
  MeshBatch& batch_;
};

}  // namespace isobrick
