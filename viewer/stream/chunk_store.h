// The place where chunks and slices are kept while they are shown: a graphics card, or another
// front end's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/value_transform.h"
#include "isobrick/viewer/stream/surface_chunk.h"

namespace isobrick {

// The number of a chunk that a store keeps; 0 is none.
using ChunkId = std::uint32_t;

// The most of a chunk that one call uploads while frames go on: a fraction of a millisecond.
inline constexpr std::size_t kPieceBytes = std::size_t{256} << 10;

// The driver was reset: all that was kept is gone, and nothing is drawn any longer. Any call may
// throw it; release() never does. The owner makes another store.
class RendererLost : public Error {
 public:
  RendererLost() : Error("the graphics driver was reset") {}
};

// The graphics card has no memory left for what was asked; all that was kept stays.
class NoGraphicsMemory : public Error {
 public:
  using Error::Error;
};

// Keeps chunks until they are released. Used by one thread. Numbers are not given twice.
class ChunkStore {
 public:
  virtual ~ChunkStore() = default;

  // Makes room for a chunk, without its bytes. Throws NoGraphicsMemory.
  virtual ChunkId reserve(const SurfaceChunk& chunk) = 0;
  // Copies some of the bytes of that chunk, at most kPieceBytes: its vertices, then its triangles.
  // Never waits; false: not now, but in the next frame.
  virtual bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                           std::size_t bytes) = 0;
  // After the last piece of a frame.
  virtual void endUploads() = 0;
  // A chunk that was reserved and not released yet.
  virtual void release(ChunkId chunk) noexcept = 0;
};

// Values of the volume on a parallelogram: `width` x `height` of them, the first at `corner`, the
// last of the first row at corner + across, the first of the last row at corner + along.
struct SliceImage {
  int width = 0;
  int height = 0;
  std::vector<float> values;      // as they are stored; NaN: nothing there
  ValueTransform transform = {};  // from them to data units

  std::uint64_t bytes() const { return values.size() * sizeof(float); }
};

// The number of a slice that a store keeps; 0 is none.
using SliceId = std::uint32_t;

// Keeps slices until they are released. Used by one thread. Numbers are not given twice. Any call
// but releaseSlice() may throw RendererLost.
class SliceStore {
 public:
  virtual ~SliceStore() = default;

  // Makes room for a slice of so many values. Throws NoGraphicsMemory.
  virtual SliceId reserveSlice(int width, int height) = 0;
  // Copies `count` rows from `first` on of the image that the slice was reserved for.
  virtual void uploadRows(SliceId slice, const SliceImage& image, int first, int count) = 0;
  virtual void releaseSlice(SliceId slice) = 0;
  // The most values to a side that a slice can have.
  virtual int greatestSlice() const = 0;
  SliceId uploadSlice(const SliceImage& image) {
    const SliceId id = reserveSlice(image.width, image.height);
    uploadRows(id, image, 0, image.height);
    return id;
  }
};

}  // namespace isobrick
