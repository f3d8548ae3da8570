// How far vertices lie from another mesh.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <span>
#include <vector>

#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/indexed_mesh.h"

namespace isobrick {

class TriangleTree;

// The distance from the nearest point of a mesh, world units. If the mesh is closed (every edge is
// in two triangles, once each way), it is below 0 inside of it: the sign is that of the normal at
// the nearest point, weighted by angles (Baerentzen and Aanaes, Signed distance computation using
// the angle weighted pseudonormal, 2005). Exact but for single precision about the middle of the
// mesh.
class MeshDistance : public VertexValues {
 public:
  // Positions in world units. Normals and levels of the mesh do not count; they may be missing. It
  // takes some 60 bytes a triangle. Uses the calling TBB arena. Error without triangles.
  explicit MeshDistance(IndexedMesh mesh);
  ~MeshDistance() override;

  // Whether distances have a sign.
  bool isClosed() const { return is_closed_; }
  // Throws nothing.
  void evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                std::span<double> values) const override;

 private:
  using Triangle = std::array<std::uint32_t, 3>;
  double signOf(const glm::dvec3& point, std::uint32_t nearest) const;
  std::span<const std::uint32_t> trianglesAt(std::uint32_t vertex) const;
  bool findClosed() const;

  glm::dvec3 middle_{0.0};
  std::vector<glm::vec3> positions_;  // from the middle
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> first_, at_vertices_;  // of a vertex, those of its triangles
  std::unique_ptr<const TriangleTree> tree_;
  bool is_closed_ = false;
};

}  // namespace isobrick
