#include "isobrick/extract/extractor.h"

#include <algorithm>

#include "isobrick/extract/paging/brick_fetcher.h"
#include "isobrick/extract/paging/missing_bricks.h"
#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/extract/session/mesh_pipeline.h"
#include "isobrick/extract/session/query_check.h"
#include "isobrick/extract/session/surface_joiner.h"
#include "isobrick/extract/session/surface_writer.h"

namespace isobrick {
namespace {

std::vector<LevelCounts> noCounts(int levels) {
  std::vector<LevelCounts> counts(static_cast<std::size_t>(levels));
  for (int level = 0; level < levels; ++level)
    counts[static_cast<std::size_t>(level)].level = level;
  return counts;
}

// What the log says of one brick.
void addReads(const Pyramid& pyramid, const ReadLog::Entry& entry, ExtractionReport& report) {
  const auto [level, brick] = pyramid.brickAt(entry.brick_row);
  ++report.bricks_read;
  if ((entry.marks & ReadLog::kActive) != 0) {
    ++report.bricks_active;
    report.bytes_active += pyramid.sampleBytes(level, brick);
  }
  if ((entry.marks & ReadLog::kSamples) != 0)
    report.bytes_read += pyramid.sampleBytes(level, brick);
  if ((entry.marks & ReadLog::kRanges) != 0) report.bytes_read += pyramid.rangeBytes(level, brick);
  if ((entry.marks & ReadLog::kCurvature) != 0) report.bytes_read += pyramid.curvatureBytes(brick);
  if ((entry.marks & ReadLog::kError) != 0) report.bytes_read += pyramid.errorBytes(level, brick);
}

ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels) {
  ExtractionReport report;
  for (const LevelCounts& counts : levels) {
    report.triangles += counts.triangles;
    if (counts.triangles > 0) report.levels.push_back(counts);
  }
  for (const ReadLog::Entry& entry : log.entries()) addReads(pyramid, entry, report);
  return report;
}

// What the workers of one query read.
class QueryContext {
 public:
  QueryContext(const Pyramid& pyramid, const Query& query, ReadLog& log,
               ResidencyOracle* residency = nullptr)
      : oracles_(oraclesOf(pyramid, query)),
        frame_(pyramid.spec().geometry, pyramid.valueRange()),
        context_{
            pyramid,           query,    oracles_, frame_, static_cast<float>(query.isovalue), log,
            pyramid.edition(), residency} {
    log.clear();
  }
  QueryContext(const QueryContext&) = delete;

  const MeshContext& operator*() const { return context_; }

 private:
  const std::vector<ChoiceOracles> oracles_;
  const WorldFrame frame_;
  const MeshContext context_;
};

}  // namespace

struct Extractor::Memory {
  MeshMemory mesh;
  SurfaceWriterMemory surface;
  VertexNumbering numbering;
  ReadLog log;
  BrickFetcher fetcher;
  // Of the run of queries for now that ask for the same surface.
  std::optional<Query> asked_for;
  std::uint64_t asked_since = 0;  // number of the first

  // A query for now begins. What the queries of its run took and fetched stays for it: returns the
  // number of the first of them.
  std::uint64_t beginQueryForNow(const Pyramid& pyramid, const Query& query) {
    const bool goes_on = asked_for && asksForTheSame(*asked_for, query);
    if (!goes_on) fetcher.takeBack();
    fetcher.beginQuery();
    const std::uint64_t number = pyramid.beginQuery();
    if (!goes_on) asked_since = number;
    asked_for = query;
    return asked_since;
  }
  // Another query begins.
  void endQueriesForNow() {
    fetcher.takeBack();
    asked_for.reset();
  }

  ExtractionReport meshInto(const MeshContext& context, std::span<const BrickWork> bricks,
                            TriangleSink& sink) {
    std::vector<LevelCounts> counts = noCounts(context.lattice().levels());
    sink.begin({context.pyramid.spec().geometry, context.pyramid.spec().voxels});
    meshInOrder(context, bricks, mesh, sink, counts);
    context.checkCancel();
    context.throwIfWrittenOver();
    sink.finish();
    return makeReport(context.pyramid, log, counts);
  }
  // `writer`: of the mesh.
  ExtractionReport meshInto(const MeshContext& context, std::span<const BrickWork> bricks,
                            SurfaceMesh& into, SurfaceWriter& writer) {
    if (SurfaceWriter::canWrite(bricks)) {
      const LevelCounts counts = writer.run(context, bricks);
      return makeReport(context.pyramid, log, {counts});
    }
    SurfaceJoiner joiner(into, context.pyramid.spec().geometry, numbering);
    return meshInto(context, bricks, joiner);
  }
};

