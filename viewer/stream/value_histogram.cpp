#include "isobrick/viewer/stream/value_histogram.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/isovalue_suggestions.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

double crossedEdges(const GradientSpectrum& spectrum, double value) {
  const double part = std::floor((value - static_cast<double>(spectrum.first)) /
                                 static_cast<double>(spectrum.width));
  // Beyond the parts there is nothing but the least, or the greatest voxel.
  const auto& at_end = part < 0 ? spectrum.at_least : spectrum.at_greatest;
  if (part < 0 || part >= static_cast<double>(spectrum.parts()))
    return static_cast<double>(at_end[0] + at_end[1] + at_end[2]);
  const auto i = static_cast<std::size_t>(part);
  return static_cast<double>(spectrum.inner.area[i] + spectrum.least.area[i] +
                             spectrum.greatest.area[i]);
}

}  // namespace

double ValueHistogram::edgesAt(double isovalue) const {
  if (edges.empty() || !std::isfinite(isovalue)) return 0.0;
  const double share = (isovalue - least) / std::max(greatest - least, 1e-30);
  const double last = static_cast<double>(edges.size()) - 1.0;
  const double part = std::clamp(share * (last + 1.0), 0.0, last);
  return edges[static_cast<std::size_t>(part)];
}

double ValueHistogram::total() const { return std::accumulate(counts.begin(), counts.end(), 0.0); }

ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins) {
  ValueHistogram histogram;
  histogram.least = pyramid.realRange().min;
  histogram.greatest = pyramid.realRange().max;
  const double least = pyramid.valueRange().min, greatest = pyramid.valueRange().max;
  histogram.counts =
      pyramid.histogram().inEqualParts(least, greatest > least ? greatest : least + 1.0, bins);
  if (const auto spectrum = pyramid.parts().tables().gradients())
    for (std::size_t i = 0; i < bins; ++i)
      histogram.edges.push_back(crossedEdges(
          *spectrum,
          least + (static_cast<double>(i) + 0.5) * (greatest - least) / static_cast<double>(bins)));
  for (const IsovalueSuggestion& suggestion : suggestIsovalues(pyramid).values)
    histogram.isovalues.push_back(suggestion.value);
  return histogram;
}

}  // namespace isobrick
