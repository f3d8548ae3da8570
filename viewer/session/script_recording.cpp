#include "isobrick/viewer/session/script_recording.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <string_view>
#include <system_error>

#include "isobrick/storage/error.h"

namespace isobrick {

ScriptRecording::ScriptRecording(const std::string& path, int width, int height, double scale)
    : path_(path), fd_(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {
  try {
    const std::string head = ScriptRecorder::head(width, height, scale);
    write(head + ScriptRecorder::kTail);
    end_ = head.size();
  } catch (...) {
    if (fd_ >= 0) close(fd_);
    throw;
  }
}

ScriptRecording::~ScriptRecording() { close(fd_); }

void ScriptRecording::add(double seconds, const InputEvent& event) {
  const std::string steps = recorder_.add(seconds, event);
  if (steps.empty()) return;
  // In one call, so that no other program sees a step without the end.
  write(steps + ScriptRecorder::kTail);
  end_ += steps.size();
}

void ScriptRecording::write(const std::string& text) {
  std::string_view rest = text;
  std::uint64_t at = end_;
  while (!rest.empty()) {
    const ssize_t written = pwrite(fd_, rest.data(), rest.size(), static_cast<off_t>(at));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0)
      throw Error("cannot record into '" + path_ + "' (" + std::generic_category().message(errno) +
                      "); record into another file",
                  {path_});
    at += static_cast<std::uint64_t>(written);
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace isobrick
