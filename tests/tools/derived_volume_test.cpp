// --label and --denoise: another volume is made of a volume, or of a pyramid's finest level, by
// every command in the same way.
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

constexpr std::int64_t kEdge = 40;

class DerivedVolumeTest : public CommandTest {
 protected:
  bool hasCache() const { return fs::exists(std::string(getenv("XDG_CACHE_HOME")) + "/isobrick"); }
  std::string bytesOf(const std::string& name) const { return readBytes(path(name)); }

  // An NRRD of kEdge^3 voxels: field(x, y, z).
  template <typename T, typename Field>
  void writeNrrd(const std::string& name, const std::string& type, const Field& field) const {
    std::vector<T> values;
    for (std::int64_t z = 0; z < kEdge; ++z)
      for (std::int64_t y = 0; y < kEdge; ++y)
        for (std::int64_t x = 0; x < kEdge; ++x) values.push_back(static_cast<T>(field(x, y, z)));
    std::string bytes = "NRRD0004\ntype: " + type +
                        "\ndimension: 3\nsizes: 40 40 40\nencoding: raw\nendian: little\n\n";
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    writeBytes(path(name), bytes);
  }
  // Four labels that floats cannot tell apart, each a box of its own.
  static constexpr std::uint64_t kLabels[] = {std::uint64_t{1} << 24, (std::uint64_t{1} << 24) + 1,
                                              (std::uint64_t{1} << 53) + 1, std::uint64_t{1} << 53};
  static std::uint64_t labelAt(std::int64_t x, std::int64_t y, std::int64_t z) {
    if (x < 4 || y < 4 || z < 4 || x >= 36 || y >= 24 || z >= 16) return 0;
    return kLabels[(x - 4) / 8];
  }
};

TEST_F(DerivedVolumeTest, LabelsAreExact) {
  writeNrrd<std::uint64_t>("ids.nrrd", "uint64", labelAt);
  const Json json =
      runForJson({"extract", "ids.nrrd", "--label", "16777216,16777217,9007199254740993", "-o",
                  "m.ply", "--components"});
  EXPECT_FALSE(hasCache());
  ASSERT_EQ(json["surfaces"].size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const Json& surface = json["surfaces"][i];
    EXPECT_EQ(surface["label"].get<std::uint64_t>(), kLabels[i]);
    EXPECT_EQ(surface["output"], "m-" + std::to_string(kLabels[i]) + ".ply");
    EXPECT_EQ(surface["isovalue"], 0.5);
    ASSERT_EQ(surface["components"].size(), 1u);
    const Json& piece = surface["components"][0];
    EXPECT_NEAR(piece["lower"][0].get<double>(), 3.5 + 8 * static_cast<double>(i), 1e-6);
    EXPECT_NEAR(piece["upper"][0].get<double>(), 11.5 + 8 * static_cast<double>(i), 1e-6);
    // A box of 8 x 20 x 12, less what marching cubes cuts off its edges and corners: an eighth of
    // the square along an edge, and a bit more at its ends.
    EXPECT_NEAR(piece["volume"].get<double>(), 8 * 20 * 12 - 4 * 40 / 8.0, 4);
  }
  // One alone has the name that is given.
  runWell({"extract", "ids.nrrd", "--label", "9007199254740993", "-o", "one.ply"});
  EXPECT_EQ(bytesOf("one.ply"), bytesOf("m-9007199254740993.ply"));
}

