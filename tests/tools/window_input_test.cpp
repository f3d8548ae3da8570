// A real window of a virtual display, driven by mouse and keyboard: the callbacks of the window,
// and the clipboard that it shares with other programs.
#include <fstream>

#include "tests/support/command_test.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

// Moves, presses and types, and saves the view after each (Ctrl+Shift+S: `view 1`, `view 2`, ...),
// which shows that all before it has come.
constexpr char kDriver[] = R"(
"$1" view sphere.isb > viewer.txt 2>&1 &
viewer=$!
# Until the words are in the file, which may not be there yet.
seen() {
  for _ in $(seq 600); do
    grep -qs -- "$1" "$2" && return
    sleep 0.05
  done
  echo "no '$1' in $2 after 30 s"
  kill $viewer
  exit 1
}
saved=0
save() {
  xdotool key ctrl+shift+s
  saved=$((saved + 1))
  seen isovalue "sphere.views/view $saved.view.json"
}
window=$(timeout 30 xdotool search --sync --onlyvisible --name isobrick | head -1)
xdotool windowfocus --sync "$window"
save
xdotool mousemove 900 300 sleep 0.2 mousedown 1 sleep 0.1 mousemove 960 330 sleep 0.2 mouseup 1
save
xdotool click 4
save
xdotool click 5 sleep 0.1 click 5 sleep 0.1 key w
save
setxkbmap fr
sleep 0.5
xdotool key w  # where a US keyboard has Z
save
setxkbmap us
sleep 0.5
xdotool key Escape sleep 0.1 key ctrl+s
seen isovalue sphere.view.json
xdotool mousemove 60 115 sleep 0.2 click 1 sleep 0.3 key ctrl+a sleep 0.3 key ctrl+c
for _ in $(seq 100); do
  timeout 5 xclip -o -selection clipboard > copied.txt 2> /dev/null && [ -s copied.txt ] && break
  sleep 0.1
done
printf 2.5 | xclip -i -selection clipboard
xdotool key ctrl+a sleep 0.3 key ctrl+v sleep 0.3 key Return
save
xdotool key ctrl+q
wait $viewer
echo "the viewer ended with $?"
)";

class WindowInputTest : public CommandTest {
 protected:
  Json readView(const std::string& file) { return Json::parse(readBytes(path(file))); }
  Json view(int number) {
    return readView("sphere.views/view " + std::to_string(number) + ".view.json");
  }
  static double isovalueOf(const Json& view) {
    return view["surfaces"][0]["isovalue"].get<double>();
  }
};

TEST_F(WindowInputTest, MouseKeyboardAndClipboardReachTheView) {
  for (const char* program : {"/usr/bin/xvfb-run", "/usr/bin/xdotool", "/usr/bin/xclip"})
    if (!fs::exists(program)) SKIP_UNLESS_REQUIRED(std::string(program) + " is not there");
  runWell({"phantom", "sphere", "--voxels", "40", "-o", "sphere.mhd"});
  runWell({"build", "sphere.mhd"});
  std::ofstream(path("driver.sh")) << kDriver;
  const Outcome outcome =
      wait(start({"/usr/bin/env", "ASAN_OPTIONS=detect_leaks=0", "/usr/bin/xvfb-run", "-a", "-s",
                  "-screen 0 1400x1000x24", "/bin/bash", "driver.sh", isobrickCommand()}));
  ASSERT_EQ(outcome.status, 0) << outcome.out << outcome.err << readBytes(path("viewer.txt"));
  EXPECT_EQ(outcome.out, "the viewer ended with 0\n");
  EXPECT_EQ(readBytes(path("viewer.txt")), "");

  // A drag turns, the wheel zooms in and out.
  const Json first = view(1), turned = view(2), nearer = view(3), farther = view(4);
  EXPECT_NE(first["camera"]["azimuth"], turned["camera"]["azimuth"]);
  EXPECT_NE(first["camera"]["elevation"], turned["camera"]["elevation"]);
  EXPECT_LT(nearer["camera"]["distance"], turned["camera"]["distance"]);
  EXPECT_GT(farther["camera"]["distance"], turned["camera"]["distance"]);
  // Letters are those of the layout.
  EXPECT_EQ(nearer["wireframe"], false);
  EXPECT_EQ(farther["wireframe"], true);
  EXPECT_EQ(view(5)["wireframe"], false);
  EXPECT_TRUE(view(5)["clip_planes"].empty());
  // The isovalue before was copied, and the one after it was pasted.
  EXPECT_NEAR(std::stod(readBytes(path("copied.txt"))), isovalueOf(readView("sphere.view.json")),
              0.01);
  EXPECT_EQ(isovalueOf(view(6)), 2.5);
}

}  // namespace
}  // namespace isobrick::test
