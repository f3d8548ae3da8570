#include "isobrick/extract/extractor.h"

#include <algorithm>
#include <cmath>

#include "isobrick/extract/paging/brick_fetcher.h"
#include "isobrick/extract/paging/missing_bricks.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/session/capped_box.h"
#include "isobrick/extract/session/mesh_pipeline.h"
#include "isobrick/extract/session/query_context.h"
#include "isobrick/extract/session/surface_writer.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
struct Extractor::Memory {
  explicit Memory(const Pyramid& of) : pyramid(of) {}

  const Pyramid& pyramid;
  MeshMemory mesh;
  SurfaceWriterMemory surface;
  VertexNumbering numbering;
  ReadLog log;
  BrickFetcher fetcher;
  // For the run of progressive queries of the same surface.
  std::optional<SurfaceChoice> asked_for;
  std::uint64_t asked_since = 0;  // number of the first

  // A progressive query begins. The parts that the queries of its run took and fetched stay for it:
  // returns the number of the first of these queries.
  std::uint64_t beginProgressiveQuery(const Query& query) {
    const bool goes_on = asked_for && *asked_for == query;
    if (!goes_on) fetcher.takeBack();
    fetcher.beginQuery();
    const std::uint64_t number = pyramid.parts().beginQuery();
    if (!goes_on) asked_since = number;
    asked_for = query;
    return asked_since;
  }
  // Another query begins.
  void endProgressiveQueries() {
    fetcher.takeBack();
    asked_for.reset();
  }

  ExtractionReport meshInto(const MeshContext& context, std::span<const BrickWork> bricks,
                            TriangleSink& sink) {
    std::vector<LevelCounts> counts = noCounts(context.lattice().levels());
    const PyramidSpec& spec = context.pyramid.spec();
    sink.begin({.geometry = spec.geometry,
                .voxels = spec.voxels,
                .has_missing = spec.has_missing,
                .inside = context.query.inside,
                .has_caps = context.query.cap});
    const std::unique_ptr<GroupSorter> groups = makeGroupSorter(context, sink);
    meshInOrder(context, bricks, mesh, sink, counts, groups.get());
    context.checkCancel();
    context.throwIfWrittenOver();
    sink.finish();
    return makeReport(context.pyramid, log, counts);
  }
  // `writer`: of the mesh.
  ExtractionReport meshInto(const MeshContext& context, std::span<const BrickWork> bricks,
                            SurfaceMesh& into, SurfaceWriter& writer) {
    if (!context.query.simplify && !context.query.has_brick && !context.query.cap &&
        context.region == nullptr && SurfaceWriter::canWrite(bricks)) {
      const LevelCounts counts = writer.run(context, bricks);
      return makeReport(context.pyramid, log, {counts});
    }
    SurfaceJoiner joiner(into, context.pyramid.spec().geometry, numbering);
    return meshInto(context, bricks, joiner);
  }

  // A progressive query. `mesher`: meshInto() to the place that the caller chose.
  template <typename Mesher>
  ExtractionReport extractProgressively(const Query& query, const Mesher& mesher) try {
    checkQuery(pyramid, query);
    const std::uint64_t since = beginProgressiveQuery(query);
    const QueryNeeds needs(pyramid, query);
    ResidencyOracle residency(needs, query.cancel);
    const QueryContext context(pyramid, query, log, &residency);
    throwIfMissingForever(*context);
    const std::vector<BrickWork> bricks = traverseBricks(*context);
    ExtractionReport report = mesher(*context, bricks);
    report.is_complete = !residency.hasRefused();
    std::vector<MissingBrick> missing;
    if (!report.is_complete) missing = missingBricks(*context);
    fetcher.announce(needs, std::move(missing), since);
    return report;
  } catch (...) {
    fetcher.takeBack();
    throw;
  }

  void throwIfMissingForever(const MeshContext& context) {
    const std::optional<MissingBrick> failed = fetcher.takeFailed();
    if (!failed || !isWanted(context, failed->level, failed->brick)) return;
    context.residency->needs().areMet(
        failed->level, failed->brick,
        answersThatReadRows(pyramid, [&](PartKind kind, int level, const Index3& brick) {
          pyramid.parts().require(kind, level, brick);
          return true;
        }));
  }
};

Extractor::Extractor(const Pyramid& pyramid) : memory_(std::make_unique<Memory>(pyramid)) {}
Extractor::~Extractor() = default;
Extractor::Extractor(Extractor&&) noexcept = default;