TEST_F(DerivedVolumeTest, LabelsGoTogetherInOneFile) {
  writeNrrd<std::uint64_t>("ids.nrrd", "uint64", labelAt);
  const std::string labels = "16777216,16777217";
  const Json json =
      runForJson({"extract", "ids.nrrd", "--label", labels, "--together", "-o", "all.ply"});
  const std::string all = bytesOf("all.ply");
  EXPECT_NE(all.find("property uint label\n"), std::string::npos);
  runWell({"extract", "ids.nrrd", "--label", labels, "-o", "m.ply"});
  const auto dataOf = [](const std::string& bytes) {
    return bytes.substr(bytes.find("end_header\n") + 11);
  };
  std::string vertices;
  for (std::size_t i = 0; i < 2; ++i) {
    const auto id = static_cast<std::uint32_t>(kLabels[i]);
    const auto count = json["surfaces"][i]["vertices"].get<std::size_t>();
    const std::string one = dataOf(bytesOf("m-" + std::to_string(kLabels[i]) + ".ply"));
    for (std::size_t v = 0; v < count; ++v)
      vertices += one.substr(24 * v, 24) + std::string(reinterpret_cast<const char*>(&id), 4);
  }
  EXPECT_TRUE(dataOf(all).starts_with(vertices));

  // Of a pyramid, capped, as groups; in a scene, with colours.
  runWell({"build", "ids.nrrd", "-o", "ids.isb"});
  expectFailure(2,
                {"extract", "ids.isb", "--label", "0,16777216", "--together", "--color", "1,0,0",
                 "-o", "a.glb"},
                "--color is wanted once");
  writeNrrd<std::uint8_t>("u8.nrrd", "uint8", [](auto x, auto, auto) { return x / 20; });
  runWell({"build", "u8.nrrd", "-o", "u8.isb"});
  runWell({"extract", "u8.isb", "--label", "0,1", "--together", "--cap", "-o", "a.obj"});
  const std::string text = bytesOf("a.obj");
  for (const char* group : {"\ng label_0\n", "\ng label_0_cap\n", "\ng label_1_cap\n"})
    EXPECT_NE(text.find(group), std::string::npos) << group;
  runWell({"extract", "u8.isb", "--label", "0,1", "--together", "--color", "1,0,0", "--color",
           "0,0,1", "-o", "a.glb"});
  EXPECT_NE(bytesOf("a.glb").find("\"name\":\"label 1\""), std::string::npos);
  expectFailure(1,
                {"extract", "ids.nrrd", "--label", "9007199254740993", "--together", "-o", "b.ply"},
                "is no number of 32 bits");
  expectFailure(2,
                {"extract", "u8.isb", "--label", "0,1", "--together", "--attribute",
                 "nearest:u8.isb", "-o", "b.ply"},
                "--together of labels");
  EXPECT_FALSE(fs::exists(path("b.ply")));
}

TEST_F(DerivedVolumeTest, LabelsOfAllKinds) {
  const auto ball = [](std::int64_t x, std::int64_t y, std::int64_t z) {
    const auto at = glm::dvec3(x, y, z) - glm::dvec3(19.3, 18.9, 20.2);
    return glm::length(at) < 11 ? 200 : 3;
  };
  writeNrrd<std::uint8_t>("u8.nrrd", "uint8", ball);
  writeNrrd<std::int16_t>("i16.nrrd", "int16", ball);
  writeNrrd<std::int32_t>("i32.nrrd", "int32", ball);
  writeNrrd<float>("f32.nrrd", "float", ball);
  runWell({"extract", "u8.nrrd", "--label", "200", "-o", "u8.ply"});
  for (const std::string name : {"i16", "i32"}) {
    runWell({"extract", name + ".nrrd", "--label", "200", "-o", name + ".ply"});
    EXPECT_EQ(bytesOf(name + ".ply"), bytesOf("u8.ply")) << name;
  }
  // Of pyramids too, whose voxels are less an offset here.
  writeNrrd<std::int32_t>("far.nrrd", "int32",
                          [&](auto x, auto y, auto z) { return 1700000000 + ball(x, y, z); });
  runWell({"build", "far.nrrd", "-o", "far.isb"});
  runWell({"extract", "far.isb", "--label", "1700000200", "-o", "far.ply"});
  EXPECT_EQ(bytesOf("far.ply"), bytesOf("u8.ply"));
  EXPECT_FALSE(hasCache());

  expectFailure(2, {"extract", "u8.nrrd", "--label", "200", "--iso", "3"}, "--label");
  expectFailure(2, {"extract", "u8.nrrd"}, "--iso is required");
  expectFailure(2, {"extract", "u8.nrrd", "--label", "3,3"}, "twice");
  expectFailure(2, {"extract", "u8.nrrd", "--label", "-1"}, "whole number from 0");
  expectFailure(2, {"extract", "u8.nrrd", "--label", "18446744073709551616"}, "whole number");
  expectFailure(1, {"extract", "f32.nrrd", "--label", "200"}, "whole numbers");
  const Outcome absent = run({"extract", "u8.nrrd", "--label", "4"});
  EXPECT_EQ(absent.status, 0);
  EXPECT_NE(absent.err.find("no voxel of 'u8.nrrd' has the label 4"), std::string::npos)
      << absent.err;
  // Nothing is written if one of several is in the way.
  runWell({"extract", "u8.nrrd", "--label", "200", "-o", "m-200.ply"});
  expectFailure(1, {"extract", "u8.nrrd", "--label", "3,200", "-o", "m.ply"}, "m-200.ply");
}

