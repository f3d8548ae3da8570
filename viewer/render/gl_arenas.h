// A few large buffers of the card, of which chunks get parts.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// Uses no OpenGL: it handles only places. Units are of any size. A run comes from the smallest free
// one that holds it; neighbours that are free are one again.
class FreeRuns {
 public:
  explicit FreeRuns(std::size_t units);

  // The first unit of so many, at least 1, that are free no longer; nothing if no run holds them.
  std::optional<std::size_t> take(std::size_t units);
  // Gives back what take() handed out. Needs no memory.
  void give(std::size_t begin, std::size_t units) noexcept;

  std::size_t units() const { return units_; }
  std::size_t freeUnits() const { return free_; }
  bool isAllFree() const { return free_ == units_; }

 private:
  struct Run {
    std::size_t begin, units;
    std::size_t end() const { return begin + units; }
  };

  const std::size_t units_;
  std::size_t free_ = 0, handed_out_ = 0;  // units, and how often
  std::vector<Run> runs_;                  // by place, with room for one before each handed out
};

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
