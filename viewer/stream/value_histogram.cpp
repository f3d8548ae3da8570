#include "isobrick/viewer/stream/value_histogram.h"

#include <algorithm>
#include <numeric>

#include "isobrick/storage/index_loop.h"

namespace isobrick {

std::uint64_t ValueHistogram::total() const {
  return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
}

double ValueHistogram::dividingValue() const {
  const double all = static_cast<double>(total());
  double sum = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i)
    sum += static_cast<double>(i) * static_cast<double>(counts[i]);
  double below = 0.0, sum_below = 0.0, best = -1.0;
  std::size_t first_above = counts.size() / 2;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    below += static_cast<double>(counts[i]);
    sum_below += static_cast<double>(i) * static_cast<double>(counts[i]);
    const double above = all - below;
    if (below == 0.0 || above == 0.0) continue;
    const double apart = sum_below / below - (sum - sum_below) / above;
    const double between = below * above * apart * apart;
    if (between > best) {
      best = between;
      first_above = i + 1;
    }
  }
  return least +
         (greatest - least) * static_cast<double>(first_above) / static_cast<double>(counts.size());
}

ValueHistogram coarseHistogram(const Pyramid& pyramid, std::size_t bins,
                               std::int64_t most_samples) {
  const Lattice& lattice = pyramid.lattice();
  int level = 0;
  while (level + 1 < lattice.levels() && elementCount(lattice.samples(level)) > most_samples)
    ++level;
  ValueHistogram histogram;
  histogram.least = pyramid.valueRange().min;
  histogram.greatest = pyramid.valueRange().max;
  histogram.counts.assign(bins, 0);
  const double span = histogram.greatest - histogram.least;
  const double per_value = span > 0.0 ? static_cast<double>(bins) / span : 0.0;
  const BrickLayout& layout = pyramid.layout();
  const auto count = [&](const BrickSamples& samples, const auto* values, const IndexBox& own) {
    forEachIndex(own, [&](const Index3& at) {
      const auto value =
          static_cast<double>(values[linearIndex(at - samples.box.first, samples.box.count)]);
      const double bin =
          std::clamp((value - histogram.least) * per_value, 0.0, static_cast<double>(bins) - 1.0);
      ++histogram.counts[static_cast<std::size_t>(bin)];
    });
  };
  forEachIndex(IndexBox{Index3(0), layout.bricks(level)}, [&](const Index3& brick) {
    const BrickSamples samples = pyramid.samples(level, brick);
    // Each sample once: those of the cells' lower corners, and at the far border the last ones.
    IndexBox own = layout.brickCellBox(level, brick);
    for (int axis = 0; axis < 3; ++axis)
      if (own.end()[axis] == lattice.cells(level)[axis]) ++own.count[axis];
    visitVoxelType(pyramid.spec().voxel_type, [&](auto tag) {
      count(samples, samples.data<typename decltype(tag)::Type>(), own);
    });
    pyramid.throwIfReadsFailed(level, brick);
  });
  return histogram;
}

}  // namespace isobrick
