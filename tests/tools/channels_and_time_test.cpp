// Volumes of several channels and steps of time: a pyramid of each, and commands over all of these.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

constexpr int kSide = 20;

// A ball in each, that grows with time and channel.
class ChannelsAndTimeTest : public CommandTest {
 protected:
  void SetUp() override { writeStore({3, 2}); }

  // An OME-Zarr of version 0.4, with a file of its own for each channel and step.
  void writeStore(const std::array<int, 2>& times_and_channels) {
    const auto [times, channels] = times_and_channels;
    fs::create_directories(path("run.ome.zarr/0"));
    const auto write = [&](const std::string& name, const std::string& text) {
      std::ofstream(path("run.ome.zarr/" + name)) << text;
    };
    write(".zgroup", R"({"zarr_format": 2})");
    write(".zattrs", R"({"multiscales": [{"version": "0.4", "axes": [
        {"name": "t", "type": "time"}, {"name": "c", "type": "channel"},
        {"name": "z", "type": "space"}, {"name": "y", "type": "space"},
        {"name": "x", "type": "space"}], "datasets": [{"path": "0", "coordinateTransformations": [
        {"type": "scale", "scale": [1, 1, 1, 1, 1]}]}]}],
        "omero": {"channels": [{"label": "DAPI", "color": "0000FF"},
                               {"label": "Alexa/488", "color": "00ff00"}]}})");
    Json array = {
        {"zarr_format", 2},   {"dtype", "|u1"},  {"compressor", nullptr},     {"order", "C"},
        {"filters", nullptr}, {"fill_value", 0}, {"dimension_separator", "."}};
    array["shape"] = {times, channels, kSide, kSide, kSide};
    array["chunks"] = {1, 1, kSide, kSide, kSide};
    write("0/.zarray", array.dump());
    for (int t = 0; t < times; ++t)
      for (int c = 0; c < channels; ++c) write(chunk(t, c), ball(4.0 + t + 2 * c));
  }
  static std::string chunk(int t, int c) {
    return "0/" + std::to_string(t) + "." + std::to_string(c) + ".0.0.0";
  }
  static std::string ball(double radius) {
    std::string voxels;
    const double middle = 0.5 * (kSide - 1);
    for (int z = 0; z < kSide; ++z)
      for (int y = 0; y < kSide; ++y)
        for (int x = 0; x < kSide; ++x) {
          const double away = std::hypot(x - middle, y - middle, z - middle);
          voxels +=
              static_cast<char>(std::clamp(std::lround(100 + 10 * (radius - away)), 0L, 255L));
        }
    return voxels;
  }
  double radiusOf(const std::string& pyramid) {
    const Json json = runForJson({"extract", pyramid, "--iso", "100", "--components"});
    return std::cbrt(json["components"][0]["volume"].get<double>() * 3 / 4 / std::acos(-1.0));
  }
};

TEST_F(ChannelsAndTimeTest, EachChannelIsAPyramidThatIsNamedAfterIt) {
  const Json json = runForJson({"build", "run.ome.zarr", "--select", "channel=all", "--select",
                                "time=1", "-o", "run-{channel}.isb"});
  EXPECT_EQ(json["built"], 2);
  const std::pair<const char*, const char*> wanted[] = {{"0", "run-DAPI.isb"},
                                                        {"1", "run-Alexa-488.isb"}};
  for (const auto& [number, name] : wanted) {
    runWell({"build", "run.ome.zarr", "--select", std::string("channel=") + number, "--select",
             "time=1", "-o", "alone.isb", "--force"});
    EXPECT_EQ(readBytes(path(name)), readBytes(path("alone.isb"))) << name;
  }
  EXPECT_NEAR(radiusOf("run-DAPI.isb"), 5.0, 0.1);
  EXPECT_NEAR(radiusOf("run-Alexa-488.isb"), 7.0, 0.1);
  EXPECT_NE(runWell({"info", "run-Alexa-488.isb"}).find("channel    Alexa/488 #00ff00\n"),
            std::string::npos);
  EXPECT_EQ(runForJson({"info", "run-DAPI.isb"})["provenance"]["channel"],
            Json({{"number", 0}, {"name", "DAPI"}, {"color", "#0000ff"}}));
  const Json again = runForJson({"build", "run.ome.zarr", "--select", "channel=all", "--select",
                                 "time=1", "-o", "run-{channel}.isb"});
  EXPECT_EQ(again["skipped"], 2);
}

TEST_F(ChannelsAndTimeTest, EachStepIsAPyramidWithItsNumber) {
  runWell({"build", "run.ome.zarr", "--select", "time=all", "--select", "channel=1"});
  for (int t = 0; t < 3; ++t)
    EXPECT_NEAR(radiusOf("run.ome.zarr-" + std::to_string(t) + ".isb"), 6.0 + t, 0.1);
  runWell({"build", "run.ome.zarr", "--select", "time=all", "--select", "channel=all", "-o",
           "{channel}-{time}.isb"});
  EXPECT_NEAR(radiusOf("Alexa-488-2.isb"), 8.0, 0.1);
  EXPECT_NEAR(radiusOf("DAPI-0.isb"), 4.0, 0.1);
}

TEST_F(ChannelsAndTimeTest, NamesOfStepsHaveOneLength) {
  fs::remove_all(path("run.ome.zarr"));
  writeStore({11, 1});
  runWell({"build", "run.ome.zarr", "--select", "time=all", "-o", "run-{time}.isb"});
  EXPECT_TRUE(fs::exists(path("run-00.isb")));
  EXPECT_TRUE(fs::exists(path("run-10.isb")));
}

