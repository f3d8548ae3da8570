#include "isobrick/extract/session/surface_joiner.h"

#include <algorithm>

namespace isobrick {

SurfaceJoiner::SurfaceJoiner(SurfaceMesh& mesh, const GridGeometry& geometry,
                             VertexNumbering& numbering)
    : mesh_(mesh), numbering_(numbering) {
  mesh.clear(geometry);
  parts_.swap(mesh.parts_);
  numbering.clear();
}

void SurfaceJoiner::place(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  placed.first_triangle = triangles_;
  numbering_.place(placed);
  triangles_ += batch.triangles.size() / 3;
  mesh_.openFor(numbering_.count(), triangles_);
  parts_.push_back({placed.first_vertex, numbering_.count() - placed.first_vertex,
                    placed.first_triangle, batch.triangles.size() / 3, batch.origin, batch.level});
}

void SurfaceJoiner::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t number) {
    std::copy(&batch.positions[begin], &batch.positions[begin] + (end - begin),
              mesh_.positionData() + number);
    std::copy(&batch.normals[begin], &batch.normals[begin] + (end - begin),
              mesh_.normalData() + number);
  });
  findNumbers(placed);
  std::uint32_t* out = mesh_.triangleData() + 3 * placed.first_triangle;
  for (const std::uint32_t vertex : batch.triangles) *out++ = placed.numbers[vertex];
}

void SurfaceJoiner::finish() {
  mesh_.parts_.swap(parts_);
  mesh_.vertices_ = numbering_.count();
  mesh_.triangles_ = triangles_;
}

}  // namespace isobrick
