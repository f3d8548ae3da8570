// Views as files: what they were saved of, and where their paths lead.
#include "isobrick/viewer/state/view_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

class ViewFileTest : public ::testing::Test {
 protected:
  // A view of `volume`, coloured by `other`.
  static SavedView viewOf(const std::string& volume, const std::string& other) {
    SavedView view{volume, {}};
    view.state.wireframe = true;
    view.state.values.other = other;
    return view;
  }
  std::string refusal(const std::string& text) const {
    std::ofstream(path_) << text;
    try {
      readView(path_);
    } catch (const Error& error) {
      return error.what();
    }
    return "accepted";
  }
  nlohmann::json written() const { return nlohmann::json::parse(test::readBytes(path_)); }

  test::TemporaryFolder folder_;
  const std::string path_ = folder_.file("scan.view.json");
};

TEST_F(ViewFileTest, AViewSaysItsVersionAndItsVolume) {
  EXPECT_THROW(readView(path_), Error);
  writeView(path_, viewOf("phantom:head:64", ""));
  EXPECT_EQ(written()["version"], 1);
  EXPECT_EQ(written()["volume"], "phantom:head:64");
  const SavedView view = readView(path_);
  EXPECT_EQ(view.volume, "phantom:head:64");
  EXPECT_EQ(view.state, viewOf("", "").state);
}

// The folder of both is moved, and the current folder is another one.
TEST_F(ViewFileTest, PathsBelowItsFolderMoveWithIt) {
  writeView(path_, viewOf(folder_.file("scan.isb"), folder_.file("more/pet.isb")));
  EXPECT_EQ(written()["volume"], "scan.isb");
  EXPECT_EQ(written()["values"]["other"], "more/pet.isb");
  const test::TemporaryFolder elsewhere;
  fs::copy_file(path_, elsewhere.file("scan.view.json"));
  const SavedView view = readView(elsewhere.file("scan.view.json"));
  EXPECT_EQ(view.volume, elsewhere.file("scan.isb"));
  EXPECT_EQ(view.state.values.other, elsewhere.file("more/pet.isb"));
}

TEST_F(ViewFileTest, VolumesBesideComeBack) {
  SavedView view = viewOf(folder_.file("ct.isb"), "");
  view.beside = {folder_.file("pet.isb"), "/data/mr.isb"};
  view.state.surfaces.resize(3);
  view.state.surfaces[2].volume = 2;
  writeView(path_, view);
  EXPECT_EQ(written()["beside"], nlohmann::json({"pet.isb", "/data/mr.isb"}));
  EXPECT_EQ(readView(path_).beside, view.beside);
  EXPECT_EQ(readView(path_).state, view.state);
  writeView(path_, viewOf("", ""));
  EXPECT_FALSE(written().contains("beside"));
  EXPECT_NE(refusal(R"({"beside": [1]})").find("beside"), std::string::npos);
  EXPECT_NE(refusal(R"({"beside": ["a"]})").find("'volume' is missing"), std::string::npos);
  const nlohmann::json many{{"volume", "a"}, {"beside", std::vector<std::string>(8, "b")}};
  EXPECT_NE(refusal(many.dump()).find("more than 8 volumes"), std::string::npos);
}

TEST_F(ViewFileTest, ARegionComesBackWithItsMasks) {
  SavedView view = viewOf("", "");
  view.state.region.half_spaces = {{{0.1, 0.2, 0.3}, 4.0 / 3.0}};
  view.state.region.balls = {{{1, 2, 3}, 0.7}, {{4, 5, 6}, 8}};
  view.state.region.masks = {{folder_.file("organs.nrrd"), 7.0}, {"phantom:sphere:64", {}}};
  writeView(path_, view);
  EXPECT_EQ(written()["region"]["masks"][0]["path"], "organs.nrrd");
  EXPECT_EQ(readView(path_).state, view.state);
  EXPECT_NE(refusal(R"({"region": {"half_spaces": [{"normal": [0, 0, 0]}]}})").find("normal"),
            std::string::npos);
  EXPECT_NE(refusal(R"({"region": {"balls": [{"radius": 0}]}})").find("radius"), std::string::npos);
}

TEST_F(ViewFileTest, OtherPathsAreAbsolute) {
  writeView(path_, viewOf("here.isb", "https://host/pet.isb"));
  EXPECT_EQ(written()["volume"], (fs::current_path() / "here.isb").string());
  const SavedView view = readView(path_);
  EXPECT_EQ(view.volume, (fs::current_path() / "here.isb").string());
  EXPECT_EQ(view.state.values.other, "https://host/pet.isb");
}

TEST_F(ViewFileTest, OlderViewsAreReadAndLaterOnesRefused) {
  std::ofstream(path_) << R"({"wireframe": true})";
  EXPECT_EQ(readView(path_).volume, "");
  EXPECT_TRUE(readView(path_).state.wireframe);
  EXPECT_NE(refusal(R"({"version": 2, "new": 1})").find("'version' is later than 1"),
            std::string::npos);
  EXPECT_NE(refusal(R"({"version": "one"})").find("'version'"), std::string::npos);
  EXPECT_NE(refusal(R"({"volume": 3})").find("'volume'"), std::string::npos);
  EXPECT_NE(refusal(R"({"wirefram": true})").find("'" + path_ + "'"), std::string::npos);
}

TEST_F(ViewFileTest, TextThatIsNestedDeepIsRefusedBeforeItTakesTheStack) {
  EXPECT_THROW(viewStateFromJson(R"({"measurements":[{"surface_isovalue":)" +
                                 std::string(100'000, '[') + std::string(100'000, ']') + "}]}"),
               Error);
}

}  // namespace
}  // namespace isobrick
