#include "isobrick/storage/isovalue_suggestions.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <span>
#include <utility>

#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

constexpr std::size_t kParts = 256;            // if there is no spectrum
constexpr double kLeastPaddingShare = 0.002;   // of the voxels
constexpr double kLeastMaterialShare = 0.003;  // of the voxels that are not padding
constexpr double kValley = 0.65;               // of the gradients on both sides, at most
constexpr double kSteepEnough = 0.7;           // of the mean gradient between two materials
constexpr double kLeastGradient = 0.05;        // of the greatest among the suggestions
constexpr double kLeastSteepness = 0.15;       // the same for the mean gradient
constexpr double kSurroundingsShare = 0.25;    // of the most frequent material's voxels
constexpr double kCutOff = 0.3;   // of the voxels beside it, at least, are at an end of the range
constexpr double kEnough = 1e-5;  // of all edges
constexpr double kNoiseSigmas = 3.5;
// The mean difference of edges that cross a value in noise, weighted by their lengths, in sigmas.
constexpr double kBiased = 1.77;
constexpr double kMaterialVoxels = 0.6;  // of a material's at most, at its end

// The values that are not padding.
struct Curves {
  double first = 0, width = 1;
  std::vector<double> area, gradient, voxels;  // of the parts
  std::vector<double> steepness;               // the mean gradient, equal neighbours taken in
  double noise = 0;
  bool are_labels = false;  // a few integers
  // Voxels of the least and the greatest value if these lie beyond the parts.
  std::optional<double> below, above;
  double voxels_below = 0, voxels_above = 0;

  std::size_t parts() const { return voxels.size(); }
  double middle(std::size_t part) const {
    return first + (static_cast<double>(part) + 0.5) * width;
  }
  // The middle; of labels the integer.
  double valueOf(std::size_t part) const {
    return are_labels ? std::round(middle(part)) : middle(part);
  }
  std::size_t partOf(double value) const {
    const double part = std::floor((value - first) / width);
    return static_cast<std::size_t>(std::clamp(part, 0.0, static_cast<double>(parts()) - 1));
  }
};

struct PaddingEnds {
  bool least = false, greatest = false;
};

double sumOf(std::span<const double> numbers) {
  return std::accumulate(numbers.begin(), numbers.end(), 0.0);
}

// The mean of three neighbours.
std::vector<double> smoothed(std::span<const double> numbers) {
  std::vector<double> result(numbers.begin(), numbers.end());
  if (numbers.size() < 64) return result;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const std::size_t begin = i == 0 ? 0 : i - 1, end = std::min(i + 2, numbers.size());
    result[i] = sumOf(numbers.subspan(begin, end - begin)) / static_cast<double>(end - begin);
  }
  return result;
}

// Integers that are few are labels, each a value of its own; others stand for the values around
// them.
bool areLabels(const VoxelHistogram& histogram) {
  constexpr std::size_t kMostLabels = 33;
  return histogram.bin(0).min == histogram.bin(0).max && histogram.bins() <= kMostLabels;
}

std::vector<double> voxelsOfParts(const VoxelHistogram& histogram, double first, double width,
                                  std::size_t parts) {
  if (!areLabels(histogram))
    return histogram.inEqualParts(first, first + width * static_cast<double>(parts), parts);
  std::vector<double> voxels(parts, 0.0);
  for (std::size_t i = 0; i < histogram.bins(); ++i) {
    const double part = (static_cast<double>(histogram.bin(i).min) - first) / width;
    voxels[static_cast<std::size_t>(std::clamp(part, 0.0, static_cast<double>(parts) - 1))] +=
        static_cast<double>(histogram.counts()[i]);
  }
  return voxels;
}

