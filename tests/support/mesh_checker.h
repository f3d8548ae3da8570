// The one mesh checker that serves all tests (rule 11): is this an oriented manifold that is closed
// except where a volume's border cuts it?
//
//   MeshReport report = checkMesh(positions, triangles, volumeOptions(geometry, dims));
//   EXPECT_TRUE(report.ok()) << report.summary();
//
// Vertices are the same only if their index is: nothing is welded. Fast enough for meshes of many
// million triangles (linear passes and tiny sorts; about 100 bytes of scratch per triangle).
#pragma once

#include <cstdint>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick::test {

struct MeshBox {
  glm::dvec3 lower{0.0}, upper{0.0};
};

struct MeshCheckOptions {
  // The volume's border. Every vertex must be inside, and an edge with a single triangle is allowed
  // where both its ends are on the same one of the six planes. Without a box no such edge is.
  std::optional<MeshBox> box;
  // How far outside the box a vertex, or off its border an open edge, may be; in units of the box.
  double tolerance = 1e-4;
  // From positions to the coordinates of the box: matrix * (position - origin).
  glm::dmat3 to_box_matrix{1.0};
  glm::dvec3 to_box_origin{0.0};
};

// A box in the coordinates of the positions.
MeshCheckOptions boxOptions(const glm::dvec3& lower, const glm::dvec3& upper);
// Positions in voxel indices of a volume of `voxels` samples.
MeshCheckOptions indexOptions(const Index3& voxels);
// Positions in world units of a volume, however it is turned; the tolerance is in voxels.
MeshCheckOptions volumeOptions(const GridGeometry& geometry, const Index3& voxels);

struct MeshReport {
  // ---- Faults. ok() means that all of these are 0.
  std::int64_t partial_triangles = 0;    // 1: the index list's length is no multiple of 3
  std::int64_t bad_indices = 0;          // past the last vertex; if any, nothing else was checked
  std::int64_t repeated_indices = 0;     // triangles that use a vertex twice; ignored further on
  std::int64_t open_edges = 0;           // in one triangle, and not on the border
  std::int64_t misoriented_edges = 0;    // in two triangles, the same way in both
  std::int64_t nonmanifold_edges = 0;    // in more than two triangles
  std::int64_t pinched_vertices = 0;     // whose triangles form more than one fan
  std::int64_t duplicate_triangles = 0;  // with the same three vertices as an earlier one
  std::int64_t zero_area_triangles = 0;  // area exactly 0 (in double) or not finite
  std::int64_t unreferenced_vertices = 0;
  std::int64_t nonfinite_vertices = 0;
  std::int64_t outside_vertices = 0;  // outside the box

  // ---- Facts.
  std::int64_t vertices = 0;
  std::int64_t triangles = 0;
  std::int64_t edges = 0;
  std::int64_t border_edges = 0;         // in one triangle, on the border
  std::int64_t duplicate_positions = 0;  // vertices that sit exactly where another one does
  double smallest_area = 0;              // of all triangles; 0 for an empty mesh
  double area = 0;
  double volume = 0;  // signed, positive if counter-clockwise seen from outside; closed meshes only
  std::int64_t euler = 0;  // V - E + F of the referenced vertices
  std::int64_t components = 0;
  std::int64_t border_loops = 0;
  // Sum over the components, border loops filled by discs. Absent unless ok().
  std::optional<std::int64_t> genus;

  // The first few faults in words.
  std::vector<std::string> examples;

  bool ok() const;
  // All of the above for a human, several lines.
  std::string summary() const;
};

MeshReport checkMesh(std::span<const glm::vec3> positions, std::span<const std::uint32_t> triangles,
                     const MeshCheckOptions& options = {});
MeshReport checkMesh(std::span<const glm::dvec3> positions,
                     std::span<const std::uint32_t> triangles,
                     const MeshCheckOptions& options = {});

}  // namespace isobrick::test
