#include "isobrick/extract/extractor.h"

#include <algorithm>

#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/mesh_pipeline.h"
#include "isobrick/extract/query_check.h"
#include "isobrick/extract/surface_joiner.h"
#include "isobrick/extract/surface_writer.h"

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
  QueryContext(const Pyramid& pyramid, const Query& query, ReadLog& log)
      : oracles_(
            oraclesOf(pyramid.lattice(), pyramid.spec().geometry, pyramid.valueRange(), query)),
        frame_(pyramid.spec().geometry, pyramid.valueRange()),
        context_{pyramid,          query, oracles_, frame_, static_cast<float>(query.isovalue), log,
                 pyramid.edition()} {
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
};

Extractor::Extractor(const Pyramid& pyramid)
    : pyramid_(&pyramid), memory_(std::make_unique<Memory>()) {}
Extractor::~Extractor() = default;
Extractor::Extractor(Extractor&&) noexcept = default;

ExtractionPlan Extractor::plan(const Query& query) const {
  checkQuery(*pyramid_, query);
  ExtractionPlan plan;
  plan.query_ = query;
  const QueryContext context(*pyramid_, query, memory_->log);
  plan.bricks_ = traverseBricks(*context);
  return plan;
}

ExtractionReport Extractor::execute(const ExtractionPlan& plan, std::size_t first,
                                    std::size_t count, TriangleSink& sink) {
  // The ranges of a plan are one query.
  if (first == 0) pyramid_->beginQuery();
  const QueryContext context(*pyramid_, plan.query(), memory_->log);
  const std::span<const BrickWork> bricks = plan.bricks();
  first = std::min(first, bricks.size());
  std::vector<LevelCounts> counts = noCounts(pyramid_->lattice().levels());
  sink.begin({pyramid_->spec().geometry, pyramid_->spec().voxels});
  meshInOrder(*context, bricks.subspan(first, std::min(count, bricks.size() - first)),
              memory_->mesh, sink, counts);
  if (plan.query().cancel != nullptr) plan.query().cancel->check();
  (*context).throwIfWrittenOver();
  sink.finish();
  return makeReport(*pyramid_, memory_->log, counts);
}

ExtractionReport Extractor::extract(const Query& query, TriangleSink& sink) {
  const ExtractionPlan whole = plan(query);
  return execute(whole, 0, whole.bricks().size(), sink);
}

ExtractionReport Extractor::extract(const Query& query, SurfaceMesh& mesh) {
  // Before anything can fail: it empties the mesh.
  SurfaceWriter writer(mesh, pyramid_->spec().geometry, memory_->surface);
  const ExtractionPlan whole = plan(query);
  if (SurfaceWriter::canWrite(whole.bricks())) {
    pyramid_->beginQuery();
    const QueryContext context(*pyramid_, whole.query(), memory_->log);
    const LevelCounts counts = writer.run(*context, whole.bricks());
    return makeReport(*pyramid_, memory_->log, {counts});
  }
  SurfaceJoiner joiner(mesh, pyramid_->spec().geometry, memory_->numbering);
  return execute(whole, 0, whole.bricks().size(), joiner);
}

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink) {
  return Extractor(pyramid).extract(query, sink);
}

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh) {
  return Extractor(pyramid).extract(query, mesh);
}

}  // namespace isobrick
