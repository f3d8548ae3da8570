#include "tools/picture_mesh.h"

#include <algorithm>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tools/interrupt.h"
#include "tools/measured_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

IndexedMesh extractMesh(const Pyramid& pyramid, const Query& query) {
  ProgressBar bar(0, "million triangles");
  IndexedMeshSink mesh_sink;
  MeasuredSink measured(mesh_sink, bar);
  extractIsosurface(pyramid, query, measured);
  return mesh_sink.takeMesh();
}

}  // namespace

PictureMesh extractPictureMesh(const QueryOptions& options) {
  const Pyramid pyramid(options.path, options.memory_bytes, fileAccess(options.no_map));
  const Query query = makeQuery(options, pyramid);
  IndexedMesh mesh = extractMesh(pyramid, query);
  warnOfEmptySurface(options, pyramid);

  const GridGeometry& geometry = pyramid.spec().geometry;
  const glm::dvec3 center =
      geometry.indexToWorld(glm::dvec3(pyramid.spec().voxels - Index3(1)) / 2.0);
  PictureMesh result;
  result.positions.reserve(mesh.positions.size());
  constexpr std::size_t kVerticesPerLook = 1 << 16;
  for (const glm::dvec3& position : mesh.positions) {
    if (result.positions.size() % kVerticesPerLook == 0) interruptFlag().check();
    result.positions.emplace_back(position - center);
  }
  result.normals = std::move(mesh.normals);
  result.triangles = std::move(mesh.triangles);
  result.triangle_levels = std::move(mesh.triangle_levels);
  if (query.focus)
    result.focus = {geometry.indexToWorld(query.focus->center) - center,
                    query.focus->radius *
                        std::min({geometry.spacing.x, geometry.spacing.y, geometry.spacing.z})};
  return result;
}

}  // namespace isobrick