Extractor::Extractor(const Pyramid& pyramid)
    : pyramid_(&pyramid), memory_(std::make_unique<Memory>()) {}
Extractor::~Extractor() = default;
Extractor::Extractor(Extractor&&) noexcept = default;

ExtractionPlan Extractor::plan(const Query& query) const {
  if (query.now) throw Error("a query for now has no plan; extract it");
  checkQuery(*pyramid_, query);
  ExtractionPlan plan;
  plan.query_ = query;
  const QueryContext context(*pyramid_, query, memory_->log);
  plan.bricks_ = traverseBricks(*context);
  return plan;
}

ExtractionReport Extractor::execute(const ExtractionPlan& plan, std::size_t first,
                                    std::size_t count, TriangleSink& sink) {
  memory_->endQueriesForNow();
  // The ranges of a plan are one query.
  if (first == 0) pyramid_->beginQuery();
  const QueryContext context(*pyramid_, plan.query(), memory_->log);
  const std::span<const BrickWork> bricks = plan.bricks();
  first = std::min(first, bricks.size());
  return memory_->meshInto(*context, bricks.subspan(first, std::min(count, bricks.size() - first)),
                           sink);
}

ExtractionReport Extractor::extract(const Query& query, TriangleSink& sink) {
  if (query.now)
    return extractNow(query, [&](const MeshContext& context, std::span<const BrickWork> bricks) {
      return memory_->meshInto(context, bricks, sink);
    });
  const ExtractionPlan whole = plan(query);
  return execute(whole, 0, whole.bricks().size(), sink);
}

ExtractionReport Extractor::extract(const Query& query, SurfaceMesh& mesh) {
  // Before anything can fail: it empties the mesh.
  SurfaceWriter writer(mesh, pyramid_->spec().geometry, memory_->surface);
  const Mesher write = [&](const MeshContext& context, std::span<const BrickWork> bricks) {
    return memory_->meshInto(context, bricks, mesh, writer);
  };
  if (query.now) return extractNow(query, write);
  const ExtractionPlan whole = plan(query);
  memory_->endQueriesForNow();
  pyramid_->beginQuery();
  const QueryContext context(*pyramid_, whole.query(), memory_->log);
  return write(*context, whole.bricks());
}

ExtractionReport Extractor::extractNow(const Query& query, const Mesher& mesh) try {
  checkQuery(*pyramid_, query);
  const std::uint64_t since = memory_->beginQueryForNow(*pyramid_, query);
  const QueryNeeds needs(*pyramid_, query);
  ResidencyOracle residency(needs, query.cancel);
  const QueryContext context(*pyramid_, query, memory_->log, &residency);
  throwIfMissingForever(*context);
  const std::vector<BrickWork> bricks = traverseBricks(*context);
  ExtractionReport report = mesh(*context, bricks);
  report.is_complete = !residency.hasRefused();
  std::vector<MissingBrick> missing;
  if (!report.is_complete) missing = missingBricks(*context);
  memory_->fetcher.announce(needs, std::move(missing), since);
  return report;
} catch (...) {
  memory_->fetcher.takeBack();
  throw;
}

void Extractor::throwIfMissingForever(const MeshContext& context) {
  const std::optional<MissingBrick> failed = memory_->fetcher.takeFailed();
  if (!failed || !isWanted(context, failed->level, failed->brick)) return;
  QueryNeeds(*pyramid_, context.query)
      .areMet(failed->level, failed->brick,
              BrickAnswers{[&](int level, const Index3& brick) {
                             static_cast<void>(pyramid_->brickRowOf(level, brick));
                             return true;
                           },
                           [&](PartKind kind, int level, const Index3& brick) {
                             pyramid_->require(kind, level, brick);
                             return true;
                           }});
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

}  // namespace isobrick
