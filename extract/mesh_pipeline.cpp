#include "isobrick/extract/mesh_pipeline.h"

#include <tbb/concurrent_queue.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <memory>

#include "isobrick/extract/adaptive_mesher.h"
#include "isobrick/extract/uniform_mesher.h"

namespace isobrick {
namespace {

// Batches that may wait for their turn, for every thread.
constexpr std::size_t kBatchesPerThread = 4;

// What one thread meshes with.
struct Worker {
  UniformMesher uniform;
  AdaptiveMesher adaptive;

  void mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
    if (work.adaptive)
      adaptive.mesh(context, work, batch);
    else
      uniform.mesh(context, work, batch);
  }
};

// Batches that go round: to a mesher, in the order of the work to their receiver, and back.
class BatchRing {
 public:
  explicit BatchRing(std::size_t count) : batches_(count) {
    for (auto& batch : batches_) {
      batch = std::make_unique<MeshBatch>();
      idle_.push(batch.get());
    }
  }
  // Spins until one is idle: the pipeline lets no more jobs run than there are batches.
  MeshBatch* take() {
    MeshBatch* batch = nullptr;
    while (!idle_.try_pop(batch)) {
    }
    return batch;
  }
  void giveBack(MeshBatch* batch) { idle_.push(batch); }

 private:
  std::vector<std::unique_ptr<MeshBatch>> batches_;
  tbb::concurrent_queue<MeshBatch*> idle_;
};

struct Job {
  std::size_t work = 0;
  MeshBatch* batch = nullptr;
};

}  // namespace

void meshInOrder(const MeshContext& context, const std::vector<BrickWork>& work,
                 const std::function<void(const BrickWork&, const MeshBatch&)>& deliver) {
  const CancelFlag* cancel = context.query.cancel;
  const auto in_flight =
      kBatchesPerThread * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  BatchRing ring(in_flight);
  tbb::enumerable_thread_specific<Worker> workers;
  std::size_t next = 0;

  const auto take = [&](tbb::flow_control& control) -> Job {
    if (next == work.size() || (cancel != nullptr && cancel->requested())) {
      control.stop();
      return {};
    }
    return {next++, ring.take()};
  };
  const auto mesh = [&](Job job) {
    MeshBatch& batch = *job.batch;
    batch.clear();
    batch.level = work[job.work].level;
    batch.fraction_done = static_cast<double>(job.work + 1) / static_cast<double>(work.size());
    workers.local().mesh(context, work[job.work], batch);
    context.pyramid.throwIfReadsFailed();
    return job;
  };
  const auto handOn = [&](Job job) {
    deliver(work[job.work], *job.batch);
    ring.giveBack(job.batch);
  };
  tbb::parallel_pipeline(
      in_flight, tbb::make_filter<void, Job>(tbb::filter_mode::serial_in_order, take) &
                     tbb::make_filter<Job, Job>(tbb::filter_mode::parallel, mesh) &
                     tbb::make_filter<Job, void>(tbb::filter_mode::serial_in_order, handOn));
}

}  // namespace isobrick
