// Cuts the batches of an open surface to a region.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "isobrick/extract/region/region_field.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// By one thread at a time; keeps its memory.
//
// A side of a triangle that leaves the region at a plane or a sphere gets a vertex there, in the
// steps of crossings (1/32768 of an edge of the batch's level). It depends on the side's ends
// alone, so that the triangles on both sides of it have the same one. A vertex that lies within
// kNear of the cut counts as on it, so that no vertex comes to lie on another. Triangles without
// area are left out.
class RegionCutter {
 public:
  // Voxels: 32 of the steps.
  static constexpr double kNear = 1.0 / 1024;

  // `field` outlives it.
  RegionCutter(const RegionField& field, const CancelFlag* cancel)
      : field_(field), readers_(field.readers(cancel)) {}

  // Leaves of the batch what lies in the region. False: all of it, and nothing changed. The batch
  // is not uniform afterwards. Throws what MaskReader does.
  bool cut(MeshBatch& batch);

 private:
  // `depth` of a place is that behind the wall; without a wall triangles go as a whole.
  template <typename Depth>
  bool cutAt(const Depth& depth, const RegionWall* wall, std::uint64_t number, MeshBatch& batch);
  std::uint32_t vertexBetween(const RegionWall& wall, std::uint64_t number, std::uint32_t inside,
                              std::uint32_t outside, MeshBatch& batch);

  const RegionField& field_;
  std::vector<MaskReader> readers_;
  std::vector<double> depths_;          // of vertices
  std::vector<EdgeKey> keys_;           // of vertices; kNoEdge of those that no other batch has
  std::vector<std::uint32_t> numbers_;  // scratch
  RawVector<std::uint32_t> triangles_;  // those that stay
  std::unordered_map<std::uint64_t, std::uint32_t> made_;  // by the two ends
};

}  // namespace isobrick
