#include "isobrick/extract/session/query_context.h"

namespace isobrick {
namespace {

// Adds the log's entry of one brick to the report.
void addReads(const PyramidParts& parts, const ReadLog::Entry& entry, ExtractionReport& report) {
  const auto [level, brick] = parts.brickAt(entry.brick_row);
  const BrickRow row = parts.brickRowOf(level, brick);
  ++report.bricks_read;
  if ((entry.marks & ReadLog::kActive) != 0) {
    ++report.bricks_active;
    report.bytes_active += row.part(PartKind::kSamples).stored_bytes;
  }
  for (const PartKind kind : kPartKinds)
    if ((entry.marks & ReadLog::markOf(kind)) != 0)
      report.bytes_read += row.part(kind).stored_bytes;
}

}  // namespace

std::vector<LevelCounts> noCounts(int levels) {
  std::vector<LevelCounts> counts(static_cast<std::size_t>(levels));
  for (int level = 0; level < levels; ++level)
    counts[static_cast<std::size_t>(level)].level = level;
  return counts;
}

ExtractionReport makeReport(const Pyramid& pyramid, const ReadLog& log,
                            const std::vector<LevelCounts>& levels) {
  ExtractionReport report;
  for (const LevelCounts& counts : levels) {
    report.triangles += counts.triangles;
    if (counts.triangles > 0) report.levels.push_back(counts);
  }
  for (const ReadLog::Entry& entry : log.entries()) addReads(pyramid.parts(), entry, report);
  return report;
}

}  // namespace isobrick
