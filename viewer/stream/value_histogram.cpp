#include "isobrick/viewer/stream/value_histogram.h"

#include <numeric>

#include "isobrick/storage/isovalue_suggestions.h"

namespace isobrick {

double ValueHistogram::total() const { return std::accumulate(counts.begin(), counts.end(), 0.0); }

ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins) {
  ValueHistogram histogram;
  histogram.least = pyramid.realRange().min;
  histogram.greatest = pyramid.realRange().max;
  const double least = pyramid.valueRange().min, greatest = pyramid.valueRange().max;
  histogram.counts =
      pyramid.histogram().inEqualParts(least, greatest > least ? greatest : least + 1.0, bins);
  for (const IsovalueSuggestion& suggestion : suggestIsovalues(pyramid).values)
    histogram.isovalues.push_back(suggestion.value);
  return histogram;
}

}  // namespace isobrick
