#include "isobrick/viewer/session/surface_pace.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "isobrick/viewer/stream/latest_worker.h"

namespace isobrick {
namespace {

// The fewest triangles from which a rate is measured.
constexpr std::uint64_t kFewest = 1000;

// The growth of a radius that was too large with every surface that was not.
constexpr double kForgotten = 1.02;

double nextRate(double rate, double measured_rate, bool may_fall) {
  constexpr double kWeight = 0.3;  // of the new figure
  if (rate == 0.0) return measured_rate;
  return measured_rate > rate || may_fall ? rate + kWeight * (measured_rate - rate) : rate;
}

// The next step from a radius that fitted.
double belowTooLarge(double radius, double too_large) {
  return std::min(std::sqrt(radius * too_large), 0.9 * too_large);
}

std::vector<double> doubledRadii(double quick, double wanted) {
  std::vector<double> radii;
  for (double radius = std::min(std::max(quick, SurfacePace::kLeastRadius), wanted);
       radius < wanted; radius *= 2.0) {
    // A last step that is hardly one is left out.
    if (1.4 * radius >= wanted && !radii.empty()) break;
    radii.push_back(radius);
  }
  radii.push_back(wanted);
  return radii;
}

}  // namespace

// The rates of one extraction and of one picture.
double SurfacePace::fittingTriangles() const {
  const double extracted = times_.extraction * rates_.triangles_per_second;
  if (rates_.drawn_per_second == 0.0) return extracted;
  return std::min(extracted, times_.drawing * rates_.drawn_per_second);
}

// Whether so many are enough for the time to be mostly their cost.
bool SurfacePace::areMany(std::uint64_t triangles) const {
  constexpr double kShare = 0.25;
  return static_cast<double>(triangles) >= kShare * fittingTriangles();
}

double SurfacePace::extractionRate(std::uint64_t triangles, double seconds) const {
  if (triangles < kFewest || !(seconds > 0.0)) return rates_.triangles_per_second;
  return nextRate(rates_.triangles_per_second, static_cast<double>(triangles) / seconds,
                  areMany(triangles));
}

void SurfacePace::noteExtraction(double radius, std::uint64_t triangles, std::uint64_t made,
                                 double seconds, double finest) {
  if (4 * made < triangles) return;
  rates_.finest = finest;
  // The rate of those that were made is that of all.
  if (triangles > 0) seconds *= static_cast<double>(triangles) / static_cast<double>(made);
  rates_.triangles_per_second = extractionRate(triangles, seconds);
  const double fitting = fittingTriangles();
  // For an empty surface the time is all there is to go by.
  const double share = triangles >= kFewest ? fitting / static_cast<double>(triangles)
                                            : times_.extraction / std::max(seconds, 1e-3);
  double fits = radius * std::clamp(std::sqrt(share), 0.5, 2.0);
  rates_.too_large = radius >= rates_.too_large ? 0.0 : kForgotten * rates_.too_large;
  if (rates_.too_large > 0.0) fits = std::min(fits, belowTooLarge(radius, rates_.too_large));
  rates_.radius = std::max(kLeastRadius, fits);
}

void SurfacePace::noteGivenUp(double radius, std::uint64_t triangles, double seconds) {
  rates_.triangles_per_second = extractionRate(triangles, seconds);
  rates_.too_large = radius;
  rates_.radius = std::max(kLeastRadius, std::min(rates_.radius, 0.5 * radius));
}

void SurfacePace::noteDrawing(std::uint64_t triangles, double seconds) {
  last_drawing_ = seconds;
  if (triangles < kFewest) return;
  const double rate = static_cast<double>(triangles) / seconds;
  const bool is_known = rates_.drawn_per_second > 0.0;
  constexpr double kFaster = 4.0;
  if (seconds < 0.5 * times_.drawing && rate > kFaster * rates_.drawn_per_second)
    rates_.drawn_per_second = 0.0;
  else if (is_known || seconds >= times_.drawing || areMany(triangles))
    rates_.drawn_per_second = nextRate(rates_.drawn_per_second, rate, areMany(triangles));
}

void SurfacePace::noteOverBudget(double radius) {
  rates_.radius = std::max(kLeastRadius, 0.7 * std::min(rates_.radius, radius));
}

double SurfacePace::quickRadius(double wanted, double age, double finest) const {
  constexpr double kLeastShare = 0.25;  // a sixteenth of the surface
  const double share = std::clamp(times_.unhurried / std::max(age, 1e-9), kLeastShare, 1.0);
  const double growth = finest > 0.0 && rates_.finest > 0.0 ? finest / rates_.finest : 1.0;
  const double fits = rates_.radius * std::clamp(1.0 / std::sqrt(growth), 0.1, 2.0);
  return std::min(std::max(kLeastRadius, share * fits), wanted);
}

std::uint64_t SurfacePace::mostTriangles() const {
  constexpr double kTimes = 1.5;
  const double most = kTimes * fittingTriangles();
  return most > 0.0 ? std::max(kFewest, static_cast<std::uint64_t>(most)) : 0;
}

std::vector<double> SurfacePace::smallerRadii(double radius) {
  std::vector<double> radii;
  for (const double share : {0.5, 0.25})
    if (share * radius >= kLeastRadius) radii.push_back(share * radius);
  return radii;
}

std::vector<double> SurfacePace::passRadii(double wanted) const {
  return doubledRadii(rates_.radius, wanted);
}

std::vector<double> SurfacePace::finerRadii(double shown, double wanted) {
  std::vector<double> radii = doubledRadii(shown, wanted);
  if (radii.size() > 1) radii.erase(radii.begin());
  return radii;
}

bool SurfacePace::drawsBetterLater(const std::optional<double>& wait) const {
  return last_drawing_ > kPostponedSeconds && wait.value_or(kPostponedSeconds) < kPostponedSeconds;
}

SurfaceWait surfaceWait(double total, double extraction, double since_ready, double drawn) {
  SurfaceWait wait;
  total = std::max(total, 0.0);
  const double ready = std::clamp(since_ready, 0.0, total);
  wait.drawing = std::clamp(drawn, 0.0, ready);
  wait.uploads = ready - wait.drawing;
  wait.extraction = std::clamp(extraction, 0.0, total - ready);
  wait.before = total - ready - wait.extraction;
  return wait;
}

void DrawingTimes::add(double begin, double end) {
  constexpr std::size_t kFrames = 240;
  frames_.emplace_back(begin, end);
  if (frames_.size() > kFrames) frames_.pop_front();
}

double DrawingTimes::since(double moment) const {
  double seconds = 0.0;
  for (const auto& [begin, end] : frames_) seconds += std::max(0.0, end - std::max(begin, moment));
  return seconds;
}

void SurfaceWaits::add(std::uint64_t request, Entry entry) {
  entry.key() = request;
  times_.insert(std::move(entry));
}

void SurfaceWaits::end(const StreamMessage& pass, double now) {
  const std::optional<double> waited = longest(now);
  times_.erase(times_.begin(), times_.upper_bound(pass.request));
  if (!waited || longest(now) == waited) return;
  ended_.push_back(
      surfaceWait(*waited, pass.seconds, clockSeconds() - pass.ended, drawings_.since(pass.ended)));
}

std::optional<double> SurfaceWaits::longest(double now) const {
  for (const auto& [request, since] : times_)
    if (since) return now - *since;
  return std::nullopt;
}

}  // namespace isobrick
