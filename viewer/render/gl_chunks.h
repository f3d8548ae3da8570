// The chunks of surfaces that a card keeps: in a few large buffers, of which they get parts, and by
// way of memory that the processor writes and the card copies from later.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/stream/chunk_store.h"
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
  std::size_t count() const;
  // Of all of them, and of their free parts.
  std::size_t bytes() const { return units_ * kUnitBytes; }
  std::size_t freeBytes() const { return free_ * kUnitBytes; }
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

// Uses no memory and no OpenGL: it handles only places in the ring, and when they are free again.
// Belongs to one thread. Never waits.
class UploadRing {
 public:
  // True once the card has done all commands before the fence; not called afterwards.
  using Fence = std::function<bool()>;

  explicit UploadRing(std::size_t bytes) : bytes_(bytes) {}

  // The place at which `bytes`, at most those of the ring, may be written in one run, a multiple of
  // 16; nothing while the card may still read there: call it again in the next frame.
  std::optional<std::size_t> take(std::size_t bytes);
  // The card has commands to read all bytes taken since the last call, and `fence` comes after
  // these.
  void close(Fence fence);
  bool isOpen() const { return head_ != closed_; }

 private:
  struct Region {
    std::uint64_t end = 0;
    Fence fence;
  };
  void reclaim();

  const std::size_t bytes_;
  // All bytes ever taken, unused ones at the ring's end included; a place is the rest of a division
  // by the ring's size.
  std::uint64_t head_ = 0, closed_ = 0, tail_ = 0;
  std::deque<Region> regions_;  // that the card reads, from the oldest
};

// A ring that stays mapped, with a fence after each frame's copies. Made, used and destroyed on the
// thread on which its context is current.
class GlStaging {
 public:
  GlStaging();

  // Without it nothing can be copied: the driver had no memory for it.
  bool isThere() const { return map_ != nullptr; }
  // Copies at most kPieceBytes to `offset` of a buffer; false, and nothing done, while the ring is
  // full.
  bool copy(const void* data, std::size_t bytes, GLuint buffer, std::size_t offset);
  // After the last copy of a frame.
  void endFrame();

 private:
  GlBuffer buffer_;
  std::byte* map_ = nullptr;
  UploadRing ring_;
};

// A chunk in an arena: its vertices, then its indices.
struct KeptChunk {
  GlArenas::Place place;
  std::uint64_t bytes = 0;
  std::uint32_t vertices = 0, indices = 0, transition_indices = 0;
  glm::dvec3 origin{0.0};
  glm::dvec3 lower{0.0}, upper{0.0};  // of the vertices, in the lattice
  int level = 0, surface = 0;

  std::size_t vertexBytes() const { return vertices * sizeof(SurfaceVertex); }
  // In their arena's buffer.
  std::uint32_t firstVertex() const { return static_cast<std::uint32_t>(place.begin); }
  std::uint32_t firstIndex() const {
    return static_cast<std::uint32_t>((place.firstByte() + vertexBytes()) / sizeof(std::uint32_t));
  }
};

// ChunkStore's functions have its meaning here.
class GlChunks {
 public:
  // `staged`: pieces go through a ring that stays mapped, if the driver has the memory for it.
  GlChunks(GlDevice& device, bool staged);

  ChunkId reserve(const SurfaceChunk& chunk);
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes);
  void endUploads();
  ChunkId upload(const SurfaceChunk& chunk);
  void release(ChunkId chunk) noexcept;
  SurfaceChunk download(ChunkId chunk) const;

  const KeptChunk& at(ChunkId chunk) const { return chunks_.at(chunk); }
  const GlArenas& arenas() const { return arenas_; }
  // Of chunks alone.
  std::uint64_t bytesKept() const { return bytes_kept_; }

 private:
  template <typename F>
  static bool forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes, F&& f);
  void fill(const KeptChunk& kept, const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes);

  GlDevice& device_;
  GlArenas arenas_;
  std::optional<GlStaging> staging_;  // none: pieces go without it
  std::unordered_map<ChunkId, KeptChunk> chunks_;
  ChunkId last_ = 0;
  std::uint64_t bytes_kept_ = 0;
};

}  // namespace isobrick