TEST_F(DerivedVolumeTest, SmoothedIsTheSameByEveryRoute) {
  runWell({"phantom", "head", "--voxels", "80", "-o", "head.nrrd"});
  const Json json =
      runForJson({"extract", "head.nrrd", "--iso", "500", "--denoise", "1", "-o", "direct.ply"});
  EXPECT_FALSE(hasCache());
  EXPECT_GT(json["moved"]["mean"].get<double>(), 0);
  EXPECT_LT(json["moved"]["mean"].get<double>(), 0.5);
  EXPECT_GT(json["moved"]["crossings"].get<int>(), 1000);
  const std::string wanted = bytesOf("direct.ply");

  runWell({"build", "head.nrrd"});
  runWell({"build", "head.nrrd", "--denoise", "1", "-o", "smooth.isb"});
  const auto expectWanted = [&](Words words) {
    words.insert(words.end(), {"--iso", "500", "-o", "other.ply", "--force"});
    words.insert(words.begin(), "extract");
    runWell(words);
    EXPECT_EQ(bytesOf("other.ply"), wanted) << words[1];
  };
  expectWanted({"smooth.isb"});
  expectWanted({"head.isb", "--denoise", "1"});
  expectWanted({"head.nrrd", "--denoise", "1.0", "--threads", "1"});
  expectWanted({"head.nrrd", "--denoise", "1", "--memory", "16M"});
  EXPECT_FALSE(hasCache());
  expectWanted({"head.isb", "--denoise", "1", "--cache-folder", "named"});
  // What is built goes by the option.
  runWell({"build", "head.nrrd"});
  expectWanted({"head.nrrd", "--denoise", "1"});
  EXPECT_EQ(runForJson({"info", "smooth.isb"})["voxel_type"], "float32");
  runWell({"extract", "head.isb", "--iso", "500", "-o", "plain.ply"});
  EXPECT_NE(bytesOf("plain.ply"), wanted);

  // Coarser levels are those of the smoothed volume.
  for (const std::string input : {"smooth.isb", "head.isb", "head.nrrd"}) {
    Words words = {"extract",  input,      "--iso", "500", "--focus",
                   "40,40,40", "--radius", "9",     "-o",  input + ".ply"};
    if (input != "smooth.isb") words.insert(words.end(), {"--denoise", "1"});
    runWell(words);
    EXPECT_EQ(bytesOf(input + ".ply"), bytesOf("smooth.isb.ply")) << input;
  }
  // There is a pyramid now, but only the volume says how far its surface moved.
  EXPECT_EQ(runForJson({"extract", "head.nrrd", "--iso", "500", "--denoise", "1"})["moved"],
            json["moved"]);
  // Shares.
  for (const std::string part : {"1", "2"})
    runWell({"extract", "head.isb", "--denoise", "1", "--iso", "500", "--part", part + "/2", "-o",
             part + ".isbm"});
  runWell({"merge", "1.isbm", "2.isbm", "-o", "merged.ply"});
  EXPECT_EQ(bytesOf("merged.ply"), wanted);

  expectFailure(2, {"extract", "head.nrrd", "--iso", "500", "--denoise", "0"}, "--denoise");
  expectFailure(2, {"extract", "head.nrrd", "--iso", "500", "--denoise", "11"}, "at most 10");
  expectFailure(1, {"build", "head.isb", "--denoise", "1"}, "is the input");
}

TEST_F(DerivedVolumeTest, OfALabel) {
  writeNrrd<std::uint16_t>(
      "ids.nrrd", "uint16", [](std::int64_t x, std::int64_t y, std::int64_t z) {
        return glm::length(glm::dvec3(x, y, z) - glm::dvec3(19.3, 18.9, 20.2)) < 12 ? 4711 : 12;
      });
  const Json rough = runForJson({"extract", "ids.nrrd", "--label", "4711", "--components"});
  const Json smooth = runForJson({"extract", "ids.nrrd", "--label", "4711", "--denoise", "1.25",
                                  "--components", "-o", "direct.ply"});
  EXPECT_NEAR(smooth["components"][0]["volume"].get<double>() /
                  rough["components"][0]["volume"].get<double>(),
              1, 0.015);
  runWell({"build", "ids.nrrd", "--label", "4711", "--denoise", "1.25", "-o", "label.isb"});
  runWell({"extract", "label.isb", "--iso", "0.5", "-o", "built.ply"});
  EXPECT_EQ(bytesOf("built.ply"), bytesOf("direct.ply"));
  runWell({"convert", "ids.nrrd", "--label", "4711", "-o", "mask.nrrd"});
  runWell({"extract", "mask.nrrd", "--iso", "0.5", "--denoise", "1.25", "-o", "mask.ply"});
  EXPECT_EQ(bytesOf("mask.ply"), bytesOf("direct.ply"));
  runWell({"extract", "ids.nrrd", "--label", "4711", "--denoise", "1.25", "--level", "1", "-o",
           "coarse.ply"});
  runWell({"extract", "label.isb", "--iso", "0.5", "--level", "1", "-o", "built1.ply"});
  EXPECT_EQ(bytesOf("coarse.ply"), bytesOf("built1.ply"));
}

}  // namespace
}  // namespace isobrick::test
