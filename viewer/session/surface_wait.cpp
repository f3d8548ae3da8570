#include "isobrick/viewer/session/surface_wait.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "isobrick/viewer/clock_seconds.h"

namespace isobrick {

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
