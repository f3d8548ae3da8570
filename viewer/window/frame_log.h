// The times of frames: of the last ones for the panel, of all of them for a report.
#pragma once

#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/viewer/session/frame_report.h"

namespace isobrick {

class FrameLog {
 public:
  // `report_path`: empty: only the last frames are kept.
  explicit FrameLog(std::string report_path) : report_path_(std::move(report_path)) {}

  void add(ReportedFrame frame) {
    latest_.push_back(frame.times);
    if (latest_.size() > kFrameTimes) latest_.pop_front();
    if (!report_path_.empty()) frames_.push_back(std::move(frame));
  }
  const std::deque<FrameTimes>& latest() const { return latest_; }

  // If there is a path. `device`: that drew; `status`: after the last frame. Throws Error.
  void writeReport(const std::string& device, const SessionStatus& status) const;

 private:
  static constexpr std::size_t kFrameTimes = 240;

  const std::string report_path_;
  std::deque<FrameTimes> latest_;
  std::vector<ReportedFrame> frames_;
};

}  // namespace isobrick
