// Level 0 of an index (`isobrick build --index`): bricks that lie in the volume that it was made
// of.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_info.h"

namespace isobrick {

// The bricks of level 0, as `isobrick build` would have stored them. All const members are
// thread-safe.
class SourceBricks {
 public:
  SourceBricks() = default;
  virtual ~SourceBricks() = default;
  SourceBricks(const SourceBricks&) = delete;
  SourceBricks& operator=(const SourceBricks&) = delete;

  // The path or URL of the source.
  virtual const std::string& path() const = 0;
  // The most bytes that the source itself holds, such as unpacked chunks that several bricks share.
  virtual std::uint64_t heldBytes() const = 0;
  // Writes the samples of layout().brickSampleBox(0, brick), x fastest. Throws Error that names the
  // source, Cancelled after a request to SourceRequest::cancel.
  virtual void copySamples(const Index3& brick, std::byte* out) const = 0;
  // Says that these bricks will be asked for soon: what a server has of them is asked for. Waits
  // for little, and does less if much is under way.
  virtual void announce(std::span<const Index3> bricks) const = 0;
};

// What a pyramid knows of its source.
struct SourceRequest {
  std::string pyramid;                 // the path of the index, for messages and relative paths
  std::string provenance;              // its JSON, in which "level0" is the source (docs/FORMAT.md)
  PyramidSpec spec;                    // of the pyramid
  std::uint64_t memory_bytes = 0;      // that the source should hold at most
  const CancelFlag* cancel = nullptr;  // outlives the bricks
};

// Opens the source of an index. Throws Error that names the source and says what to do if it is not
// there, changed since, or takes more memory.
using SourceOpener = std::function<std::shared_ptr<const SourceBricks>(const SourceRequest&)>;

// Gives this process the opener for the sources of all indexes, as readLevel0FromSources() of
// preprocess/sources/indexed_source.h does. Without one level 0 of an index throws Error. By one
// thread, before a pyramid that needs it is used.
void setSourceOpener(SourceOpener opener);

// For the library itself: the source of one pyramid, opened when its first brick is needed. All
// members are thread-safe.
class Level0Source {
 public:
  // All but `cancel` of the request is given.
  explicit Level0Source(SourceRequest request) : request_(std::move(request)) {
    request_.cancel = &ended_;
  }

  // Opens it, unless it is open. Throws what a SourceOpener does; another try may succeed.
  const SourceBricks& bricks();
  // The path, or "its source" while it is not open.
  std::string name() const;
  // Reads end soon, and no later one succeeds.
  void abandon() { ended_.request(); }

 private:
  SourceRequest request_;
  CancelFlag ended_;
  mutable std::mutex mutex_;  // guards the coming of the bricks
  std::shared_ptr<const SourceBricks> bricks_;
  std::atomic<const SourceBricks*> opened_ = nullptr;  // the same, for calls that do not wait
};

}  // namespace isobrick
