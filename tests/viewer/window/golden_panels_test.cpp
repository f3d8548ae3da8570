// The window with its panels, in colour, held against pictures of an earlier day
// (tests/golden/panels).
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "isobrick/viewer/egl_context.h"
#include "tests/support/offscreen_view.h"
#include "tests/support/picture_similarity.h"
#include "tests/support/png_reader.h"
#include "tests/support/requirement.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

// Sections are folded and unfolded by clicks on their headings, from the last one to the first, so
// that the headings above stay where they are; the others are further down.
constexpr char kScript[] = R"({"size": [640, 640], "steps": [
    {"wait": "settled"}, {"move": [500, 40]}, {"wait": 0.6}, {"frame": "first.png"},
    {"click": [150, 575]}, {"click": [150, 519]}, {"click": [150, 435]},
    {"click": [150, 575]}, {"click": [150, 519]}, {"move": [150, 580]}, {"wheel": -4}, {"move": [500, 40]},
    {"wait": 0.6}, {"frame": "sections.png"},
    {"key": "H"}, {"wait": 0.6}, {"frame": "keys.png"}, {"key": "H"},
    {"key": "U"}, {"wait": "settled"}, {"wait": 0.6}, {"frame": "slices.png"}]})";

// ISOBRICK_WRITE_GOLDEN=1 writes them anew, to be looked at before they are kept.
TEST(GoldenPanelsTest, TheWindowLooksAsItDid) {
  try {
    const EglContext probe;
  } catch (const Error& error) {
    SKIP_UNLESS_REQUIRED(error.what());
  }
  const test::TemporaryFolder folder;
  const ViewOptions options = test::offscreenView(folder);
  std::ofstream(options.script_path) << kScript;
  runView(options);

  const std::string golden = test::goldenFolder() + "/panels/";
  std::vector<PictureBytes> seen;
  for (const std::string name : {"first.png", "sections.png", "keys.png", "slices.png"}) {
    if (test::environmentSays("ISOBRICK_WRITE_GOLDEN"))
      std::filesystem::copy_file(folder.file(name), golden + name,
                                 std::filesystem::copy_options::overwrite_existing);
    seen.push_back(test::readPng(folder.file(name), 640));
    EXPECT_GT(test::similarity(seen.back(), test::readPng(golden + name, 640)), 0.97) << name;
  }
  // The measure tells them apart.
  for (std::size_t i = 1; i < seen.size(); ++i)
    EXPECT_LT(test::similarity(seen[i - 1], seen[i]), 0.93) << i;
}

}  // namespace
}  // namespace isobrick
