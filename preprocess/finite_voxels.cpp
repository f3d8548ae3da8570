#include "isobrick/preprocess/finite_voxels.h"

#include <bit>
#include <cmath>
#include <limits>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

[[noreturn]] void failNotFinite(float voxel, const Index3& at, const VolumeInfo& info) {
  throw fileError(info.source, "'", info.source, "' has a voxel that is ",
                  std::isnan(voxel) ? "not a number" : "infinite, or too large for float32,",
                  " at (", indexText(at), "), and there is no value to put there",
                  Remedy::kReplaceNotFinite);
}

bool areFinite(const float* voxels, std::int64_t count) {
  // The exponent of these alone has all bits: a loop for vectors.
  constexpr std::uint32_t kExponent = 0x7F800000u;
  std::uint32_t found = 0;
  for (std::int64_t i = 0; i < count; ++i) {
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(voxels[i]) & kExponent;
    found |= static_cast<std::uint32_t>(bits == kExponent);
  }
  return found == 0;
}

}  // namespace

void makeFinite(float* voxels, const IndexBox& box, const IndexBox& counted, const NotFinite& rule,
                const VolumeInfo& info, NotFiniteCounts& counts) {
  for (std::int64_t i = 0; i < box.size(); ++i) {
    if (std::isfinite(voxels[i])) continue;
    const Index3 at = box.first + indexAt(i, box.count);
    const bool is_missing = rule.masks_nan && std::isnan(voxels[i]);
    if (!is_missing && !rule.nan_as) failNotFinite(voxels[i], at, info);
    voxels[i] = is_missing ? std::numeric_limits<float>::quiet_NaN() : *rule.nan_as;
    if (contains(counted, at)) ++(is_missing ? counts.missing : counts.replaced);
  }
}

void requireFinite(const SampleBlock<float>& voxels, const VolumeInfo& info) {
  for (std::int64_t z = voxels.box.first.z; z < voxels.box.end().z; ++z)
    for (std::int64_t y = voxels.box.first.y; y < voxels.box.end().y; ++y) {
      const float* const row = voxels.row(y, z);
      if (areFinite(row, voxels.box.count.x)) continue;
      for (std::int64_t x = 0; x < voxels.box.count.x; ++x)
        if (!std::isfinite(row[x])) failNotFinite(row[x], {voxels.box.first.x + x, y, z}, info);
    }
}

}  // namespace isobrick
