#include "isobrick/viewer/session/session_status.h"

#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "isobrick/storage/atomic_file.h"

namespace isobrick {
namespace {

std::string whole(double number) { return std::to_string(std::llround(number)); }

std::string budgetLimit(const SurfaceRequests& requests, const SessionStatus& status) {
  if (!requests.showsTheLatest()) return "GPU budget reached: not even the coarsest surface fits";
  return "GPU budget reached: showing radius " + whole(status.shown_radius) + " of " +
         whole(status.wanted_radius);
}

nlohmann::ordered_json spreadOf(std::vector<double> values) {
  auto spread = nlohmann::ordered_json::object();
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values.empty()
               ? 0.0
               : values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  spread["median"] = at(0.5);
  spread["p95"] = at(0.95);
  spread["max"] = at(1.0);
  return spread;
}

// The ages of surfaces when another one replaced them, and their parts.
void addWaits(const std::vector<ReportedFrame>& frames, nlohmann::ordered_json& report) {
  constexpr std::array<std::pair<const char*, double SurfaceWait::*>, 4> kParts{
      {{"before", &SurfaceWait::before},
       {"extraction", &SurfaceWait::extraction},
       {"uploads", &SurfaceWait::uploads},
       {"drawing", &SurfaceWait::drawing}}};
  std::map<std::string, std::vector<double>> values;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ReportedFrame& f : frames) {
    for (const SurfaceWait& wait : f.waits) {
      nlohmann::ordered_json& one = list.emplace_back();
      one["seconds"] = f.seconds;
      one["triangles_made"] = f.triangles_made;
      one["total_ms"] = 1e3 * wait.total();
      values["total"].push_back(1e3 * wait.total());
      for (const auto& [name, part] : kParts) {
        one[std::string(name) + "_ms"] = 1e3 * wait.*part;
        values[name].push_back(1e3 * wait.*part);
      }
    }
  }
  for (const char* name : {"total", "before", "extraction", "uploads", "drawing"})
    report["surface_wait_ms"][name] = spreadOf(values[name]);
  report["each_surface"] = std::move(list);
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

std::string reportOf(const std::vector<ReportedFrame>& frames, const std::string& device,
                     const SessionStatus& status) {
  auto report = nlohmann::ordered_json::object();
  report["device"] = device;
  report["frames"] = frames.size();
  report["scenes_drawn"] = std::count_if(frames.begin(), frames.end(),
                                         [](const auto& frame) { return frame.scene_drawn; });
  report["seconds"] = frames.empty() ? 0.0 : frames.back().seconds;
  const auto spread = [&](auto&& value) {
    std::vector<double> values;
    for (const ReportedFrame& frame : frames) values.push_back(value(frame));
    return spreadOf(std::move(values));
  };
  report["interface_ms"] = spread([](const auto& f) { return 1e3 * f.times.interface; });
  report["draw_ms"] = spread([](const auto& f) { return 1e3 * f.times.draw; });
  report["surface_age_ms"] = spread([](const auto& f) { return 1e3 * f.surface_age; });
  report["uploaded_bytes"] =
      spread([](const auto& f) { return static_cast<double>(f.uploaded_bytes); });
  report["passes"] = status.passes;
  addWaits(frames, report);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  report["peak_rss_bytes"] = std::uint64_t{1024} * static_cast<std::uint64_t>(usage.ru_maxrss);
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ReportedFrame& f : frames)
    list.push_back({{"seconds", f.seconds},
                    {"interface_ms", 1e3 * f.times.interface},
                    {"draw_ms", 1e3 * f.times.draw},
                    {"surface_age_ms", 1e3 * f.surface_age},
                    {"radius", f.shown_radius},
                    {"triangles", f.triangles},
                    {"triangles_made", f.triangles_made},
                    {"uploaded_bytes", f.uploaded_bytes}});
  report["each_frame"] = std::move(list);
  return report.dump(1) + "\n";
}

void FrameLog::writeReport(const std::string& device, const SessionStatus& status) const {
  if (report_path_.empty()) return;
  const std::string report = reportOf(frames_, device, status);
  AtomicFile file(report_path_);
  file.write(report.data(), report.size());
  file.commit();
}

}  // namespace isobrick