ExtractionPlan Extractor::plan(const Query& query) const {
  if (query.is_progressive) throw Error("a progressive query has no plan; extract it");
  checkQuery(memory_->pyramid, query);
  ExtractionPlan plan;
  plan.query_ = withCappedBox(memory_->pyramid, query);
  const QueryContext context(memory_->pyramid, plan.query_, memory_->log);
  plan.bricks_ = traverseBricks(*context);
  return plan;
}

ExtractionReport Extractor::execute(const ExtractionPlan& plan, std::size_t first,
                                    std::size_t count, TriangleSink& sink) {
  memory_->endProgressiveQueries();
  // The ranges of a plan are one query.
  if (first == 0) memory_->pyramid.parts().beginQuery();
  const QueryContext context(memory_->pyramid, plan.query(), memory_->log);
  const std::span<const BrickWork> bricks = plan.bricks();
  first = std::min(first, bricks.size());
  return memory_->meshInto(*context, bricks.subspan(first, std::min(count, bricks.size() - first)),
                           sink);
}

ExtractionReport Extractor::execute(const ExtractionPlan& plan, std::size_t first,
                                    std::size_t count, SurfaceMesh& mesh) {
  SurfaceJoiner joiner(mesh, memory_->pyramid.spec().geometry, memory_->numbering);
  return execute(plan, first, count, joiner);
}

ExtractionReport Extractor::extract(const Query& query, TriangleSink& sink) {
  if (query.is_progressive)
    return memory_->extractProgressively(
        query, [&](const MeshContext& context, std::span<const BrickWork> bricks) {
          return memory_->meshInto(context, bricks, sink);
        });
  const ExtractionPlan whole = plan(query);
  return execute(whole, 0, whole.bricks().size(), sink);
}

ExtractionReport Extractor::extract(const Query& query, SurfaceMesh& mesh) {
  // Before anything can fail: it empties the mesh.
  SurfaceWriter writer(mesh, memory_->pyramid.spec().geometry, memory_->surface);
  const auto write = [&](const MeshContext& context, std::span<const BrickWork> bricks) {
    return memory_->meshInto(context, bricks, mesh, writer);
  };
  if (query.is_progressive) return memory_->extractProgressively(query, write);
  const ExtractionPlan whole = plan(query);
  memory_->endProgressiveQueries();
  memory_->pyramid.parts().beginQuery();
  const QueryContext context(memory_->pyramid, whole.query(), memory_->log);
  return write(*context, whole.bricks());
}

bool Extractor::waitForBricks(std::chrono::nanoseconds longest) {
  return memory_->fetcher.wait(longest);
}

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink) {
  return Extractor(pyramid).extract(query, sink);
}

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh) {
  return Extractor(pyramid).extract(query, mesh);
}

namespace {

// Distances are tried from the least on, each so many times the one before, in voxels: below the
// first nothing collapses, above the last nothing more.
constexpr double kLeastDistance = 1e-3, kGreatestDistance = 1024, kDistanceStep = 4;
// Between the last distance that is too small and the first that is not.
constexpr int kMostHalvings = 6;
// As near as this below the number that is asked for is near enough.
constexpr double kEnough = 0.97;

}  // namespace

std::optional<SimplifyOptions> findSimplification(Extractor& extractor, Query query,
                                                  std::uint64_t triangles) {
  TriangleSink nowhere;
  SimplifyOptions options;
  options.drop_small = query.simplify && query.simplify->drop_small;
  query.is_progressive = false;
  const auto countAt = [&](std::optional<double> distance) {
    query.simplify.reset();
    if (distance) {
      options.distance = *distance;
      query.simplify = options;
    }
    return extractor.extract(query, nowhere).triangles;
  };
  if (countAt(std::nullopt) <= triangles) return std::nullopt;
  // More distance may bring more triangles: on flat faces, say, where the least is enough. So the
  // search comes from below, and the least distance that is enough is the best.
  double low = 0, high = kLeastDistance;
  std::uint64_t count = countAt(high);
  while (count > triangles && high < kGreatestDistance) {
    low = high;
    high *= kDistanceStep;
    count = countAt(high);
  }
  if (count > triangles)
    throw Error(
        "simplification leaves more triangles than that; ask for more triangles, or for a "
        "coarser level");
  const double enough = kEnough * static_cast<double>(triangles);
  for (int n = 0; n < kMostHalvings && low > 0 && static_cast<double>(count) < enough; ++n) {
    const double middle = std::sqrt(low * high);
    const std::uint64_t at_middle = countAt(middle);
    if (at_middle > triangles) {
      low = middle;
    } else {
      high = middle;
      count = at_middle;
    }
  }
  options.distance = high;
  return options;
}

}  // namespace isobrick
