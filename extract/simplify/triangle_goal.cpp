#include <algorithm>
#include <cmath>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Distances are tried in this range, in voxels: below it nothing collapses, above it nothing more.
constexpr double kLeast = 1e-3, kMost = 1024;
constexpr int kMostTrials = 12;
// As near as this below the number that is asked for is near enough.
constexpr double kEnough = 0.97;

}  // namespace

std::optional<SimplifyOptions> findSimplification(Extractor& extractor, Query query,
                                                  std::uint64_t triangles) {
  TriangleSink nowhere;
  SimplifyOptions options;
  options.drop_small = query.simplify && query.simplify->drop_small;
  const auto countAt = [&](std::optional<double> distance) {
    query.simplify.reset();
    if (distance) {
      options.distance = *distance;
      query.simplify = options;
    }
    return extractor.extract(query, nowhere).triangles;
  };
  if (countAt(std::nullopt) <= triangles) return std::nullopt;
  // More distance, fewer triangles, or nearly so: the best one so far is kept.
  double low = kLeast, high = kMost, distance = 1;
  std::optional<double> best;
  std::uint64_t best_count = 0;
  for (int trial = 0; trial < kMostTrials; ++trial) {
    const std::uint64_t count = countAt(distance);
    if (count > triangles) {
      low = distance;
    } else {
      high = distance;
      if (count >= best_count) {
        best = distance;
        best_count = count;
      }
      if (static_cast<double>(count) >= kEnough * static_cast<double>(triangles)) break;
    }
    distance = std::sqrt(low * high);
    // Until both ends are known, not further than to four times or a quarter.
    if (high == kMost) distance = std::min(distance, 4 * low);
    if (low == kLeast) distance = std::max(distance, high / 4);
  }
  if (!best)
    throw Error(
        "simplification leaves more triangles than that; ask for more triangles, or for a "
        "coarser level");
  options.distance = *best;
  return options;
}

}  // namespace isobrick
