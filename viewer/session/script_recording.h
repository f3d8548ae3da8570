// The user's input as a script in a file, which is complete after every event.
#pragma once

#include <cstdint>
#include <string>

#include "isobrick/viewer/session/view_script.h"

namespace isobrick {

// Nothing is lost if the program ends in whatever way: the file always has the end of a script, and
// a further step takes its place.
class ScriptRecording {
 public:
  // Makes the file, or empties an existing one. The size, in pixels, and the scale are those of
  // ViewScript. Throws Error if it cannot be written, as add() does.
  ScriptRecording(const std::string& path, int width, int height, double scale);
  ~ScriptRecording();
  ScriptRecording(const ScriptRecording&) = delete;
  ScriptRecording& operator=(const ScriptRecording&) = delete;

  void add(double seconds, const InputEvent& event);

 private:
  void write(const std::string& text);

  const std::string path_;
  int fd_ = -1;
  std::uint64_t end_ = 0;  // of the last step
  ScriptRecorder recorder_;
};

}  // namespace isobrick
