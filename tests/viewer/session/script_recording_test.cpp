// A recording is a whole script at every moment.
#include "isobrick/viewer/session/script_recording.h"

#include <gtest/gtest.h>

#include <fstream>

#include "isobrick/storage/error.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

TEST(ScriptRecordingTest, TheFileIsAScriptAfterEveryEvent) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("events.json");
  std::ofstream(path) << std::string(10'000, 'x');  // replaced, and not in part
  ScriptRecording recording(path, 300, 200, 1.5);
  EXPECT_EQ(readViewScript(path).width, 300);
  EXPECT_TRUE(readViewScript(path).steps.empty());
  InputEvent event;
  for (int i = 0; i < 5; ++i) {
    event.x = i;
    recording.add(0.01 * i, event);
    const ViewScript script = readViewScript(path);
    ASSERT_EQ(script.steps.size(), static_cast<std::size_t>(i + 1));
    EXPECT_EQ(std::get<ScriptEvent>(script.steps.back()).event.x, i);
  }
  event.kind = InputEvent::Kind::kRefresh;
  recording.add(9.0, event);  // no step
  EXPECT_EQ(readViewScript(path).steps.size(), 5u);
  EXPECT_THROW(ScriptRecording(folder.file("missing/events.json"), 1, 1, 1.0), Error);
  EXPECT_THROW(ScriptRecording("/dev/full", 1, 1, 1.0), Error);
}

}  // namespace
}  // namespace isobrick
