#include "isobrick/storage/gradient_spectrum.h"

#include <algorithm>
#include <cmath>

#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

// Every array of numbers in the stored order, after first and width.
template <typename Spectrum, typename F>
void forEachArray(Spectrum& spectrum, F&& f) {
  f(spectrum.at_least);
  f(spectrum.at_greatest);
  for (auto* const edges : {&spectrum.inner, &spectrum.least, &spectrum.greatest}) {
    f(edges->area);
    f(edges->gradient);
  }
}

}  // namespace

std::size_t gradientParts(const Index3& voxels) {
  constexpr std::int64_t kFewest = 16, kMost = 256, kVoxelsPerPart = 64;
  return static_cast<std::size_t>(
      std::clamp(elementCount(voxels) / kVoxelsPerPart, kFewest, kMost));
}

std::vector<float> elementsOf(const GradientSpectrum& spectrum) {
  std::vector<float> elements{spectrum.first, spectrum.width};
  forEachArray(spectrum, [&](const auto& numbers) {
    elements.insert(elements.end(), numbers.begin(), numbers.end());
  });
  return elements;
}

std::optional<GradientSpectrum> gradientSpectrumOf(std::span<const float> elements) {
  const auto isSum = [](float number) { return std::isfinite(number) && number >= 0; };
  if (!std::isfinite(elements[0]) || !(elements[1] > 0) || elements[0] + elements[1] == elements[0])
    return std::nullopt;
  if (!std::all_of(elements.begin() + 1, elements.end(), isSum)) return std::nullopt;
  GradientSpectrum spectrum;
  spectrum.first = elements[0];
  spectrum.width = elements[1];
  const std::size_t parts = (elements.size() - gradientElements(0)) / 6;
  for (auto* const edges : {&spectrum.inner, &spectrum.least, &spectrum.greatest}) {
    edges->area.resize(parts);
    edges->gradient.resize(parts);
  }
  auto from = elements.begin() + 2;
  forEachArray(spectrum, [&](auto& numbers) {
    std::copy_n(from, numbers.size(), numbers.begin());
    from += static_cast<std::ptrdiff_t>(numbers.size());
  });
  return spectrum;
}

}  // namespace isobrick
