// A slice of the volume as it goes to the graphics card.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/storage/value_transform.h"

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

}  // namespace isobrick
