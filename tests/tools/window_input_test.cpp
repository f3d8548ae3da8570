// A real window of a virtual display, driven by mouse and keyboard: the callbacks of the window,
// and the clipboard that it shares with other programs.
#include <fstream>

#include "tests/support/command_test.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

// Moves, presses and types once the window is there, in steps that the recording of the input
// shows: `seen WORDS` waits until it has them.
constexpr char kDriver[] = R"(
"$1" view sphere.isb --record record.json > viewer.txt 2>&1 &
viewer=$!
seen() {
  for _ in $(seq 600); do
    grep -qs -- "$1" "$2" && return
    sleep 0.05
  done
  echo "no '$1' in $2 after 30 s"
  kill $viewer
  exit 1
}
seen steps record.json
window=$(timeout 30 xdotool search --sync --onlyvisible --name isobrick | head -1)
xdotool windowfocus --sync "$window"
xdotool mousemove 900 300 sleep 0.2 mousedown 1 sleep 0.1 mousemove 960 330 sleep 0.2 mouseup 1
seen release record.json
xdotool click 4 sleep 0.1 click 5 sleep 0.1 click 7 sleep 0.1 key w
seen key_release...W record.json
setxkbmap fr
sleep 0.5
xdotool key a  # where a US keyboard has Q
seen key_release...A record.json
setxkbmap us
sleep 0.5
xdotool key Escape sleep 0.1 key ctrl+s
seen isovalue sphere.view.json
xdotool mousemove 60 115 sleep 0.2 click 1 sleep 0.3 key ctrl+a sleep 0.3 key ctrl+c sleep 0.3
seen key_release...C record.json
timeout 5 xclip -o -selection clipboard > copied.txt
printf 2.5 | xclip -i -selection clipboard
xdotool key ctrl+a sleep 0.3 key ctrl+v sleep 0.3 key Return
seen key_release...ENTER record.json
xdotool key ctrl+shift+s
seen isovalue "sphere.views/view 1.view.json"
xdotool key ctrl+q
wait $viewer
echo "the viewer ended with $?"
)";

class WindowInputTest : public CommandTest {
 protected:
  double isovalueOf(const std::string& view) {
    return Json::parse(readBytes(path(view)))["surfaces"][0]["isovalue"].get<double>();
  }
};

TEST_F(WindowInputTest, MouseKeyboardAndClipboardReachTheView) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool", "/usr/bin/xclip"})
    if (!fs::exists(program)) SKIP_UNLESS_REQUIRED(std::string(program) + " is not there");
  runWell({"phantom", "sphere", "--size", "40", "-o", "sphere.mhd"});
  runWell({"build", "sphere.mhd"});
  std::ofstream(path("driver.sh")) << kDriver;
  const Outcome outcome =
      wait(start({"/usr/bin/env", "ASAN_OPTIONS=detect_leaks=0", "/usr/bin/xvfb-run", "-a", "-s",
                  "-screen 0 1400x1000x24", "/bin/bash", "driver.sh", isobrickCommand()}));
  ASSERT_EQ(outcome.status, 0) << outcome.out << outcome.err << readBytes(path("viewer.txt"));
  EXPECT_EQ(outcome.out, "the viewer ended with 0\n");
  EXPECT_EQ(readBytes(path("viewer.txt")), "");

  const Json record = Json::parse(readBytes(path("record.json")));
  std::set<std::string> seen;
  for (const Json& step : record["steps"]) seen.insert(step.dump());
  for (const Json& step :
       {Json{{"press", "left"}}, Json{{"release", "left"}}, Json{{"wheel", 1.0}},
        Json{{"wheel", -1.0}}, Json{{"wheel", {0.0, 1.0}}}, Json{{"key_press", "W"}},
        Json{{"text", "w"}}, Json{{"key_press", "A"}}, Json{{"move", {960.0, 330.0}}},
        Json{{"key_press", "S"}, {"control", true}, {"shift", true}}})
    EXPECT_TRUE(seen.contains(step.dump())) << step;
  EXPECT_FALSE(seen.contains(Json{{"key_press", "Q"}}.dump()));
  // The isovalue before was copied, and the one after it was pasted.
  EXPECT_EQ(Json::parse(readBytes(path("sphere.view.json")))["wireframe"], true);
  EXPECT_NEAR(std::stod(readBytes(path("copied.txt"))), isovalueOf("sphere.view.json"), 0.01);
  EXPECT_EQ(isovalueOf("sphere.views/view 1.view.json"), 2.5);
}

}  // namespace
}  // namespace isobrick::test
