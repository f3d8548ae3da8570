#include "isobrick/viewer/session/session_status.h"

#include <cmath>

namespace isobrick {
namespace {

std::string whole(double number) { return std::to_string(std::llround(number)); }

std::string budgetLimit(const SurfaceRequests& requests, const SessionStatus& status) {
  if (!requests.showsTheLatest()) return "GPU budget reached: not even the coarsest surface fits";
  return "GPU budget reached: showing radius " + whole(status.shown_radius) + " of " +
         whole(status.wanted_radius);
}

}  // namespace

SessionStatus statusOf(const SurfaceRequests& requests, const ShownVolume& volume,
                       const ViewState& state, bool is_fine) {
  const ShownSurfaces& shown = requests.shown();
  const StreamMessage& pass = shown.pass();
  SessionStatus status;
  status.wanted_radius = volume.radiusAtRest(state);
  status.shown_radius = pass.radius;
  status.triangles = shown.triangles();
  status.triangles_made = pass.triangles_made;
  status.shown_bytes = requests.chunkBytes();
  status.bricks_read = pass.bricks_read;
  status.extract_seconds = pass.seconds;
  status.levels = shown.levels();
  for (LevelCounts& level : status.levels) level.level += volume.firstLevel();
  status.triangles_per_second = requests.pace().rates().triangles_per_second;
  status.drag_radius = requests.pace().rates().radius;
  status.passes = shown.passes();
  status.surface_age = requests.longestWait().value_or(0.0);
  if (requests.isFollowingUser())
    status.doing = "following the user";
  else if (is_fine)
    status.doing = "ready";
  else if (!pass.is_complete)
    status.doing = "reading what is lacking";
  else
    status.doing = "refining to radius " + whole(status.wanted_radius);
  if (volume.previewOf())
    status.limited = "preview at 1/" + std::to_string(volume.previewOf()->step);
  if (requests.isOverBudget()) status.limited = budgetLimit(requests, status);
  status.error = requests.error();
  return status;
}

}  // namespace isobrick
