#include "isobrick/viewer/window/frame_log.h"

#include "isobrick/storage/atomic_file.h"

namespace isobrick {

void FrameLog::writeReport(const std::string& device, const SessionStatus& status) const {
  if (report_path_.empty()) return;
  const std::string report = reportOf(frames_, device, status);
  AtomicFile file(report_path_);
  file.write(report.data(), report.size());
  file.commit();
}

}  // namespace isobrick