Curves curvesOf(VoxelHistogram histogram, const ValueRange& range, const GradientSpectrum& spectrum,
                double noise, PaddingEnds padding) {
  Curves curves;
  curves.first = static_cast<double>(spectrum.first);
  curves.width = static_cast<double>(spectrum.width);
  curves.noise = noise;
  curves.are_labels = areLabels(histogram);
  const std::size_t parts = spectrum.parts();
  const double last = curves.first + curves.width * static_cast<double>(parts);
  const auto min = static_cast<double>(range.min), max = static_cast<double>(range.max);
  std::uint64_t &at_least = histogram.counts().front(), &at_greatest = histogram.counts().back();
  if (min < curves.first - curves.width || padding.least) {
    if (!padding.least) curves.below = min, curves.voxels_below = static_cast<double>(at_least);
    at_least = 0;
  }
  if (max > last + curves.width || padding.greatest) {
    if (!padding.greatest)
      curves.above = max, curves.voxels_above = static_cast<double>(at_greatest);
    at_greatest = 0;
  }
  curves.voxels = voxelsOfParts(histogram, curves.first, curves.width, parts);
  curves.area.resize(parts);
  curves.gradient.resize(parts);
  const auto add = [&](const GradientSpectrum::Edges& edges) {
    for (std::size_t i = 0; i < parts; ++i) {
      curves.area[i] += static_cast<double>(edges.area[i]);
      curves.gradient[i] += static_cast<double>(edges.gradient[i]);
    }
  };
  add(spectrum.inner);
  if (!padding.least) add(spectrum.least);
  if (!padding.greatest) add(spectrum.greatest);
  // Each voxel has three edges.
  std::vector<double> all(parts);
  for (std::size_t i = 0; i < parts; ++i) all[i] = curves.area[i] + 3 * curves.voxels[i];
  const std::vector<double> over = smoothed(curves.gradient), under = smoothed(all);
  curves.steepness.resize(parts);
  // Values that hardly occur are as their neighbours: few edges are in a sample by chance.
  const double enough = kEnough * sumOf(all);
  std::size_t begin = 0;
  while (begin < parts && !(all[begin] > enough)) ++begin;
  for (std::size_t i = begin; i < parts; ++i)
    curves.steepness[i] = all[i] > enough ? over[i] / under[i] : curves.steepness[i - 1];
  std::fill_n(curves.steepness.begin(), begin, begin < parts ? curves.steepness[begin] : 0.0);
  return curves;
}

struct Material {
  double value = 0;
  double noise = 0;  // sigma there
  double voxels = 0;
};

// Valleys of the steepness, each with the voxels from the peak before it to the one after it. One
// counts if it is deep against a peak beside it, and has more voxels than the peaks.
std::vector<Material> valleysOf(const Curves& curves) {
  const std::vector<double>& steepness = curves.steepness;
  std::vector<Material> materials;
  enum class Way { kUnknown, kUp, kDown } way = Way::kUnknown;
  std::size_t begin = 0, lowest = 0, highest = 0;
  bool has_peak_before = false;
  const std::vector<double> voxels = smoothed(curves.voxels);
  const auto close = [&](std::size_t end, bool has_peak_after) {
    // The most frequent value in it.
    std::size_t most = lowest;
    for (std::size_t i = begin; i < end; ++i)
      if (steepness[i] * kValley <= steepness[lowest] && curves.voxels[i] > curves.voxels[most])
        most = i;
    const double here = kMaterialVoxels * voxels[most];
    if ((!has_peak_before || voxels[begin] <= here) && (!has_peak_after || voxels[end] <= here))
      materials.push_back({curves.valueOf(most), steepness[lowest] / kBiased,
                           sumOf(std::span(curves.voxels).subspan(begin, end - begin))});
    begin = end;
    has_peak_before = has_peak_after;
  };
  for (std::size_t i = 1; i < steepness.size(); ++i) {
    if (steepness[i] < steepness[lowest]) lowest = i;
    if (steepness[i] > steepness[highest]) highest = i;
    if (way != Way::kUp && steepness[lowest] < kValley * steepness[i]) {
      way = Way::kUp;
      highest = i;
    } else if (way != Way::kDown && steepness[i] < kValley * steepness[highest]) {
      if (way == Way::kUp)
        close(highest, true);
      else
        begin = highest, has_peak_before = true;
      way = Way::kDown;
      lowest = i;
    }
  }
  if (way == Way::kUp) close(highest, true);
  if (way == Way::kDown) close(steepness.size(), false);
  return materials;
}

