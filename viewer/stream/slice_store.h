// The place where slices are kept while they are shown.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/storage/value_transform.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

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
  // All of a slice at once.
  SliceId uploadSlice(const SliceImage& image) {
    const SliceId id = reserveSlice(image.width, image.height);
    uploadRows(id, image, 0, image.height);
    return id;
  }
};

}  // namespace isobrick
