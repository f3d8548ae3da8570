// The surface of a volume that is read once, from its first to its last slice, and is in memory a
// few bricks at a time.
#pragma once

#include <memory>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Meshes bricks as they come by. The sink gets, batch by batch, what Extractor::extract() gives for
// a pyramid of the same volume. For several surfaces, give each run of bricks to one after the
// other. Used by one thread at a time; works on the calling TBB arena.
class OnePassSurface {
 public:
  // The pyramid has level 0 alone (Pyramid's second constructor). It, the sink and what the query
  // names outlive this object. Begins the mesh. Throws Error for a query that needs more than level
  // 0, or makes no sense.
  OnePassSurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink);
  // The same into memory; replaces the contents of `mesh`, which is empty until finish().
  OnePassSurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh);
  ~OnePassSurface();
  OnePassSurface(const OnePassSurface&) = delete;
  OnePassSurface& operator=(const OnePassSurface&) = delete;

  // Meshes these bricks of level 0, which are at hand and follow those of the last call in the
  // order of the brick table. Throws what Extractor::execute() does.
  void mesh(const IndexBox& bricks);
  // Ends the mesh, after all bricks. Nothing counts as read.
  ExtractionReport finish();

 private:
  struct Run;
  void begin();
  const std::unique_ptr<Run> run_;
};

// The bricks of level 0 that a query needs: those that overlap its box. Of no size if there are
// none.
IndexBox finestBricksOf(const BrickLayout& layout, const Query& query);

}  // namespace isobrick