// Whether the material at an end of the range is only values that a scanner cut off there: then
// there are many voxels between it and the next one.
bool isCutOff(const Curves& curves, const Material& material, const Material& next) {
  const std::size_t parts = curves.parts(), at = curves.partOf(material.value);
  if (parts < 8 || (at > 1 && at + 2 < parts)) return false;
  const bool is_first = at <= 1;
  const std::size_t beside = curves.partOf(next.value);
  const std::size_t begin = is_first ? 2 : beside + 1, end = is_first ? beside : parts - 2;
  double between = 0;
  for (std::size_t i = begin; i < end; ++i) between += curves.voxels[i];
  const std::size_t edge = is_first ? 0 : parts - 2;
  return kCutOff * between > curves.voxels[edge] + curves.voxels[edge + 1];
}

std::vector<Material> materialsOf(const Curves& curves) {
  std::vector<Material> materials = valleysOf(curves);
  const double all = sumOf(curves.voxels) + curves.voxels_below + curves.voxels_above;
  if (curves.below) materials.insert(materials.begin(), {*curves.below, 0, curves.voxels_below});
  if (curves.above) materials.push_back({*curves.above, 0, curves.voxels_above});
  std::erase_if(materials, [&](const Material& m) { return m.voxels < kLeastMaterialShare * all; });
  if (materials.size() > 1 && isCutOff(curves, materials.back(), *(materials.end() - 2)))
    materials.pop_back();
  if (materials.size() > 1 && isCutOff(curves, materials[0], materials[1]))
    materials.erase(materials.begin());
  return materials;
}

// With as few digits as distinguish it from values a twentieth of `span` away.
double rounded(double value, double span) {
  const double step = std::pow(10.0, std::floor(std::log10(span / 20)));
  if (!std::isnormal(step)) return value;
  const double steps = std::round(value / step);
  // A power of ten below 1 has no exact double; its inverse has.
  return step < 1 ? steps / std::round(1 / step) : steps * step;
}

struct Candidate {
  double value = 0;
  std::optional<std::size_t> below, above;  // the materials; none beyond the last one
  std::optional<double> center;             // of the gradients there
};

// Suggestions from the materials, best first.
class IsovalueChooser {
 public:
  explicit IsovalueChooser(const Curves& curves)
      : curves_(curves), materials_(materialsOf(curves)) {}

  std::vector<IsovalueSuggestion> choose() {
    if (materials_.empty()) return {};
    const std::size_t last = materials_.size() - 1;
    for (std::size_t i = 0; i < last; ++i)
      propose({0.5 * (materials_[i].value + materials_[i + 1].value), i, i + 1, {}});
    if (const auto center = centerOf(curves_.first, materials_[0].value))
      propose({0.5 * (*center + materials_[0].value), {}, 0, center});
    if (const auto center = centerOf(materials_[last].value, lastValue()))
      propose({0.5 * (*center + materials_[last].value), last, {}, center});
    rank();
    // A single surface that ends in no material: its steepest part is worth a look, too.
    if (candidates_.size() == 1 && candidates_[0].center) {
      candidates_.push_back(candidates_[0]);
      candidates_[1].value = *candidates_[1].center;
    }
    if (candidates_.size() > IsovalueSuggestions::kMost)
      candidates_.resize(IsovalueSuggestions::kMost);
    std::vector<IsovalueSuggestion> suggestions;
    for (const Candidate& candidate : candidates_) {
      const double value = rounded(candidate.value, spanOf(candidate));
      const std::size_t part = curves_.partOf(value);
      const double area = curves_.area[part];
      suggestions.push_back({value, area, area > 0 ? curves_.gradient[part] / area : 0});
    }
    return suggestions;
  }

