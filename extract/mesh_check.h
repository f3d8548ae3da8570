// Is a mesh fit for a printer or a simulation? Looked at while it is written.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// What a mesh is like. Edges are those between distinct vertices.
struct MeshQuality {
  std::uint64_t vertices = 0;           // distinct ones
  std::uint64_t edges = 0;              // likewise
  std::uint64_t triangles = 0;          // of the mesh
  std::uint64_t open_edges = 0;         // in one triangle
  std::uint64_t nonmanifold_edges = 0;  // in more than two
  std::uint64_t misoriented_edges = 0;  // in two, the same way round in both
  std::uint64_t boundary_loops = 0;     // connected pieces of the open edges
  std::uint64_t zero_area = 0;          // triangles without area
  // Triangles that pass through another one of their brick, or touch it beside common vertices.
  // Bricks have no inner point in common, so that those of two bricks do not cross.
  std::uint64_t crossing = 0;
  double area = 0;         // world units^2
  double volume = 0;       // enclosed, world units^3; 0 unless the mesh is a solid's
  std::int64_t euler = 0;  // vertices - edges + triangles
  double least_angle = 0;  // degrees
  // Longest side, times the perimeter, over 4 sqrt(3) times the area: 1 for equal sides. Of
  // triangles with an area.
  double mean_aspect = 0;
  double worst_aspect = 0;  // likewise

  // Every edge is in two triangles, or in more.
  bool isClosed() const { return open_edges == 0; }
  // No edge is in more than two. Vertices may still join surfaces that touch there.
  bool isManifold() const { return nonmanifold_edges == 0; }
  // Triangles beside each other have the same side outward.
  bool isOriented() const { return misoriented_edges == 0; }
  // The border of a solid, as programs that fill it with tetrahedra want it.
  bool isSolid() const {
    return triangles > 0 && isClosed() && isManifold() && isOriented() && zero_area == 0 &&
           crossing == 0;
  }
  bool operator==(const MeshQuality&) const = default;  // equal in all
};

// A stage before a sink that passes all on as it is. Memory: 24 bytes for each edge between bricks
// in each of these, and for each open edge; some 5 bytes a triangle in bricks of 64 cells, more if
// they are simplified. The result does not depend on the number of threads.
class MeshCheck : public TriangleSink {
 public:
  // `sink` outlives it.
  explicit MeshCheck(TriangleSink& sink);
  ~MeshCheck() override;

  void begin(const MeshFrame& frame) override;
  bool takesRemains() const override { return sink_.takesRemains(); }
  void prepare(PlacedBatch& placed) override { sink_.prepare(placed); }
  void place(PlacedBatch& placed) override;
  void write(PlacedBatch& placed) override;
  void finish() override { sink_.finish(); }

  // After finish().
  MeshQuality quality() const;

 private:
  struct Found;
  TriangleSink& sink_;
  WorldPlacement placement_;
  glm::dvec3 middle_{0.0};
  const std::unique_ptr<Found> found_;
};

}  // namespace isobrick
