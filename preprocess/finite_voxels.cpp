#include "isobrick/preprocess/finite_voxels.h"

#include <cmath>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

std::uint64_t makeFinite(float* voxels, const IndexBox& box, const IndexBox& counted,
                         std::optional<float> nan_as, const VolumeInfo& info) {
  std::uint64_t replaced = 0;
  for (std::int64_t i = 0; i < box.size(); ++i) {
    if (std::isfinite(voxels[i])) continue;
    const Index3 at = box.first + indexAt(i, box.count);
    if (!nan_as)
      throw Error(
          "'" + info.source + "' has a voxel that is " +
              (std::isnan(voxels[i]) ? "not a number" : "infinite, or too large for float32,") +
              " at (" + indexText(at) + "), and there is no value to put there",
          {.path = info.source}, {Remedy::kReplaceNotFinite});
    voxels[i] = *nan_as;
    if (contains(counted, at)) ++replaced;
  }
  return replaced;
}

}  // namespace isobrick