// Other channels would be refused if they were read: their chunks are too short.
TEST_F(ChannelsAndTimeTest, NothingIsReadOfTheOthers) {
  for (int t = 0; t < 3; ++t) std::ofstream(path("run.ome.zarr/" + chunk(t, 1))) << "short";
  const Words words{"build", "run.ome.zarr",   "--select", "time=all",
                    "-o",    "run-{time}.isb", "--select"};
  Words good = words, bad = words;
  good.emplace_back("channel=0");
  runWell(good);
  bad.insert(bad.end(), {"channel=1", "--force"});
  EXPECT_EQ(run(bad).status, 1);
}

TEST_F(ChannelsAndTimeTest, InfoListsThem) {
  const Json json = runForJson({"info", "run.ome.zarr"});
  EXPECT_EQ(json["time_steps"], 3);
  EXPECT_EQ(json["channels"], Json::parse(R"([{"name": "DAPI", "color": "#0000ff"},
                                              {"name": "Alexa/488", "color": "#00ff00"}])"));
  const std::string text = runWell({"info", "run.ome.zarr"});
  EXPECT_NE(text.find("time       3 steps"), std::string::npos) << text;
  EXPECT_NE(text.find("channel 1  Alexa/488 #00ff00\n"), std::string::npos) << text;
}

TEST_F(ChannelsAndTimeTest, NamesNeedPlacesForWhatTellsThemApart) {
  expectFailure(2, {"build", "run.ome.zarr", "--select", "channel=all", "-o", "one.isb"},
                "{channel}");
  expectFailure(2, {"build", "run.ome.zarr", "-o", "run-{time}.isb"}, "--select time=all");
  expectFailure(2, {"build", "run.ome.zarr", "--select", "time=all", "-o", "run-{time}.isbs"},
                "one file");
  expectFailure(2, {"convert", "run.ome.zarr", "--select", "channel=all", "-o", "one.nrrd"},
                "'isobrick build'");
  expectFailure(1, {"extract", "run.ome.zarr", "--select", "channel=all", "--iso", "100"},
                "isobrick build");
}

class ManyPyramidsTest : public ChannelsAndTimeTest {
 protected:
  void SetUp() override {
    ChannelsAndTimeTest::SetUp();
    runWell({"build", "run.ome.zarr", "--select", "time=all", "--select", "channel=0", "-o",
             "run-{time}.isb"});
  }
};

TEST_F(ManyPyramidsTest, ExtractWritesAFileOfEach) {
  const Json json = runForJson(
      {"extract", "run-0.isb", "run-1.isb", "run-2.isb", "--iso", "100", "-o", "ball-{name}.ply"});
  ASSERT_EQ(json["surfaces"].size(), 3u);
  for (std::size_t t = 0; t < 3; ++t) {
    const std::string name = "run-" + std::to_string(t);
    EXPECT_EQ(json["surfaces"][t]["file"], name + ".isb");
    EXPECT_EQ(json["surfaces"][t]["output"], "ball-" + name + ".ply");
    runWell({"extract", name + ".isb", "--iso", "100", "-o", "alone.ply", "--force"});
    EXPECT_EQ(readBytes(path("ball-" + name + ".ply")), readBytes(path("alone.ply"))) << name;
  }
  runWell({"extract", "run-0.isb", "run-1.isb", "--iso", "90,100", "-o", "m.stl"});
  for (const char* name :
       {"m-run-0-90.stl", "m-run-0-100.stl", "m-run-1-90.stl", "m-run-1-100.stl"})
    EXPECT_TRUE(fs::exists(path(name))) << name;
}

TEST_F(ManyPyramidsTest, EachMayHaveItsIsovalue) {
  const Json json =
      runForJson({"extract", "run-0.isb", "run-1.isb", "--iso", "80", "--iso", "100,120"});
  ASSERT_EQ(json["surfaces"].size(), 3u);
  EXPECT_EQ(json["surfaces"][0]["isovalue"], 80.0);
  EXPECT_EQ(json["surfaces"][1]["file"], "run-1.isb");
  EXPECT_EQ(json["surfaces"][2]["isovalue"], 120.0);
  expectFailure(2, {"extract", "run-0.isb", "run-1.isb", "run-2.isb", "--iso", "1", "--iso", "2"},
                "for 3 files");
}

TEST_F(ManyPyramidsTest, ParaViewGetsAListOfTheSteps) {
  runWell({"extract", "run-0.isb", "run-1.isb", "--iso", "90,100", "-o", "run.pvd"});
  EXPECT_EQ(readBytes(path("run.pvd")), R"(<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1">
  <Collection>
    <DataSet timestep="0" part="0" file="run-run-0-90.vtp"/>
    <DataSet timestep="0" part="1" file="run-run-0-100.vtp"/>
    <DataSet timestep="1" part="0" file="run-run-1-90.vtp"/>
    <DataSet timestep="1" part="1" file="run-run-1-100.vtp"/>
  </Collection>
</VTKFile>
)");
  EXPECT_TRUE(fs::exists(path("run-run-1-100.vtp")));
  expectFailure(1, {"extract", "run-0.isb", "--iso", "100", "-o", "run.pvd"}, "run.pvd");
}

TEST_F(ManyPyramidsTest, NothingIsWrittenIfOneOfThemIsInTheWay) {
  std::ofstream(path("m-run-1.ply")) << "mine";
  expectFailure(1, {"extract", "run-0.isb", "run-1.isb", "--iso", "100", "-o", "m.ply"},
                "m-run-1.ply");
  fs::create_directories(path("b"));
  fs::copy(path("run-0.isb"), path("b/run-0.isb"));
  expectFailure(2, {"extract", "run-0.isb", "b/run-0.isb", "--iso", "100", "-o", "m.ply"},
                "both become 'm-run-0.ply'");
}

}  // namespace
}  // namespace isobrick::test
