#include "isobrick/viewer/session/surface_wait.h"

#include <algorithm>
#include <cstddef>

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

}  // namespace isobrick
