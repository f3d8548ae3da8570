// Bricks meshed in parallel and handed on in order.
#pragma once

#include <tbb/concurrent_queue.h>
#include <tbb/enumerable_thread_specific.h>

#include <memory>
#include <span>
#include <vector>

#include "isobrick/extract/adaptive_mesher.h"
#include "isobrick/extract/brick_work.h"
#include "isobrick/extract/extraction_report.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/extract/uniform_mesher.h"

namespace isobrick {

// What one thread meshes with.
struct MeshWorker {
  UniformMesher uniform;
  AdaptiveMesher adaptive;
};

// Batches that go round: to a mesher, in the order of the work to their receiver, and back.
class BatchRing {
 public:
  explicit BatchRing(std::size_t count);
  std::size_t size() const { return batches_.size(); }
  // Spins until one is idle: the pipeline lets no more jobs run than there are batches.
  PlacedBatch* take();
  void giveBack(PlacedBatch* batch) { idle_.push(batch); }

 private:
  std::vector<std::unique_ptr<PlacedBatch>> batches_;
  tbb::concurrent_queue<PlacedBatch*> idle_;
};

// What stays from query to query. Serves one query at a time.
struct MeshMemory {
  tbb::enumerable_thread_specific<MeshWorker> workers;
  std::unique_ptr<BatchRing> ring;
  bool ring_is_whole = true;  // false after an exception, when batches were lost on their way

  BatchRing& ringOf(std::size_t batches) {
    if (ring == nullptr || ring->size() != batches || !ring_is_whole)
      ring = std::make_unique<BatchRing>(batches);
    return *ring;
  }
};

// Meshes all of `work` on the calling TBB arena. Batches with triangles are counted in
// `counts[level]`, noted as active, and handed to the sink: place() in the order of the work, then
// write(). A few batches for each thread go round, so memory does not grow with the mesh: where the
// sink is slow the meshers wait. Stops early, without a word, where the query is cancelled.
// Rethrows what a mesher or the sink throws.
void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts);

}  // namespace isobrick