 private:
  double lastValue() const {
    return curves_.first + curves_.width * static_cast<double>(curves_.parts());
  }
  double leastOf(const Candidate& candidate) const {
    return candidate.below ? materials_[*candidate.below].value : curves_.first;
  }
  double greatestOf(const Candidate& candidate) const {
    return candidate.above ? materials_[*candidate.above].value : lastValue();
  }
  double spanOf(const Candidate& candidate) const {
    return greatestOf(candidate) - leastOf(candidate);
  }
  double steepnessAt(double value) const { return curves_.steepness[curves_.partOf(value)]; }
  double gradientAt(double value) const { return curves_.gradient[curves_.partOf(value)]; }

  std::optional<double> centerOf(double least, double greatest) const {
    double sum = 0, moment = 0;
    for (std::size_t i = curves_.partOf(least) + 1; i < curves_.partOf(greatest); ++i) {
      sum += curves_.gradient[i];
      moment += curves_.gradient[i] * curves_.middle(i);
    }
    if (!(sum > 0)) return std::nullopt;
    return moment / sum;
  }

  // If the volume is not steep half-way, takes the nearest value at which it is. None in the noise.
  void propose(Candidate candidate) {
    const std::size_t begin = curves_.partOf(leastOf(candidate));
    const std::size_t end = curves_.partOf(greatestOf(candidate)) + 1;
    double sum = 0, weighted = 0;
    for (std::size_t part = begin; part < end; ++part) {
      sum += curves_.gradient[part];
      weighted += curves_.gradient[part] * curves_.steepness[part];
    }
    const auto isSteep = [&](std::size_t part) {
      return curves_.steepness[part] * sum >= kSteepEnough * weighted;
    };
    const std::size_t half_way = curves_.partOf(candidate.value);
    if (!isSteep(half_way)) {
      std::size_t nearest = begin;
      const auto distance = [&](std::size_t part) {
        return part < half_way ? half_way - part : part - half_way;
      };
      bool found = false;
      for (std::size_t part = begin; part < end; ++part)
        if (isSteep(part) && (!found || distance(part) < distance(nearest)))
          nearest = part, found = true;
      candidate.value = curves_.middle(nearest);
    }
    for (const auto& beside : {candidate.below, candidate.above})
      if (beside && isInNoiseOf(materials_[*beside], candidate.value)) return;
    candidates_.push_back(candidate);
  }

  bool isInNoiseOf(const Material& material, double value) const {
    const double noise = std::min(material.noise, curves_.noise);
    if (std::abs(value - material.value) < kNoiseSigmas * noise) return true;
    const bool has_part = material.value >= curves_.first && material.value <= lastValue();
    return has_part && curves_.voxels[curves_.partOf(value)] >
                           kMaterialVoxels * curves_.voxels[curves_.partOf(material.value)];
  }

  void rank() {
    double most = 0, steepest = 0, most_voxels = 0;
    for (const Candidate& c : candidates_) {
      most = std::max(most, gradientAt(c.value));
      steepest = std::max(steepest, steepnessAt(c.value));
    }
    std::erase_if(candidates_, [&](const Candidate& c) {
      return gradientAt(c.value) < kLeastGradient * most ||
             steepnessAt(c.value) < kLeastSteepness * steepest;
    });
    for (const Material& material : materials_)
      most_voxels = std::max(most_voxels, material.voxels);
    const auto surroundings =
        static_cast<std::size_t>(std::find_if(materials_.begin(), materials_.end(),
                                              [&](const Material& m) {
                                                return m.voxels >= kSurroundingsShare * most_voxels;
                                              }) -
                                 materials_.begin());
    if (candidates_.empty()) return;
    // The next ones below and above the surroundings.
    const double outside = materials_[surroundings].value;
    const Candidate *below = nullptr, *above = nullptr;
    for (const Candidate& c : candidates_) {
      const Candidate*& beside = c.value < outside ? below : above;
      if (beside == nullptr || std::abs(c.value - outside) < std::abs(beside->value - outside))
        beside = &c;
    }
    const bool is_below = above == nullptr ||
                          (below != nullptr && gradientAt(below->value) > gradientAt(above->value));
    const double first = (is_below ? below : above)->value;
    std::sort(candidates_.begin(), candidates_.end(), [&](const Candidate& a, const Candidate& b) {
      return std::pair(a.value == first, gradientAt(a.value)) >
             std::pair(b.value == first, gradientAt(b.value));
    });
  }

