#include "isobrick/preprocess/finite_voxels.h"

#include <cmath>
#include <limits>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {

void makeFinite(float* voxels, const IndexBox& box, const IndexBox& counted, const NotFinite& rule,
                const VolumeInfo& info, NotFiniteCounts& counts) {
  for (std::int64_t i = 0; i < box.size(); ++i) {
    if (std::isfinite(voxels[i])) continue;
    const Index3 at = box.first + indexAt(i, box.count);
    const bool is_missing = rule.masks_nan && std::isnan(voxels[i]);
    if (!is_missing && !rule.nan_as)
      throw Error(
          "'" + info.source + "' has a voxel that is " +
              (std::isnan(voxels[i]) ? "not a number" : "infinite, or too large for float32,") +
              " at (" + indexText(at) + "), and there is no value to put there",
          {.path = info.source}, {Remedy::kReplaceNotFinite});
    voxels[i] = is_missing ? std::numeric_limits<float>::quiet_NaN() : *rule.nan_as;
    if (contains(counted, at)) ++(is_missing ? counts.missing : counts.replaced);
  }
}

}  // namespace isobrick
