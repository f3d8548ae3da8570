// The part of a surface that paths between two points may lie in.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/vec3.hpp>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// All points from which two points, its foci, are together no further than `sum`. World units.
struct Ellipsoid {
  glm::dvec3 from{0.0}, to{0.0};
  double sum = 0.0;

  // The least box of voxel indices around it.
  QueryBox box(const GridGeometry& geometry) const;
};

// More triangles than there may be.
struct TooMuchSurface {};

// Passes on the triangles of a surface that reach into an ellipsoid, and a few beside it.
class NearSurface : public TriangleSink {
 public:
  // `sink` outlives it.
  NearSurface(const Ellipsoid& ellipsoid, std::uint64_t most_triangles, TriangleSink& sink)
      : ellipsoid_(ellipsoid), most_triangles_(most_triangles), sink_(sink) {}

  void begin(const MeshFrame& frame) override;
  void prepare(PlacedBatch& placed) override;
  void place(PlacedBatch& placed) override { sink_.place(placed); }
  void write(PlacedBatch& placed) override { sink_.write(placed); }
  void finish() override { sink_.finish(); }

 private:
  const Ellipsoid ellipsoid_;
  const std::uint64_t most_triangles_;
  TriangleSink& sink_;
  WorldPlacement placement_;
  std::atomic<std::uint64_t> triangles_{0};
};

}  // namespace isobrick
