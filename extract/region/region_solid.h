// The object within a region, closed where it is cut.
//
// Voxels outside of the region become outside of the object, so the meshers close it by themselves,
// with the topology of marching cubes. On an edge that leaves the region they put the crossing
// where the isovalue is, or next to the outer end if there is none: then it moves to the cut, if
// that comes first. Wherever crossings lie on their edges, no two triangles cross (rule 11).
#pragma once

#include <glm/mat3x3.hpp>
#include <memory>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/region/region_field.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Level 0 of `volume` as float32; voxels outside of the region that are inside of the surface have
// the value outside that is nearest to the isovalue. All outlive it.
std::unique_ptr<const Pyramid> solidPyramid(const Pyramid& volume, const RegionField& field,
                                            const Query& query);

// By one thread at a time.
class SolidCrossings {
 public:
  // `field` outlives it.
  SolidCrossings(const RegionField& field, const GridGeometry& geometry, const CancelFlag* cancel);

  // Moves crossings of a batch of solidPyramid() to the cut, where it comes before the isovalue;
  // their normals are those of the cut. Triangles all of whose corners lie on it are caps, and
  // come last. Throws what MaskReader does.
  void move(MeshBatch& batch);

 private:
  // True if the vertex lies on the cut.
  bool moveVertex(std::uint32_t vertex, MeshBatch& batch);
  void putCapsLast(MeshBatch& batch);

  const RegionField& field_;
  std::vector<MaskReader> readers_;
  glm::dmat3 to_normal_;
  std::vector<std::uint8_t> is_moved_;  // of vertices, or on the cut anyway
  RawVector<std::uint32_t> caps_;
};

}  // namespace isobrick
