#include "isobrick/viewer/stream/value_histogram.h"

#include <numeric>

namespace isobrick {

double ValueHistogram::total() const { return std::accumulate(counts.begin(), counts.end(), 0.0); }

double ValueHistogram::dividingValue() const {
  const double all = total();
  double sum = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) sum += static_cast<double>(i) * counts[i];
  double below = 0.0, sum_below = 0.0, best = -1.0;
  std::size_t first_above = counts.size() / 2;
  for (std::size_t i = 0; i + 1 < counts.size(); ++i) {
    below += counts[i];
    sum_below += static_cast<double>(i) * counts[i];
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

ValueHistogram histogramOf(const Pyramid& pyramid, std::size_t bins) {
  ValueHistogram histogram;
  histogram.least = pyramid.valueRange().min;
  histogram.greatest = pyramid.valueRange().max;
  const bool is_one_value = !(histogram.greatest > histogram.least);
  histogram.counts = pyramid.histogram().inEqualParts(
      histogram.least, is_one_value ? histogram.least + 1.0 : histogram.greatest, bins);
  return histogram;
}

}  // namespace isobrick
