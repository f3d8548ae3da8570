#include "isobrick/viewer/stream/value_histogram.h"

#include <numeric>

#include "isobrick/storage/isovalue_suggestions.h"

namespace isobrick {

double ValueHistogram::total() const { return std::accumulate(counts.begin(), counts.end(), 0.0); }

ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins) {
  ValueHistogram histogram;
  histogram.least = pyramid.valueRange().min;
  histogram.greatest = pyramid.valueRange().max;
  const bool is_one_value = !(histogram.greatest > histogram.least);
  histogram.counts = pyramid.histogram().inEqualParts(
      histogram.least, is_one_value ? histogram.least + 1.0 : histogram.greatest, bins);
  for (const IsovalueSuggestion& suggestion : suggestIsovalues(pyramid).values)
    histogram.isovalues.push_back(suggestion.value);
  return histogram;
}

}  // namespace isobrick
