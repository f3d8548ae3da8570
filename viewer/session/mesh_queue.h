// Mesh files that are written beside the interface, one after the other.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/component_choice.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {

struct MeshOrder {
  std::shared_ptr<const Pyramid> pyramid;  // shared until its mesh is written
  Query query;
  std::string path;
  PieceChoice pieces = {};  // of the surface that go into the mesh
};

// An order depends on nothing that the user does later: not on another order, another volume or the
// loss of the graphics card. All members are for one thread and never wait, but the destructor,
// which gives up what is not written, waits for the end of the one under way.
class MeshQueue {
 public:
  struct Outcome {
    std::string path;
    std::string error;  // empty: the file is there
  };

  // `threads`: of an extraction.
  explicit MeshQueue(int threads);

  void add(MeshOrder order);
  // Each once. Begins the next order.
  std::optional<Outcome> poll();
  // Orders that have not ended, or whose outcome was not polled.
  std::size_t unwritten() const { return waiting_.size() + (under_way_.empty() ? 0 : 1); }
  // The file that is being written; empty: none.
  const std::string& underWay() const { return under_way_; }
  bool willWrite(const std::string& path) const;

 private:
  void beginNext();

  std::deque<MeshOrder> waiting_;
  std::string under_way_;
  LatestWorker<MeshOrder, std::string> worker_;
};

}  // namespace isobrick
