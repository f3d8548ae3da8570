// What is said of several measurements of one thing.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace isobrick {

struct Spread {
  double median = 0, min = 0, max = 0;
};

// `values` has one value at least. Between two in the middle the median is their mean.
inline Spread spreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  const double median =
      values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
  return {median, values.front(), values.back()};
}

}  // namespace isobrick
