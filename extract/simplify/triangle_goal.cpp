#include <algorithm>
#include <cmath>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Distances are tried from the least on, each so many times the one before, in voxels: below the
// first nothing collapses, above the last nothing more.
constexpr double kLeast = 1e-3, kMost = 1024, kStep = 4;
// Between the last distance that is too small and the first that is not.
constexpr int kMostHalvings = 6;
// As near as this below the number that is asked for is near enough.
constexpr double kEnough = 0.97;

}  // namespace

std::optional<SimplifyOptions> findSimplification(Extractor& extractor, Query query,
                                                  std::uint64_t triangles) {
  TriangleSink nowhere;
  SimplifyOptions options;
  options.drop_small = query.simplify && query.simplify->drop_small;
  query.is_progressive = false;
  const auto countAt = [&](std::optional<double> distance) {
    query.simplify.reset();
    if (distance) {
      options.distance = *distance;
      query.simplify = options;
    }
    return extractor.extract(query, nowhere).triangles;
  };
  if (countAt(std::nullopt) <= triangles) return std::nullopt;
  // More distance may bring more triangles: on flat faces, say, where the least is enough. So the
  // search comes from below, and the least distance that is enough is the best.
  double low = 0, high = kLeast;
  std::uint64_t count = countAt(high);
  while (count > triangles && high < kMost) {
    low = high;
    high *= kStep;
    count = countAt(high);
  }
  if (count > triangles)
    throw Error(
        "simplification leaves more triangles than that; ask for more triangles, or for a "
        "coarser level");
  const double enough = kEnough * static_cast<double>(triangles);
  for (int n = 0; n < kMostHalvings && low > 0 && static_cast<double>(count) < enough; ++n) {
    const double middle = std::sqrt(low * high);
    const std::uint64_t at_middle = countAt(middle);
    if (at_middle > triangles) {
      low = middle;
    } else {
      high = middle;
      count = at_middle;
    }
  }
  options.distance = high;
  return options;
}

}  // namespace isobrick