  const Curves& curves_;
  const std::vector<Material> materials_;
  std::vector<Candidate> candidates_;
};

// Otsu: the value that divides the voxels into two groups of the least spread, and the share of the
// spread that is between the groups.
struct Division {
  double value = 0, share = 0;
};
Division divisionOf(VoxelHistogram histogram, const ValueRange& range, PaddingEnds padding) {
  const auto counts = histogram.counts();
  std::size_t begin = 0, end = counts.size();
  if (padding.least)
    for (counts[begin++] = 0; counts[begin] == 0;) ++begin;
  if (padding.greatest)
    for (counts[--end] = 0; counts[end - 1] == 0;) --end;
  const double least =
      std::max(static_cast<double>(histogram.bin(begin).min), static_cast<double>(range.min));
  const double greatest =
      std::min(static_cast<double>(histogram.bin(end - 1).max), static_cast<double>(range.max));
  if (!(greatest > least)) return {least, 0};
  const std::vector<double> parts = histogram.inEqualParts(least, greatest, kParts);
  double all = 0, sum = 0, squares = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto x = static_cast<double>(i);
    all += parts[i], sum += x * parts[i], squares += x * x * parts[i];
  }
  const double spread = squares - sum * sum / all;
  double below = 0, sum_below = 0, best = 0;
  std::size_t first = kParts / 2, last = kParts / 2;  // all that divide in the same way
  for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
    below += parts[i];
    sum_below += static_cast<double>(i) * parts[i];
    const double above = all - below;
    if (!(below > 0) || !(above > 0)) continue;
    const double apart = sum_below / below - (sum - sum_below) / above;
    const double between = below * above / all * apart * apart;
    if (between > best * (1 + 1e-12)) best = between, first = i + 1;
    if (between >= best * (1 - 1e-12)) last = i + 1;
  }
  const double at = 0.5 * (static_cast<double>(first) + static_cast<double>(last));
  return {least + (greatest - least) * at / static_cast<double>(kParts),
          spread > 0 ? best / spread : 0};
}

// The voxels at one end of the range, compared with the others.
struct RangeEnd {
  double share = 0;       // of all voxels
  double gap = 0;         // to the nearest of the others
  double other_span = 0;  // from the nearest to the furthest of them
};
RangeEnd endOf(const VoxelHistogram& histogram, const ValueRange& range, bool is_least) {
  const auto counts = histogram.counts();
  const std::size_t bins = counts.size();
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  const std::size_t end = is_least ? 0 : bins - 1;
  const double others = all - static_cast<double>(counts[end]);
  // A few voxels between them come from resampling.
  constexpr double kOutliers = 1e-3;
  const auto quantile = [&](double share) {
    double before = 0;
    for (std::size_t i = 0; i < bins; ++i) {
      if (i != end) before += static_cast<double>(counts[i]);
      if (i != end && before > share * others) return static_cast<double>(histogram.bin(i).min);
    }
    return static_cast<double>(range.max);
  };
  const double low = quantile(kOutliers), high = quantile(1 - kOutliers);
  return {static_cast<double>(counts[end]) / all,
          is_least ? low - static_cast<double>(range.min) : static_cast<double>(range.max) - high,
          high - low};
}

