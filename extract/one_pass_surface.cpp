#include "isobrick/extract/one_pass_surface.h"

#include <cmath>

#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/session/capped_box.h"
#include "isobrick/extract/session/mesh_pipeline.h"
#include "isobrick/extract/session/query_context.h"
#include "isobrick/extract/session/surface_writer.h"

namespace isobrick {

struct OnePassSurface::Run {
  // Into `into`, or, if that is null, into `mesh`.
  Run(const Pyramid& pyramid, const Query& asked, TriangleSink* into, SurfaceMesh* mesh)
      : query(withCappedBox(pyramid, asked)),
        context(pyramid, query, log),
        joiner(into == nullptr
                   ? std::make_unique<SurfaceJoiner>(*mesh, pyramid.spec().geometry, numbering)
                   : nullptr),
        sink(into == nullptr ? *joiner : *into),
        groups(makeGroupSorter(*context, sink)),
        bricks(finestBricksOf(pyramid.layout(), query)),
        counts(noCounts(pyramid.lattice().levels())) {}

  const Query query;
  ReadLog log;
  const QueryContext context;
  VertexNumbering numbering;
  const std::unique_ptr<SurfaceJoiner> joiner;
  TriangleSink& sink;
  const std::unique_ptr<GroupSorter> groups;
  const IndexBox bricks;  // all that will come
  MeshMemory memory;
  std::vector<LevelCounts> counts;
  double bricks_done = 0;
};

OnePassSurface::OnePassSurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink)
    : run_((checkQuery(pyramid, query), std::make_unique<Run>(pyramid, query, &sink, nullptr))) {
  begin();
}
OnePassSurface::OnePassSurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh)
    : run_((checkQuery(pyramid, query), std::make_unique<Run>(pyramid, query, nullptr, &mesh))) {
  begin();
}

void OnePassSurface::begin() {
  const PyramidSpec& spec = run_->context->pyramid.spec();
  run_->sink.begin({.geometry = spec.geometry,
                    .voxels = spec.voxels,
                    .inside = run_->query.inside,
                    .has_caps = run_->query.cap});
}
OnePassSurface::~OnePassSurface() = default;

void OnePassSurface::mesh(const IndexBox& bricks) {
  const auto all = static_cast<double>(run_->bricks.size());
  const double done = run_->bricks_done + static_cast<double>(bricks.size());
  meshInOrder(*run_->context, traverseFinestBricks(*run_->context, bricks), run_->memory,
              run_->sink, run_->counts, run_->groups.get(), {run_->bricks_done / all, done / all});
  run_->bricks_done = done;
  run_->context->checkCancel();
}

ExtractionReport OnePassSurface::finish() {
  run_->sink.finish();
  return makeReport(run_->context->pyramid, run_->log, run_->counts);
}

IndexBox finestBricksOf(const BrickLayout& layout, const Query& query) {
  const Index3 all = layout.bricks(0);
  if (!query.box) return {Index3(0), all};
  IndexBox bricks;
  for (int axis = 0; axis < 3; ++axis) {
    const auto brickOf = [&](double place, std::int64_t past) {
      const auto edge = static_cast<double>(layout.brickCells());
      return static_cast<std::int64_t>(
          std::clamp(std::floor(place / edge) + static_cast<double>(past), 0.0,
                     static_cast<double>(all[axis])));
    };
    bricks.first[axis] = brickOf(query.box->min[axis], 0);
    bricks.count[axis] =
        std::max<std::int64_t>(0, brickOf(query.box->max[axis], 1) - bricks.first[axis]);
  }
  return bricks;
}

}  // namespace isobrick
