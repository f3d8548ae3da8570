// Prints the tables of docs/ALGORITHM.md section 4: how tight the curvature bound is. Ends with 1
// where a sample is above its bound.

#include "tests/preprocess/curvature_tightness.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <utility>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

double medianOf(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}
double quantileOf(std::vector<double>& values, double q) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}
double meanOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

bool printTables() {
  const TemporaryFolder folder;
  const std::vector<TightnessCase> cases = tightnessCases(48);
  std::vector<BoundedVolume> volumes;
  for (const TightnessCase& c : cases)
    volumes.push_back(makeBoundedVolume(folder, Index3(48), c.type, c.field));

  std::printf("\n  bound / curvature at the fitted samples (curvature >= 1/(2*64^2))\n");
  std::printf("          ---- median ----------   ---- mean ------------\n");
  std::printf("          tile    own   constant   tile    own   constant\n");
  std::vector<Tightness> all;
  std::int64_t samples = 0, below = 0;
  for (std::size_t i = 0; i < volumes.size(); ++i) {
    Tightness t = measureTightness(volumes[i]);
    const double medians[3] = {medianOf(t.tile), medianOf(t.own), medianOf(t.constant)};
    const double means[3] = {meanOf(t.tile), meanOf(t.own), meanOf(t.constant)};
    std::printf("  %-6s %6.2f %6.2f %8.2f %8.2f %6.2f %8.2f   (infinite bounds: %lld of %lld)\n",
                cases[i].name, medians[0], medians[1], medians[2], means[0], means[1], means[2],
                static_cast<long long>(t.infinite), static_cast<long long>(t.samples));
    samples += t.samples;
    below += t.below;
    all.push_back(std::move(t));
  }

  std::printf("  %lld samples, %lld above their bound\n", static_cast<long long>(samples),
              static_cast<long long>(below));

  std::printf("\n  share of samples whose node may stay coarse, in percent\n");
  std::printf("          radius   tile    own   constant   the sample alone\n");
  for (std::size_t i = 0; i < volumes.size(); ++i)
    for (std::size_t r = 0; r < 3; ++r) {
      double percent[4];
      for (std::size_t b = 0; b < 4; ++b)
        percent[b] = 100.0 * static_cast<double>(all[i].accepted[r][b]) /
                     static_cast<double>(all[i].samples);
      std::printf("  %-6s %7.0f %7.2f %6.2f %8.2f %12.2f\n", cases[i].name, Tightness::kRadii[r],
                  percent[0], percent[1], percent[2], percent[3]);
    }

  std::printf("\n  samples that the fit did not see: share above the bound, and by which factor\n");
  std::printf("          where     samples   above %%   p = 0 %%   median   95 %%      max\n");
  for (std::size_t i = 0; i < volumes.size(); ++i)
    for (const bool on_edges : {true, false}) {
      UnseenSamples unseen = measureUnseen(volumes[i], on_edges);
      const auto share = [&](std::int64_t n) {
        return 100.0 * static_cast<double>(n) / static_cast<double>(unseen.samples);
      };
      const char* where = on_edges ? "edges" : "inside";
      std::printf("  %-6s  %-7s %9lld %9.3f %9.3f %8.2f %6.2f %8.1f\n", cases[i].name, where,
                  static_cast<long long>(unseen.samples), share(unseen.above),
                  share(unseen.unbounded), medianOf(unseen.excess), quantileOf(unseen.excess, 0.95),
                  quantileOf(unseen.excess, 1));
    }
  std::printf("\n");
  return below == 0;
}

}  // namespace
}  // namespace isobrick::test

int main() { return isobrick::test::printTables() ? 0 : 1; }
