#include "isobrick/extract/extractor.h"

#include "isobrick/extract/brick_traversal.h"
#include "isobrick/extract/mesh_pipeline.h"
#include "isobrick/extract/query_check.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

std::vector<LevelCounts> noCounts(int levels) {
  std::vector<LevelCounts> counts(static_cast<std::size_t>(levels));
  for (int level = 0; level < levels; ++level)
    counts[static_cast<std::size_t>(level)].level = level;
  return counts;
}

void addBatch(const MeshBatch& batch, LevelCounts& counts) {
  counts.cells += batch.cells;
  counts.transition_cells += batch.transition_cells;
  counts.triangles += batch.triangles.size() / 3;
}

// What the log says of one brick.
void addReads(const Pyramid& pyramid, const ReadLog& log, int level, const Index3& brick,
              ExtractionReport& report) {
  const std::size_t row = pyramid.brickRow(level, brick);
  if (!log.hasAny(row)) return;
  ++report.bricks_read;
  if (log.has(row, ReadLog::kActive)) {
    ++report.bricks_active;
    report.bytes_active += pyramid.sampleBytes(level, brick);
  }
  if (log.has(row, ReadLog::kSamples)) report.bytes_read += pyramid.sampleBytes(level, brick);
  if (log.has(row, ReadLog::kRanges)) report.bytes_read += pyramid.rangeBytes(level, brick);
  if (log.has(row, ReadLog::kCurvature)) report.bytes_read += pyramid.curvatureBytes(brick);
}

ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels) {
  ExtractionReport report;
  for (const LevelCounts& counts : levels) {
    report.triangles += counts.triangles;
    if (counts.triangles > 0) report.levels.push_back(counts);
  }
  for (int level = 0; level < pyramid.lattice().levels(); ++level)
    forEachIndex({Index3(0), pyramid.layout().bricks(level)},
                 [&](const Index3& brick) { addReads(pyramid, log, level, brick, report); });
  return report;
}

}  // namespace

ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink) {
  checkQuery(pyramid, query);
  const FocusOracle focus(pyramid.lattice(), query);
  const WorldFrame frame(pyramid.spec().geometry);
  ReadLog log(pyramid.brickCount());
  const MeshContext context{pyramid, query, focus, frame, static_cast<float>(query.isovalue), log};
  const std::vector<BrickWork> work = traverseBricks(context);

  std::vector<LevelCounts> counts = noCounts(pyramid.lattice().levels());
  sink.begin({pyramid.spec().geometry, pyramid.spec().voxels});
  meshInOrder(context, work, [&](const BrickWork& item, const MeshBatch& batch) {
    if (batch.triangles.empty()) return;
    log.note(pyramid.brickRow(item.level, item.brick), ReadLog::kActive);
    addBatch(batch, counts[static_cast<std::size_t>(item.level)]);
    sink.accept(batch);
  });
  if (query.cancel != nullptr) query.cancel->check();
  sink.finish();
  return makeReport(pyramid, log, counts);
}

}  // namespace isobrick
