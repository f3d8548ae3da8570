// A query and a pyramid in, triangles out.
#pragma once

#include <chrono>
#include <memory>
#include <optional>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// A session on one pyramid: keeps the memory that threads work with from query to query, so that a
// second query touches no fresh memory. One object serves one call at a time; for several queries
// at once on a pyramid make several. The pyramid must outlive it.
//
// The cost of a query depends on its result: nothing is done for every brick of the file.
class Extractor {
 public:
  // Reads nothing yet.
  explicit Extractor(const Pyramid& pyramid);
  ~Extractor();
  Extractor(Extractor&&) noexcept;

  // The bricks that a query needs. Throws Error for a query that makes no sense for this pyramid
  // (level out of range, no curvature stored, a number that is not finite) and for a progressive
  // one, whose bricks depend on the moment. Throws Cancelled.
  ExtractionPlan plan(const Query& query) const;

  // Meshes the bricks [first, first + count) of a plan of this pyramid into `sink`. Bricks are
  // paged in on demand, the work is spread over the calling TBB arena. The result depends on the
  // query alone: not on threads, cache size or earlier queries. The batches of ranges that follow
  // each other are those of the whole plan, so ranges may be executed by different extractors, at
  // the same time, and joined by their edge keys.
  //
  // The mesh of the whole plan is closed and oriented away from the volume's border (rule 11), and
  // there too if Query::cap is set.
  // Throws Error for a damaged brick, Cancelled, and whatever the sink throws. Only the query's
  // flag cancels it: inside a TBB task whose group is cancelled it goes on to its end.
  ExtractionReport execute(const ExtractionPlan& plan, std::size_t first, std::size_t count,
                           TriangleSink& sink);
  // The same into memory; replaces the contents of `mesh`, which is open where other bricks of the
  // plan go on.
  ExtractionReport execute(const ExtractionPlan& plan, std::size_t first, std::size_t count,
                           SurfaceMesh& mesh);

  // Plan and execution of the whole query. A progressive one (Query::is_progressive) is answered at
  // once from the bricks in memory. report.is_complete says whether the answer is, byte by byte,
  // that of the same query that is not progressive. The missing bricks are then read in the
  // background: first those that refine the surface near the focus or the eye. They come as long as
  // they fit into the pyramid's budget beside the bricks that this query used and fetched, however
  // often it was repeated. So the same query again refines:
  //
  //   do report = extractor.extract(query, mesh);
  //   while (!report.is_complete && extractor.waitForBricks(std::chrono::milliseconds(50)));
  //
  // Any other query, and a request to cancel one, stops this reading. Throws Error for a brick that
  // the query needs and that could not be read meanwhile.
  ExtractionReport extract(const Query& query, TriangleSink& sink);
  // The same into memory; replaces the contents of `mesh`. After an exception the mesh is empty.
  // The parts and every byte depend on the query alone.
  ExtractionReport extract(const Query& query, SurfaceMesh& mesh);

  // Waits, at most `longest`, until all bricks have come in that the latest progressive query
  // lacked. False if none has come in since and none will: all were there, they could not be read,
  // or the budget has no room for them.
  bool waitForBricks(std::chrono::nanoseconds longest);

 private:
  struct Memory;
  std::unique_ptr<Memory> memory_;
};

// One query without a session.
ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, TriangleSink& sink);
// One query without a session, into memory.
ExtractionReport extractIsosurface(const Pyramid& pyramid, const Query& query, SurfaceMesh& mesh);

// The distance in voxels at which the query's simplified surface has at most `triangles` triangles,
// above 0, and not many fewer; none if the surface has no more without simplification. Only
// drop_small of query.simplify counts. The surface is extracted some ten times. Throws as
// Extractor::extract() does, and Error if no distance leaves so few: vertices that bricks share
// always stay.
std::optional<SimplifyOptions> findSimplification(Extractor& extractor, Query query,
                                                  std::uint64_t triangles);

}  // namespace isobrick
