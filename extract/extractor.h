// A query and a pyramid in, triangles out.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

struct LevelCounts {
  int level = 0;
  std::uint64_t cells = 0;  // leaves with at least one triangle
  std::uint64_t triangles = 0;
  std::uint64_t transition_cells = 0;  // cells whose triangles are fans
};

struct ExtractionReport {
  std::uint64_t triangles = 0;
  std::vector<LevelCounts> levels;  // those with triangles, finest first
  std::uint64_t bricks_active = 0;  // bricks with at least one triangle
  std::uint64_t bricks_read = 0;    // bricks of which any part was asked for
  std::uint64_t bytes_active = 0;   // stored bytes of the samples of active bricks
  std::uint64_t bytes_read = 0;     // stored bytes of all parts asked for, each counted once
};

// Extracts the isosurface into `sink`. One traversal, bricks paged in on demand, the work spread
// over the calling TBB arena. The result depends on the query alone: not on threads, cache size or
// what was extracted before. Several extractions may run on one pyramid at the same time.
//
// The mesh is closed and oriented away from the volume's border (rule 11). Throws Error for a query
// that makes no sense for this pyramid (level out of range, no curvature stored, a number that is
// not finite) or a damaged brick, Cancelled, and whatever the sink throws.
ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink);

}  // namespace isobrick
