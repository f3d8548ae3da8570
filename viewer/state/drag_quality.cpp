#include "isobrick/viewer/state/drag_quality.h"

#include <algorithm>
#include <cmath>

namespace isobrick {
namespace {

// The fewest triangles from which a rate is measured.
constexpr std::uint64_t kFewest = 1000;

// The growth of a radius that was too large with every surface that was not.
constexpr double kForgotten = 1.02;

// The rates of one extraction and of one picture.
double fittingTriangles(const DragQuality& quality) {
  const double rate = quality.drawn_per_second > 0.0
                          ? std::min(quality.triangles_per_second, quality.drawn_per_second)
                          : quality.triangles_per_second;
  return kDragSeconds * rate;
}

// Whether so many are enough for the time to be mostly their cost.
bool areMany(const DragQuality& quality, std::uint64_t triangles) {
  constexpr double kShare = 0.25;
  return static_cast<double>(triangles) >= kShare * fittingTriangles(quality);
}

double nextRate(double rate, double measured_rate, bool may_fall) {
  constexpr double kWeight = 0.3;  // of the new figure
  if (rate == 0.0) return measured_rate;
  return measured_rate > rate || may_fall ? rate + kWeight * (measured_rate - rate) : rate;
}

double extractionRate(const DragQuality& quality, std::uint64_t triangles, double seconds) {
  if (triangles < kFewest || !(seconds > 0.0)) return quality.triangles_per_second;
  return nextRate(quality.triangles_per_second, static_cast<double>(triangles) / seconds,
                  areMany(quality, triangles));
}

// The next step from a radius that fitted.
double belowTooLarge(double radius, double too_large) {
  return std::min(std::sqrt(radius * too_large), 0.9 * too_large);
}

}  // namespace

DragQuality measured(const DragQuality& quality, double radius, std::uint64_t triangles,
                     double seconds) {
  DragQuality next = quality;
  next.triangles_per_second = extractionRate(quality, triangles, seconds);
  const double fitting = fittingTriangles(next);
  // For an empty surface the time is all there is to go by.
  const double share = triangles >= kFewest ? fitting / static_cast<double>(triangles)
                                            : kDragSeconds / std::max(seconds, 1e-3);
  double fits = radius * std::clamp(std::sqrt(share), 0.5, 2.0);
  next.too_large = radius >= quality.too_large ? 0.0 : kForgotten * quality.too_large;
  if (next.too_large > 0.0) fits = std::min(fits, belowTooLarge(radius, next.too_large));
  next.radius = std::max(kLeastRadius, fits);
  return next;
}

DragQuality givenUp(const DragQuality& quality, double radius, std::uint64_t triangles,
                    double seconds) {
  DragQuality next = quality;
  next.triangles_per_second = extractionRate(quality, triangles, seconds);
  next.too_large = radius;
  next.radius = std::max(kLeastRadius, std::min(quality.radius, 0.5 * radius));
  return next;
}

DragQuality drawn(const DragQuality& quality, std::uint64_t triangles, double seconds) {
  DragQuality next = quality;
  if (triangles < kFewest) return next;
  const double rate = static_cast<double>(triangles) / seconds;
  const bool is_known = quality.drawn_per_second > 0.0;
  constexpr double kFaster = 4.0;
  if (seconds < 0.5 * kDragSeconds && rate > kFaster * quality.drawn_per_second)
    next.drawn_per_second = 0.0;
  else if (is_known || seconds >= kDragSeconds || areMany(quality, triangles))
    next.drawn_per_second = nextRate(quality.drawn_per_second, rate, areMany(quality, triangles));
  return next;
}

double hurriedRadius(double radius, double age) {
  constexpr double kUnhurriedSeconds = 0.1;
  constexpr double kLeastShare = 0.25;  // a sixteenth of the surface
  const double share = std::clamp(kUnhurriedSeconds / std::max(age, 1e-9), kLeastShare, 1.0);
  return std::max(kLeastRadius, share * radius);
}

std::uint64_t mostTriangles(const DragQuality& quality) {
  constexpr double kTimes = 1.5;
  const double most = kTimes * fittingTriangles(quality);
  return most > 0.0 ? std::max(kFewest, static_cast<std::uint64_t>(most)) : 0;
}

std::vector<double> smallerRadii(double radius) {
  std::vector<double> radii;
  for (const double share : {0.5, 0.25})
    if (share * radius >= kLeastRadius) radii.push_back(share * radius);
  return radii;
}

std::vector<double> passRadii(double quick, double wanted) {
  std::vector<double> radii;
  for (double radius = std::min(std::max(quick, kLeastRadius), wanted); radius < wanted;
       radius *= 2.0) {
    // A last step that is hardly one is left out.
    if (1.4 * radius >= wanted && !radii.empty()) break;
    radii.push_back(radius);
  }
  radii.push_back(wanted);
  return radii;
}

std::vector<double> finerRadii(double shown, double wanted) {
  std::vector<double> radii = passRadii(shown, wanted);
  if (radii.size() > 1) radii.erase(radii.begin());
  return radii;
}

}  // namespace isobrick
