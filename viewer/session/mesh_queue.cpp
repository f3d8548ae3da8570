#include "isobrick/viewer/session/mesh_queue.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"

namespace isobrick {
namespace {

std::string writeMeshFile(const MeshOrder& order, int threads, const CancelFlag& cancel) {
  Query query = order.query;
  query.cancel = &cancel;
  tbb::task_arena arena(threads);
  arena.execute([&] {
    const auto sink = makeMeshFileSink(order.path, {.cancel = &cancel});
    if (order.pieces.isAll()) {
      extractIsosurface(*order.pyramid, query, *sink);
    } else {
      Extractor extractor(*order.pyramid);
      extractChosen(extractor, query, order.pieces, *sink);
    }
  });
  return order.path;
}

}  // namespace

MeshQueue::MeshQueue(int threads)
    : worker_([threads](const MeshOrder& order, const CancelFlag& cancel) {
        return writeMeshFile(order, threads, cancel);
      }) {}

void MeshQueue::add(MeshOrder order) {
  waiting_.push_back(std::move(order));
  beginNext();
}

// A request would end the one under way, so it waits for the outcome of that.
void MeshQueue::beginNext() {
  if (!under_way_.empty() || waiting_.empty()) return;
  worker_.request(waiting_.front());
  under_way_ = waiting_.front().path;
  waiting_.pop_front();
}

std::optional<MeshQueue::Outcome> MeshQueue::poll() {
  auto outcome = worker_.poll();
  if (!outcome) return std::nullopt;
  Outcome ended{outcome->request.path, outcome->error};
  under_way_.clear();
  beginNext();
  return ended;
}

bool MeshQueue::willWrite(const std::string& path) const {
  return under_way_ == path ||
         std::any_of(waiting_.begin(), waiting_.end(),
                     [&](const MeshOrder& order) { return order.path == path; });
}

}  // namespace isobrick
