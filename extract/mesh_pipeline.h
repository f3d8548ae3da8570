// Bricks meshed in parallel and handed on in order.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
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

// Batches that go round: to a mesher, in the order of the work to their receiver, and back. What
// was given back last is taken first, so that no more of them grow than are under way at once.
//
// Where those that are meshed and not written yet hold more than kMostBytes, meshers wait, but for
// the one whose batch is the next in the order: so there is always one that goes on. What comes on
// top is one batch for each thread, and what idle ones keep, as much again at the most. All members
// are thread-safe.
class BatchRing {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{16} << 20;

  explicit BatchRing(std::size_t count);
  std::size_t size() const { return batches_.size(); }

  // Nothing is under way. Batches that an exception kept from coming back are idle again.
  void begin();
  // There is always one: the pipeline lets no more jobs run than there are batches.
  PlacedBatch* take();
  // Waits until the batch of this job of the work may be meshed. False where another thread has
  // failed, or the query is cancelled.
  bool waitForRoom(std::size_t work, const CancelFlag* cancel);
  // It is meshed.
  void add(std::uint64_t bytes);
  // Jobs before this one have been placed.
  void notePlaced(std::size_t work);
  // One of whose bytes these were added.
  void giveBack(PlacedBatch* batch, std::uint64_t bytes);
  // Nothing goes on any more.
  void fail();

 private:
  std::vector<std::unique_ptr<PlacedBatch>> batches_;
  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::vector<PlacedBatch*> idle_;
  std::uint64_t idle_bytes_ = 0;  // that they keep
  std::uint64_t bytes_ = 0;       // of those that are meshed
  std::size_t placed_ = 0;
  bool has_failed_ = false;
};

// What stays from query to query. Serves one query at a time.
struct MeshMemory {
  tbb::enumerable_thread_specific<MeshWorker> workers;
  std::unique_ptr<BatchRing> ring;

  BatchRing& ringOf(std::size_t batches) {
    if (ring == nullptr || ring->size() != batches) ring = std::make_unique<BatchRing>(batches);
    return *ring;
  }
};

// Meshes all of `work` on the calling TBB arena. Batches with triangles are counted in
// `counts[level]`, noted as active, and handed to the sink: place() in the order of the work, then
// write(). A few batches for each thread go round, so memory does not grow with the mesh: where the
// sink is slow, or batches are large, the meshers wait. Stops early, without a word, where the
// query is cancelled. Rethrows what a mesher or the sink throws.
void meshInOrder(const MeshContext& context, std::span<const BrickWork> work, MeshMemory& memory,
                 TriangleSink& sink, std::vector<LevelCounts>& counts);

}  // namespace isobrick