// The same in all slices along an axis: its edges lie across the others.
bool isPrism(const std::array<float, 3>& edges) {
  constexpr float kFew = 0.02f;
  const auto [fewest, most] = std::minmax_element(edges.begin(), edges.end());
  return *most > 0 && *fewest <= kFew * *most;
}

constexpr double kLeastHounsfield = -1024;

bool isPadding(const VoxelHistogram& histogram, const ValueRange& range,
               const std::optional<GradientSpectrum>& spectrum, double noise, PaddingEnds known,
               bool is_least) {
  const RangeEnd end = endOf(histogram, range, is_least);
  constexpr double kLeastGap = 0.02;  // of the others' span
  if (end.share < kLeastPaddingShare || !(end.other_span > 0) ||
      end.gap < kLeastGap * end.other_span)
    return false;
  const auto min = static_cast<double>(range.min);
  const bool is_no_hounsfield =
      is_least && min < kLeastHounsfield && std::abs(min + end.gap - kLeastHounsfield) < 100;
  PaddingEnds both = known;
  (is_least ? both.least : both.greatest) = true;
  constexpr double kFar = 2, kTwoGroups = 0.8;
  if (!spectrum) return divisionOf(histogram, range, both).share >= kTwoGroups;
  if (end.gap < kFar * end.other_span && !is_no_hounsfield &&
      !isPrism(is_least ? spectrum->at_least : spectrum->at_greatest))
    return false;
  return !IsovalueChooser(curvesOf(histogram, range, *spectrum, noise, both)).choose().empty();
}

}  // namespace

IsovalueSuggestions suggestIsovalues(const VoxelHistogram& histogram, const ValueRange& range,
                                     const std::optional<GradientSpectrum>& spectrum,
                                     double noise) {
  IsovalueSuggestions result;
  if (!(range.max > range.min)) return result;
  PaddingEnds padding;
  padding.least = isPadding(histogram, range, spectrum, noise, padding, true);
  padding.greatest = isPadding(histogram, range, spectrum, noise, padding, false);
  if (padding.least) result.padding_least = static_cast<double>(range.min);
  if (padding.greatest) result.padding_greatest = static_cast<double>(range.max);
  if (spectrum) {
    const Curves curves = curvesOf(histogram, range, *spectrum, noise, padding);
    result.values = IsovalueChooser(curves).choose();
  }
  if (result.values.empty()) {
    const double value = divisionOf(histogram, range, padding).value;
    const double span = static_cast<double>(range.max) - static_cast<double>(range.min);
    result.values.push_back({rounded(value, span / 10), 0, 0});
  }
  return result;
}

namespace {

// 101324.995 rather than 101324.99499999999.
double withoutRounding(double value) {
  constexpr int kDigits = 15;
  std::array<char, 32> digits;
  const auto written = std::to_chars(digits.data(), digits.data() + digits.size(), value,
                                     std::chars_format::general, kDigits);
  std::from_chars(digits.data(), written.ptr, value);
  return value;
}

}  // namespace

IsovalueSuggestions suggestIsovalues(const Pyramid& pyramid) {
  IsovalueSuggestions found =
      suggestIsovalues(pyramid.histogram(), pyramid.valueRange(),
                       pyramid.parts().tables().gradients(), pyramid.noise());
  const ValueTransform& values = pyramid.spec().values;
  if (values.isIdentity()) return found;
  for (IsovalueSuggestion& one : found.values) {
    const double value = values.real(one.value), shorter = withoutRounding(value);
    // Beside 2^63, fifteen digits are too few to tell values apart.
    const bool is_same = std::abs(shorter - value) <= 1e-6 * std::abs(values.scale);
    one.value = is_same ? shorter : value;
    one.gradient *= values.scale;
  }
  for (auto* const padding : {&found.padding_least, &found.padding_greatest})
    if (*padding) *padding = values.real(**padding);
  return found;
}

}  // namespace isobrick
