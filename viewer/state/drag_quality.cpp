#include "isobrick/viewer/state/drag_quality.h"

#include <algorithm>
#include <cmath>

namespace isobrick {
namespace {

// Triangles that say something about a rate.
constexpr std::uint64_t kFewest = 1000;

// What one extraction, and one picture, do in their time.
double fittingTriangles(const DragQuality& quality) {
  const double rate = quality.drawn_per_second > 0.0
                          ? std::min(quality.triangles_per_second, quality.drawn_per_second)
                          : quality.triangles_per_second;
  return kDragSeconds * rate;
}

}  // namespace

DragQuality measured(const DragQuality& quality, double radius, std::uint64_t triangles,
                     double seconds) {
  DragQuality next = quality;
  if (triangles >= kFewest && seconds > 0.0) {
    const double rate = static_cast<double>(triangles) / seconds;
    constexpr double kWeight = 0.3;  // of the new figure
    next.triangles_per_second =
        quality.triangles_per_second == 0.0
            ? rate
            : quality.triangles_per_second + kWeight * (rate - quality.triangles_per_second);
  }
  const double fitting = fittingTriangles(next);
  // Of an empty surface the time is all there is to go by.
  const double share = triangles >= kFewest ? fitting / static_cast<double>(triangles)
                                            : kDragSeconds / std::max(seconds, 1e-3);
  next.radius = std::max(kLeastRadius, radius * std::clamp(std::sqrt(share), 0.5, 2.0));
  return next;
}

DragQuality drawn(const DragQuality& quality, std::uint64_t triangles, double seconds) {
  DragQuality next = quality;
  if (triangles < kFewest) return next;
  const double rate = static_cast<double>(triangles) / seconds;
  constexpr double kFaster = 4.0;
  if (seconds >= 0.5 * kDragSeconds)
    next.drawn_per_second = rate;
  else if (rate > kFaster * quality.drawn_per_second)
    next.drawn_per_second = 0.0;
  return next;
}

double hurriedRadius(double radius, double age) {
  constexpr double kUnhurriedSeconds = 0.1;
  constexpr double kLeastShare = 0.25;  // a sixteenth of the surface
  const double share = std::clamp(kUnhurriedSeconds / std::max(age, 1e-9), kLeastShare, 1.0);
  return std::max(kLeastRadius, share * radius);
}

std::uint64_t mostTriangles(const DragQuality& quality) {
  constexpr double kTimes = 2.0;
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

}  // namespace isobrick
