// A few large buffers of the card, of which chunks get parts.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "isobrick/viewer/render/free_runs.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Places are multiples of a vertex, so that the first vertex of a chunk has a number in its buffer,
// and the first index too. A buffer is as large as all before it together, from 4 to 32 MiB
// (less on a card with a low limit), or as one chunk needs. One that is empty goes if the others
// have as much room.
class GlArenas {
 public:
  static constexpr std::size_t kUnitBytes = sizeof(SurfaceVertex);

  struct Place {
    std::size_t arena = 0;
    std::size_t begin = 0, units = 0;  // units: 0 if it holds nothing

    std::size_t firstByte() const { return begin * kUnitBytes; }
  };

  // Throws NoGraphicsMemory, and the other errors of the device.
  Place take(std::size_t bytes, GlDevice& device);
  void give(const Place& place) noexcept;
  // 0 if there is none of this number (any longer).
  GLuint buffer(std::size_t arena) const {
    return arena < arenas_.size() && arenas_[arena] ? *arenas_[arena]->buffer : 0;
  }
  // How many there are.
  std::size_t count() const;
  // Of all of them, and of their free parts.
  std::size_t bytes() const { return units_ * kUnitBytes; }
  std::size_t freeBytes() const { return free_ * kUnitBytes; }
  // Of the largest one.
  std::size_t greatestBytes() const;

 private:
  struct Arena {
    GlBuffer buffer;
    FreeRuns runs;
  };
  std::size_t addArena(std::size_t units, GlDevice& device);

  std::vector<std::unique_ptr<Arena>> arenas_;  // by number; empty places are taken again
  std::size_t units_ = 0, free_ = 0;
};

}  // namespace isobrick
