// A query and a pyramid in, triangles out.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <vector>

#include "isobrick/extract/extraction_plan.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// A session on one pyramid: keeps what threads work with from query to query, so that a second
// query touches no fresh memory. One object serves one call at a time; for several queries at once
// on a pyramid make several. The pyramid must outlive it.
//
// What a query costs depends on what comes out: nothing is done for every brick of the file.
class Extractor {
 public:
  // Reads nothing yet.
  explicit Extractor(const Pyramid& pyramid);
  ~Extractor();
  Extractor(Extractor&&) noexcept;

  // The bricks that a query needs. Throws Error for a query that makes no sense for this pyramid
  // (level out of range, no curvature stored, a number that is not finite), for one for now, whose
  // bricks depend on the moment, and Cancelled.
  ExtractionPlan plan(const Query& query) const;

  // Meshes the bricks [first, first + count) of a plan of this pyramid into `sink`. Bricks are
  // paged in on demand, the work is spread over the calling TBB arena. The result depends on the
  // query alone: not on threads, cache size or what was extracted before. The batches of ranges
  // that follow each other are those of the whole plan, so ranges may be executed by different
  // extractors, at the same time, and joined by their edge keys.
  //
  // The mesh of the whole plan is closed and oriented away from the volume's border (rule 11).
  // Throws Error for a damaged brick, Cancelled, and whatever the sink throws. Only the query's
  // flag cancels it: inside a TBB task whose group is cancelled it goes on to its end.
  ExtractionReport execute(const ExtractionPlan& plan, std::size_t first, std::size_t count,
                           TriangleSink& sink);

  // Plan and execution of the whole query. One for now (Query::is_progressive) is answered at once,
  // from what is resident: report.is_complete says whether that is what the query without `now`
  // gives, to the byte. What was lacking then comes in beside the caller's work, first what refines
  // the surface near the focus or the eye, as long as it fits into the pyramid's budget beside what
  // this query, asked for any number of times, used and fetched; so the same query again refines:
  //
  //   do report = extractor.extract(query, mesh);
  //   while (!report.is_complete && extractor.waitForBricks(std::chrono::milliseconds(50)));
  //
  // Any other query, and a request to cancel one, takes that back. Throws Error for a brick that
  // the query needs and that could not be had meanwhile.
  ExtractionReport extract(const Query& query, TriangleSink& sink);
  // The same into memory, in the place of what `mesh` held. After an exception the mesh is empty.
  // The parts and every byte depend on the query alone.
  ExtractionReport extract(const Query& query, SurfaceMesh& mesh);

  // Waits until all has come in that the latest progressive query lacked, at most `longest`. False
  // where nothing has come in since, and nothing will: all was there, it could not be had, or the
  // budget has no room for it.
  bool waitForBricks(std::chrono::nanoseconds longest);

 private:
  struct Memory;
  std::unique_ptr<Memory> memory_;
};

// One query without a session.
ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink);
// One query without a session, into memory.
ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh);

}  // namespace isobrick
