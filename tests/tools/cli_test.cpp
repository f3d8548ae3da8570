// The `isobrick` command from outside: whole runs and every kind of bad input. All that is special
// to build is in build_command_test.cpp.
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <sstream>
#include <vector>

#include "tests/support/command_test.h"
#include "tests/support/plain_reader.h"
#include "tests/support/ply_reader.h"
#include "tests/support/test_paths.h"

namespace isobrick {
namespace {

using namespace test;

class CliTest : public CommandTest {
 protected:
  // sphere.nrrd and sphere.isb of 8 bricks on level 0.
  void makeSphere() {
    runWell({"phantom", "sphere", "--voxels", "32", "-o", "sphere.nrrd"});
    runWell({"build", "sphere.nrrd", "--brick", "16"});
  }
  // A raw volume of 8 x 9 x 10 float32 voxels, x + y + z each.
  std::string makeRawVolume() const {
    std::string bytes;
    for (int i = 0; i < 8 * 9 * 10; ++i) {
      const auto value = static_cast<float>(i % 8 + i / 8 % 9 + i / 72);
      bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    return bytes;
  }
  static Words buildRaw(const std::string& name, const std::string& dims = "8,9,10") {
    return {"build", name, "--raw-dims", dims, "--raw-type", "f32"};
  }
};

void expectBuildOfHead(const Json& built, std::uint64_t file_bytes) {
  EXPECT_EQ(built["output"], "head.isb");
  EXPECT_EQ(built["dimensions"], Json({64, 64, 64}));
  EXPECT_EQ(built["voxel_type"], "int16");
  EXPECT_EQ(built["threads"], 2);
  EXPECT_EQ(built["bytes"]["total"], file_bytes);
  for (const char* key : {"notes", "peak_rss_bytes", "megabytes_per_second"})
    EXPECT_TRUE(built.contains(key)) << key;
  EXPECT_TRUE(built["seconds"].contains("total"));
}

void expectInfoOfHead(const Json& info) {
  EXPECT_EQ(info["dimensions"], Json({64, 64, 64}));
  EXPECT_EQ(info["voxel_type"], "int16");
  EXPECT_EQ(info["spacing"], Json({1.0, 1.0, 1.0}));
  EXPECT_EQ(info["origin"].size(), 3u);
  EXPECT_EQ(info["direction"][1], Json({0.0, 1.0, 0.0}));
  EXPECT_LT(info["value_range"][0], 500);
  EXPECT_GT(info["value_range"][1], 1324);
  EXPECT_EQ(info["levels"].size(), 7u);
  EXPECT_EQ(info["levels"][1]["level"], 1);
  EXPECT_EQ(info["levels"][1]["dimensions"], Json({33, 33, 33}));
  EXPECT_EQ(info["levels"][0]["bricks"], 64);
  std::uint64_t parts = 0;
  for (const char* key : {"samples_level0", "samples_coarser", "ranges", "curvature", "index"})
    parts += info["bytes"][key].get<std::uint64_t>();
  EXPECT_EQ(info["bytes"]["total"], parts);
  EXPECT_EQ(info["bytes"]["raw"], 64 * 64 * 64 * 2);
  EXPECT_EQ(info["brick_cells"], 16);
  EXPECT_EQ(info["tile_cells"], 4);
  EXPECT_EQ(info["has_curvature"], true);
  EXPECT_EQ(info["curvature_epsilon"], 1.0 / 64);
  EXPECT_EQ(info["filter"], "average");
  EXPECT_EQ(info["provenance"]["source"], "head.nrrd");
}

void expectMeshOfHead(const Json& mesh, const test::PlyMesh& ply) {
  EXPECT_GT(ply.triangles.size(), 3000u);
  EXPECT_EQ(mesh["triangles"], ply.triangles.size() / 3);
  EXPECT_EQ(mesh["vertices"], ply.positions.size());
  EXPECT_EQ(mesh["output"], "bone.ply");
  EXPECT_EQ(mesh["isovalue"], 1324);
  EXPECT_EQ(mesh["threads"], 2);
  EXPECT_EQ(mesh["seconds"]["extract"].size(), 2u);
  EXPECT_GE(mesh["seconds"]["open"], 0);
  EXPECT_GT(mesh["seconds"]["write"], 0);
  std::uint64_t triangles = 0;
  for (const Json& level : mesh["levels"]) {
    triangles += level["triangles"].get<std::uint64_t>();
    EXPECT_GE(level["cells"], level["transition_cells"]);
  }
  EXPECT_GT(mesh["levels"].size(), 1u);
  EXPECT_EQ(mesh["triangles"], triangles);
  EXPECT_GT(mesh["bricks"]["active"], 0);
  EXPECT_GE(mesh["bricks"]["read"], mesh["bricks"]["active"]);
  EXPECT_GE(mesh["bytes_read"], mesh["bytes_active"]);
  EXPECT_GT(mesh["peak_rss_bytes"], 0);
}

std::uint32_t trianglesOfStl(const std::string& stl) {
  std::uint32_t triangles = 0;
  if (stl.size() >= 84) std::memcpy(&triangles, stl.data() + 80, sizeof triangles);
  EXPECT_EQ(stl.size(), 84 + 50 * std::size_t{triangles});
  return triangles;
}

TEST_F(CliTest, TheUnitOfAnInputIsThatOfAllThatComesOfIt) {
  writeBytes(path("xyz.raw"), makeRawVolume());
  const auto reading = [&](Words words, const Words& place) {
    for (const char* word : {"--raw-dims", "8,9,10", "--raw-type", "f32"}) words.emplace_back(word);
    words.insert(words.end(), place.begin(), place.end());
    return words;
  };
  for (const Words& place : {Words{"--spacing", "0.65,0.65,2um"},
                             {"--spacing", "0.65,0.65,2", "--input-unit", "um"},
                             {"--spacing", "650,650,2000nm", "--input-unit", "um"}}) {
    runWell(reading({"build", "xyz.raw", "-o", "xyz.isb", "--force"}, place));
    for (const Json& info :
         {runForJson({"info", "xyz.isb"}),
          runForJson(reading({"info", "xyz.raw", "--cache-folder", "c"}, place)),
          runForJson(reading({"convert", "xyz.raw", "-o", "xyz.nrrd", "--force"}, place))}) {
      EXPECT_EQ(info["length_unit"], "millimetres");
      EXPECT_NEAR(info["spacing"][0].get<double>(), 0.00065, 1e-15);
      EXPECT_NEAR(info["spacing"][2].get<double>(), 0.002, 1e-15);
    }
    runWell({"extract", "xyz.isb", "--iso", "9.5", "-o", "a.ply", "--force"});
    runWell(reading({"extract", "xyz.raw", "--iso", "9.5", "-o", "b.ply", "--force"}, place));
    EXPECT_EQ(readBytes(path("a.ply")), readBytes(path("b.ply")));
    EXPECT_NE(readBytes(path("a.ply")).find("millimetres"), std::string::npos);
    // A print has a unit, and nothing has to be assumed for it.
    EXPECT_EQ(run({"extract", "xyz.isb", "--iso", "9.5", "-o", "a.3mf", "--force"}).err, "");
  }
  expectFailure(2, reading({"build", "xyz.raw"}, {"--input-unit", "parsec"}),
                "'parsec' is not a unit of length");
  expectFailure(2, {"extract", "xyz.isb", "--iso", "9.5", "--input-unit", "um"},
                "says how to read a volume");
}

TEST_F(CliTest, TheFormatsAreInTheDocuments) {
  const std::string page = readBytes(goldenFolder() + "/../../docs/FORMATS.md");
  const Json formats = runForJson({"formats"});
  for (const Json& format : formats["read"]) {
    const std::string name = format["name"];
    EXPECT_NE(page.find(name.substr(0, name.find_first_of(" ,-"))), std::string::npos) << name;
    std::istringstream endings(format["endings"].get<std::string>());
    for (std::string ending; endings >> ending;) {
      if (ending.front() != '.') continue;
      EXPECT_NE(page.find(ending.substr(0, ending.find(','))), std::string::npos) << ending;
    }
  }
}

TEST_F(CliTest, ADistanceIsSaidInItsUnit) {
  runWell({"phantom", "sphere", "--voxels", "16", "-o", "unknown.nrrd"});
  std::string header = readBytes(path("unknown.nrrd"));
  header.replace(header.find("\"\" \"\" \"\""), 8, "\"mm\" \"mm\" \"mm\"");
  writeBytes(path("known.nrrd"), header);
  const auto told = [&](const char* volume, const char* distance) {
    return runWell(
        {"extract", volume, "--iso", "0", "--simplify", distance, "--cache-folder", "."});
  };
  EXPECT_NE(told("known.nrrd", "0.3mm").find("within 0.3 mm of"), std::string::npos);
  EXPECT_NE(told("known.nrrd", "0.3").find("within 0.3 voxels of"), std::string::npos);
  EXPECT_NE(told("unknown.nrrd", "0.3").find("within 0.3 voxels of the finest"), std::string::npos);
  expectFailure(
      1, {"extract", "unknown.nrrd", "--iso", "0", "--simplify", "0.3mm", "--cache-folder", "."},
      "the unit of 'unknown.nrrd' is unknown");
  // The promise is about the surface of the same query.
  const std::string coarse = runWell({"extract", "known.nrrd", "--iso", "0", "--simplify", "0.3",
                                      "--level", "1", "--cache-folder", "."});
  EXPECT_NE(coarse.find("voxels of this surface without --simplify"), std::string::npos) << coarse;
}

// Voxels of 0.1 at the coordinates of a map.
TEST_F(CliTest, AMeshFarFromTheOriginIsMovedOrSaysItsLoss) {
  runWell({"phantom", "sphere", "--voxels", "20", "-o", "here.nrrd"});
  runWell({"build", "here.nrrd", "-o", "far.isb", "--spacing", "0.1,0.1,0.1", "--origin",
           "499999.3,4200001.7,12.4"});
  const auto extracted = [&](const Words& more) {
    Words words = {"extract", "far.isb", "--iso", "0", "--force", "-o"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return outcome;
  };
  const Outcome far = extracted({"far.stl"});
  EXPECT_NE(far.err.find("single precision moves vertices by up to 2."), std::string::npos)
      << far.err;
  EXPECT_NE(far.err.find("--shift auto"), std::string::npos) << far.err;
  EXPECT_EQ(extracted({"far.ply"}).err, "");
  const Outcome near = extracted({"near.stl", "--shift", "auto"});
  EXPECT_EQ(near.err, "");
  EXPECT_NE(near.out.find("shifted by -500000,-4200003,-13"), std::string::npos) << near.out;
  for (const char* name : {"near.ply", "near.obj", "near.vtp", "near.stl"}) {
    extracted({name, "--shift", "-500000,-4200000,0"});
    EXPECT_NE(readBytes(path(name)).find("-500000 -4200000 0"), std::string::npos) << name;
  }
  extracted({"near.glb", "--shift", "-500000,-4200000,0"});
  EXPECT_NE(readBytes(path("near.glb")).find("\"shift\":[-5e+05,-4200000,0]"), std::string::npos);
  for (const glm::dvec3& at : test::readPly(path("near.ply")).positions) {
    EXPECT_LT(std::abs(at.x), 3);
    EXPECT_LT(std::abs(at.y - 2.65), 3);
  }
}

TEST_F(CliTest, FromPhantomToPicture) {
  const std::string made =
      runWell({"phantom", "head", "--voxels", "64", "--type", "i16", "-o", "head.nrrd"});
  EXPECT_NE(made.find("--iso 1324"), std::string::npos) << made;
  const Json built = runForJson({"build", "head.nrrd", "--brick", "16", "--threads", "2"});
  expectBuildOfHead(built, fs::file_size(path("head.isb")));
  expectInfoOfHead(runForJson({"info", "head.isb"}));
  EXPECT_NE(runWell({"info", "head.isb"}).find("64 x 64 x 64"), std::string::npos);
  EXPECT_NE(runWell({"verify", "head.isb"}).find("whole"), std::string::npos);

  const Words query = {
      "extract", "head.isb",           "--iso", "1324",     "--focus", "32,10,32", "--radius",
      "8",       "--curvature-radius", "4",     "--memory", "1M"};
  const auto with = [&](Words more) {
    more.insert(more.begin(), query.begin(), query.end());
    return more;
  };
  const Json mesh = runForJson(with({"-o", "bone.ply", "--repeat", "2", "--threads", "2"}));
  expectMeshOfHead(mesh, test::readPly(path("bone.ply")));

  // Counted only, and as STL: the same mesh.
  const Json counted = runForJson(with({}));
  EXPECT_EQ(counted["triangles"], mesh["triangles"]);
  EXPECT_EQ(counted["vertices"], mesh["vertices"]);
  EXPECT_TRUE(counted["output"].is_null());
  EXPECT_EQ(runForJson(with({"-o", "bone.stl"}))["triangles"], mesh["triangles"]);
  EXPECT_EQ(mesh["triangles"], trianglesOfStl(readBytes(path("bone.stl"))));

  // Fewer triangles: by a distance, and by their number.
  const Json near = runForJson({"extract", "head.isb", "--iso", "1324", "--simplify", "0.5"});
  const Json few = runForJson({"extract", "head.isb", "--iso", "1324", "--triangles", "12000"});
  EXPECT_EQ(near["simplify"], 0.5);
  EXPECT_LE(few["triangles"], 12000);
  EXPECT_GT(few["simplify"], 0);
  const Json again = runForJson({"extract", "head.isb", "--iso", "1324", "--simplify",
                                 few["simplify"].dump(), "-o", "few.ply"});
  EXPECT_EQ(again["triangles"], few["triangles"]);
  EXPECT_EQ(run({"extract", "head.isb", "--iso", "1324", "--triangles", "9"}).status, 1);
  fs::remove(path("few.ply"));

  runWell({"render", "head.isb", "--iso", "1324", "--focus", "32,10,32", "--radius", "8",
           "--show-focus", "--color-by-level", "--wireframe", "--size", "96x64", "-o", "bone.png"});
  EXPECT_EQ(readBytes(path("bone.png")).substr(1, 3), "PNG");
  std::set<std::string> pictures;
  for (const char* note : {"--wireframe", "--scale-bar", "--axes", "--legend"}) {
    runWell({"render", "head.isb", "--iso", "500", "--level", "2", "--size", "90x90",
             "--color-by-level", note, "-o", "note.png", "--force"});
    EXPECT_TRUE(pictures.insert(readBytes(path("note.png"))).second) << note;
  }
  runWell({"render", "head.isb", "--iso", "500", "--level", "2", "--size", "64x64", "--background",
           "0,0,0", "-o", "skin.exr"});
  EXPECT_EQ(readBytes(path("skin.exr")).substr(0, 4), "\x76\x2f\x31\x01");

  EXPECT_EQ(files(), (std::set<std::string>{"bone.png", "bone.ply", "bone.stl", "head.isb",
                                            "head.nrrd", "note.png", "skin.exr"}));
}

TEST_F(CliTest, TheSameBytesWithAnyNumberOfThreads) {
  runWell({"phantom", "torus", "--voxels", "48", "-o", "torus.mhd"});
  runWell({"build", "torus.mhd", "--brick", "16", "--threads", "1", "-o", "one.isb"});
  runWell({"build", "torus.mhd", "--brick", "16", "--threads", "3", "-o", "three.isb"});
  EXPECT_EQ(readBytes(path("one.isb")), readBytes(path("three.isb")));
  const Words query = {"--iso", "0", "--focus", "24,38,24", "--radius", "4"};
  for (const char* threads : {"1", "3"}) {
    Words words = {"extract", "one.isb", "-o", std::string(threads) + ".ply", "--threads", threads};
    words.insert(words.end(), query.begin(), query.end());
    runWell(words);
  }
  EXPECT_EQ(readBytes(path("1.ply")), readBytes(path("3.ply")));
}

TEST_F(CliTest, WorldUnitsAreTheSameQuery) {
  writeBytes(path("ramp.raw"), makeRawVolume());
  Words words = buildRaw("ramp.raw");
  words.insert(words.end(), {"--spacing", "2,2,4", "--brick", "4", "--tile", "2"});
  runWell(words);
  EXPECT_EQ(runForJson({"info", "ramp.isb"})["spacing"], Json({2.0, 2.0, 4.0}));
  const auto extract = [&](Words more) {
    more.insert(more.begin(), {"extract", "ramp.isb", "--iso", "9.5"});
    Json json = runForJson(more);
    return Json{json["triangles"], json["levels"]};
  };
  const Json in_voxels = extract({"--focus", "1,2,3", "--radius", "0.5", "--box", "0,0,0,4,4,9"});
  EXPECT_EQ(in_voxels,
            extract({"--world", "--focus", "2,4,12", "--radius", "1", "--box", "0,0,0,8,8,36"}));
  EXPECT_LT(in_voxels[0], extract({})[0]);
}

TEST_F(CliTest, PathsNeedNotBeAscii) {
  runWell({"phantom", "sphere", "--voxels", "16", "-o",
           "Sch\xc3\xa4"
           "del \xe9\xa0\xad.nrrd"});
  EXPECT_EQ(runForJson({"build",
                        "Sch\xc3\xa4"
                        "del \xe9\xa0\xad.nrrd"})["output"],
            "Sch\xc3\xa4"
            "del \xe9\xa0\xad.isb");
  // Not even UTF-8; the JSON is.
  runForJson({"build",
              "Sch\xc3\xa4"
              "del \xe9\xa0\xad.nrrd",
              "-o", "\xff.isb"});
  EXPECT_TRUE(fs::exists(path("\xff.isb")));
}

TEST_F(CliTest, ABoxOutsideOfTheVolumeIsRefused) {
  makeSphere();
  for (const char* box : {"31,0,0,1e300,9,9", "-1e300,0,0,0,9,9", "100,0,0,101,9,9"})
    expectFailure(1, {"extract", "sphere.isb", "--iso", "0", "--box", box}, "0,0,0 to 31,31,31");
  EXPECT_EQ(runForJson({"extract", "sphere.isb", "--iso", "0", "--box",
                        "-1,-1,-1,1e300,99,99"})["triangles"],
            runForJson({"extract", "sphere.isb", "--iso", "0"})["triangles"]);
}

TEST_F(CliTest, AnIsovalueOutsideTheValuesGivesAnEmptyMeshAndAWarning) {
  makeSphere();
  for (const char* isovalue : {"1e6", "-1e6"}) {
    const Outcome outcome =
        run({"extract", "sphere.isb", "--iso", isovalue, "-o", "empty.ply", "--force", "--json"});
    EXPECT_EQ(outcome.status, 0);
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find("the mesh is empty"), std::string::npos) << outcome.err;
    EXPECT_EQ(Json::parse(outcome.out)["triangles"], 0);
    EXPECT_EQ(test::readPly(path("empty.ply")).triangles.size(), 0u);
  }
}

TEST_F(CliTest, AnIsovalueIsSuggestedAndTaken) {
  runWell({"phantom", "head", "--voxels", "48", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "-o", "head.isb"});
  const Json isovalues = runForJson({"info", "head.isb"})["isovalues"];
  ASSERT_FALSE(isovalues.empty());
  const double first = isovalues[0]["value"];
  // Which one it took is said beside what the command prints.
  const std::string says = "isobrick: isovalue ";
  const Outcome mesh = run({"extract", "head.isb", "--iso", "auto", "--json"});
  EXPECT_EQ(mesh.status, 0);
  EXPECT_EQ(Json::parse(mesh.out)["isovalue"], first);
  const Outcome picture =
      run({"render", "head.isb", "--iso", "auto", "--size", "64x64", "-o", "head.png"});
  EXPECT_EQ(picture.status, 0);
  for (const Outcome& outcome : {mesh, picture}) {
    ASSERT_EQ(outcome.err.rfind(says, 0), 0u) << outcome.err;
    EXPECT_EQ(std::stod(outcome.err.substr(says.size())), first);
  }
}

TEST_F(CliTest, WithoutAMapComesTheSame) {
  makeSphere();
  for (const Words& more : {Words{}, Words{"--focus", "5,5,5", "--radius", "3"}}) {
    Words words = {"extract", "sphere.isb", "--iso",      "0.5",    "--memory",
                   "64K",     "-o",         "mapped.ply", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    runWell(words);
    words[7] = "read.ply";
    words.emplace_back("--no-map");
    runWell(words);
    EXPECT_EQ(readBytes(path("read.ply")), readBytes(path("mapped.ply")));
  }
  EXPECT_EQ(runWell({"info", "sphere.isb", "--no-map"}), runWell({"info", "sphere.isb"}));
  runWell({"verify", "sphere.isb", "--no-map"});
}

TEST_F(CliTest, SeveralProcessesReadOneFileAtOnce) {
  makeSphere();
  const auto wordsOf = [](const std::string& mesh) {
    return Words{"extract", "sphere.isb", "--iso", "0.5", "--memory", "1", "-o", mesh};
  };
  runWell(wordsOf("alone.ply"));
  const std::string alone = readBytes(path("alone.ply"));
  std::vector<pid_t> processes;
  for (int n = 0; n < 6; ++n) {
    Words words = wordsOf(std::to_string(n) + ".ply");
    words.insert(words.begin(), isobrickCommand());
    if (n % 2 == 1) words.emplace_back("--no-map");
    processes.push_back(start(std::move(words)));
  }
  for (const pid_t process : processes) EXPECT_EQ(wait(process).status, 0);
  for (int n = 0; n < 6; ++n) EXPECT_EQ(readBytes(path(std::to_string(n) + ".ply")), alone) << n;
}

TEST_F(CliTest, HelpAndVersion) {
  const std::string help = runWell({"--help"});
  for (const char* name : {"build", "info", "verify", "extract", "render", "phantom"}) {
    EXPECT_NE(help.find(name), std::string::npos) << name;
    EXPECT_NE(runWell({name, "--help"}).find("--help"), std::string::npos);
  }
  EXPECT_NE(help.find("Examples"), std::string::npos);
  EXPECT_EQ(runWell({"--version"}).rfind("isobrick ", 0), 0u);
}

// Each choice by itself, and joined; the world is the voxels' here.
TEST_F(CliTest, ChoicesCombine) {
  runWell({"phantom", "head", "--voxels", "48", "--type", "i16", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "--brick", "16"});
  const auto triangles = [this](Words more) {
    more.insert(more.begin(), {"extract", "head.isb", "--iso", "1324"});
    return runForJson(more)["triangles"].get<std::int64_t>();
  };
  const std::int64_t all = triangles({});
  const std::int64_t seen = triangles({"--eye", "24,-40,24", "--pixels", "40"});
  EXPECT_LT(seen, all);
  const std::int64_t in_field = triangles(
      {"--eye", "24,-40,24", "--pixels", "40", "--look-at", "24,24,30", "--field-of-view", "10"});
  EXPECT_LT(in_field, seen);
  EXPECT_GT(in_field, 0);
  const std::int64_t focused = triangles({"--focus", "24,10,24", "--radius", "5"});
  const std::int64_t both =
      triangles({"--focus", "24,10,24", "--radius", "5", "--or-finer", "focus=24,38,24 radius=5"});
  EXPECT_GT(both, focused);
  EXPECT_EQ(both, triangles({"--or-finer", "focus=24,38,24 radius=5", "--focus", "24,10,24",
                             "--radius", "5", "--or-finer", "level=4", "--or-finer", "level=5"}));
  EXPECT_EQ(triangles({"--level", "2", "--or-finer", "level=0"}), all);
  // The picture is taken from the eye; one that looks away shows the background alone.
  const auto picture = [this](const std::string& look_at) {
    runWell({"render", "head.isb", "--iso", "1324", "--eye", "24,-40,24", "--look-at", look_at,
             "--field-of-view", "60", "--pixels", "4", "--size", "48x48", "-o", "seen.png",
             "--force"});
    return readBytes(path("seen.png"));
  };
  const std::string away = picture("24,-80,24");
  EXPECT_NE(picture("24,24,24"), away);
  EXPECT_EQ(picture("24,-90,24"), away);
}

TEST_F(CliTest, WrongUsageExitsWithTwo) {
  makeSphere();
  writeBytes(path("ramp.raw"), makeRawVolume());
  const std::vector<std::pair<Words, std::string>> cases = {
      {{"explode"}, "explode"},
      {{"--loud"}, "--loud"},
      {{"build"}, "INPUT"},
      {{"build", "ramp.raw"}, "--raw-dims"},
      {{"build", "ramp.raw", "--raw-dims", "8,9,10"}, "--raw-type"},
      {{"build", "ramp.raw", "--raw-type", "f32"}, "--raw-dims"},
      {{"build", "ramp.raw", "--raw-dims", "8,9", "--raw-type", "f32"}, "8,9"},
      {{"build", "ramp.raw", "--raw-dims", "8,9,10x", "--raw-type", "f32"}, "8,9,10x"},
      {{"build", "ramp.raw", "--raw-dims", "8,9,10", "--raw-type", "f33"}, "f33"},
      {{"build", "ramp.raw", "--raw-dims", "8,9,10", "--raw-type", "f32", "--raw-offset", "-1"},
       "-1"},
      {{"build", "sphere.nrrd", "--brick", "48"}, "power of two"},
      {{"build", "sphere.nrrd", "--brick", "4", "--tile", "8"}, "--tile"},
      {{"build", "sphere.nrrd", "--nan-as", "nan"}, "nan"},
      {{"build", "sphere.nrrd", "--threads", "0"}, "--threads"},
      {{"build", "sphere.nrrd", "--threads", "12x"}, "12x"},
      {{"build", "sphere.nrrd", "--filter", "median"}, "median"},
      {{"build", "sphere.nrrd", "--curvature-epsilon", "-1"}, "-1"},
      {{"info"}, "FILE"},
      {{"extract", "sphere.isb"}, "--iso"},
      {{"extract", "--iso", "0"}, "FILE"},
      {{"extract", "sphere.isb", "--iso", "12x"}, "12x"},
      {{"extract", "sphere.isb", "--iso", ""}, "''"},
      {{"extract", "sphere.isb", "--iso", "nan"}, "nan"},
      {{"extract", "sphere.isb", "--iso", "inf"}, "inf"},
      {{"extract", "sphere.isb", "--iso", "1e300"}, "1e300"},
      {{"extract", "sphere.isb", "--iso"}, "--iso"},
      {{"render", "sphere.isb", "--iso", "0,1", "--opacity", "1", "-o", "a.png"}, "--opacity"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2,3"}, "--radius"},
      {{"extract", "sphere.isb", "--iso", "0", "--radius", "3"}, "--focus"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2", "--radius", "3"}, "1,2"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2,3,4", "--radius", "3"}, "1,2,3,4"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2,nan", "--radius", "3"}, "nan"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2,3", "--radius", "-3"}, "-3"},
      {{"extract", "sphere.isb", "--iso", "0", "--focus", "1,2,3", "--radius", "3", "--level", "1"},
       "--level"},
      {{"extract", "sphere.isb", "--iso", "0", "--curvature", "1", "--curvature-radius", "2"},
       "--curvature"},
      {{"extract", "sphere.isb", "--iso", "0", "--curvature-radius", "0"}, "above 0"},
      {{"extract", "sphere.isb", "--iso", "0", "--simplify", "0"}, "above 0"},
      {{"extract", "sphere.isb", "--iso", "0", "--simplify", "1", "--triangles", "9"},
       "--triangles"},
      {{"extract", "sphere.isb", "--iso", "0", "--triangles", "0"}, "'0'"},
      {{"extract", "sphere.isb", "--iso", "0", "--pixels", "2"}, "--eye"},
      {{"extract", "sphere.isb", "--iso", "0", "--eye", "1,2,3", "--pixels", "0"}, "above 0"},
      {{"extract", "sphere.isb", "--iso", "0", "--eye", "1,2,3", "--field-of-view", "30"},
       "--look-at"},
      {{"extract", "sphere.isb", "--iso", "0", "--or-finer", "focus=1,2,3"}, "--radius"},
      {{"extract", "sphere.isb", "--iso", "0", "--or-finer", "level"}, "NAME=VALUE"},
      {{"extract", "sphere.isb", "--iso", "0", "--or-finer", "iso=3"}, "--iso"},
      {{"extract", "sphere.isb", "--iso", "0", "--level", "1.5"}, "1.5"},
      {{"extract", "sphere.isb", "--iso", "0", "--level", "-1"}, "-1"},
      {{"extract", "sphere.isb", "--iso", "0", "--box", "0,0,0,1,1"}, "0,0,0,1,1"},
      {{"extract", "sphere.isb", "--iso", "0", "--box", "0,0,0,1,0,1"}, "below"},
      {{"extract", "sphere.isb", "--iso", "0", "--memory", "many"}, "many"},
      {{"extract", "sphere.isb", "--iso", "0", "--memory", "0"}, "'0'"},
      {{"extract", "sphere.isb", "--iso", "0", "--memory", "1.5"}, "1.5"},
      {{"extract", "sphere.isb", "--iso", "0", "--memory", "-1G"}, "-1G"},
      {{"extract", "sphere.isb", "--iso", "0", "--repeat", "0"}, "--repeat"},
      {{"extract", "sphere.isb", "--iso", "0", "--codec", "lz4"}, "--codec"},
      {{"render", "sphere.isb", "--iso", "0"}, "--output"},
      {{"render", "sphere.isb", "--iso", "0", "-o", "a.png", "--size", "12"}, "12"},
      {{"render", "sphere.isb", "--iso", "0", "-o", "a.png", "--size", "0x12"}, "0x12"},
      {{"render", "sphere.isb", "--iso", "0", "-o", "a.png", "--color", "2,0,0"}, "2,0,0"},
      {{"render", "sphere.isb", "--iso", "0", "-o", "a.png", "--show-focus"}, "--focus"},
      {{"phantom", "apple", "--voxels", "16", "-o", "a.nrrd"}, "apple"},
      {{"phantom", "sphere", "--voxels", "1", "-o", "a.nrrd"}, "'1'"},
      {{"phantom", "sphere", "-o", "a.nrrd"}, "--voxels"},
      {{"phantom", "sphere", "--voxels", "16"}, "--output"},
  };
  const std::set<std::string> before = files();
  for (const auto& [words, message] : cases) {
    const Outcome outcome = run(words);
    checkFailure(outcome, 2, message, words);
    EXPECT_NE(outcome.err.find("--help"), std::string::npos) << outcome.err;
  }
  EXPECT_EQ(files(), before);
}

TEST_F(CliTest, InputThatCannotBeRead) {
  writeBytes(path("ramp.raw"), makeRawVolume());
  writeBytes(path("short.raw"), makeRawVolume().substr(1));
  writeBytes(path("flat.raw"), makeRawVolume());
  writeBytes(path("notes.txt"), "not a volume\nat all\n");
  writeBytes(path("zeros.nrrd"), std::string(5000, '\0'));
  writeBytes(path("empty.mhd"), "");
  writeBytes(path("scan.vti"), "<VTKFile>");
  writeBytes(path("scan.vdb"), " BDV");
  fs::create_directory(path("folder"));
  runWell({"phantom", "sphere", "--voxels", "16", "-o", "whole.nrrd"});
  const std::string whole = readBytes(path("whole.nrrd"));
  writeBytes(path("cut.nrrd"), whole.substr(0, whole.size() - 1000));
  writeBytes(path("cut_header.nrrd"), whole.substr(0, 40));

  expectFailure(1, {"build", "missing.nrrd"}, "missing.nrrd");
  expectFailure(1, buildRaw("missing.raw"), "missing.raw");
  expectFailure(1, {"build", "missing.raw"}, "missing.raw");
  expectFailure(1, {"build", "missing\nlines.nrrd"}, "missing lines.nrrd");
  expectFailure(1, {"build", "notes.txt"}, "notes.txt");
  expectFailure(1, {"build", "zeros.nrrd"}, "zeros.nrrd");
  expectFailure(1, {"build", "empty.mhd"}, "empty.mhd");
  expectFailure(1, {"build", "scan.vti"}, ".nrrd");
  expectFailure(1, {"build", "scan.vdb"}, "scan.vdb");
  expectFailure(1, {"build", "folder"}, "folder");
  expectFailure(1, {"build", "cut.nrrd"}, "cut.nrrd");
  expectFailure(1, {"build", "cut_header.nrrd"}, "cut_header.nrrd");
  expectFailure(1, buildRaw("short.raw"), "2879 bytes");
  expectFailure(1, buildRaw("ramp.raw", "8,9,11"), "--raw-dims");
  expectFailure(1, buildRaw("ramp.raw", "8,9,9"), "--raw-dims");
  expectFailure(1, buildRaw("ramp.raw", "1,72,10"), "ramp.raw");
  expectFailure(1, buildRaw("ramp.raw", "0,9,10"), "ramp.raw");
  expectFailure(1, buildRaw("ramp.raw", "-8,-9,10"), "ramp.raw");
  expectFailure(1, buildRaw("ramp.raw", "1000000,1000000,1000000"), "ramp.raw");
  expectFailure(1, buildRaw("ramp.raw", "9223372036854775807,2,2"), "ramp.raw");
  expectFailure(1, buildRaw("folder"), "folder");
}

TEST_F(CliTest, VoxelsThatAreNotNumbers) {
  std::string bytes = makeRawVolume();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::memcpy(bytes.data() + sizeof(float) * (5 * 72 + 4 * 8 + 3), &nan, sizeof nan);
  writeBytes(path("holes.raw"), bytes);
  expectFailure(1, buildRaw("holes.raw"), "(3,4,5)");

  Words words = buildRaw("holes.raw");
  words.insert(words.end(), {"--nan-as", "-1.5"});
  const Json built = runForJson(words);
  EXPECT_NE(built["notes"].dump().find("1 voxel"), std::string::npos) << built["notes"];
  EXPECT_EQ(runForJson({"info", "holes.isb"})["value_range"], Json({-1.5, 24.0}));
}

TEST_F(CliTest, DamagedPyramids) {
  makeSphere();
  const std::string good = readBytes(path("sphere.isb"));
  std::string flipped = good;
  flipped[4096 + 100] ^= 0x10;  // in the samples of the first brick
  writeBytes(path("flipped.isb"), flipped);
  {
    const Outcome outcome = run({"verify", "flipped.isb"});
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find("level 0"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("(0,0,0)"), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("(0,0,0)"), outcome.err.rfind("(0,0,0)")) << outcome.err;
    EXPECT_EQ(outcome.err.find("flipped.isb"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.out.find("1 of "), std::string::npos) << outcome.out;
  }
  {
    const std::vector<bool> covered = readPlainPyramid(path("sphere.isb")).covered;
    const auto gap = std::find(covered.begin(), covered.end(), false) - covered.begin();
    ASSERT_LT(gap, static_cast<std::ptrdiff_t>(covered.size())) << "no padding";
    std::string padded = good;
    padded[static_cast<std::size_t>(gap)] ^= 0x10;
    writeBytes(path("padded.isb"), padded);
    const Outcome outcome = run({"verify", "padded.isb"});
    EXPECT_EQ(outcome.status, 1);
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
    EXPECT_NE(outcome.err.find("offset " + std::to_string(gap)), std::string::npos) << outcome.err;
  }
  expectFailure(1, {"extract", "flipped.isb", "--iso", "0", "-o", "bad.ply"}, "(0,0,0)");
  expectFailure(1, {"extract", "flipped.isb", "--iso", "0", "--json"}, "(0,0,0)");
  expectFailure(1, {"render", "flipped.isb", "--iso", "0", "-o", "bad.png"}, "(0,0,0)");

  std::string header = good;
  header[40] ^= 0x01;
  writeBytes(path("header.isb"), header);
  writeBytes(path("cut.isb"), good.substr(0, good.size() / 2));
  writeBytes(path("stub.isb"), good.substr(0, 100));
  writeBytes(path("zeros.isb"), std::string(good.size(), '\0'));
  writeBytes(path("empty.isb"), "");
  for (const char* name :
       {"header.isb", "cut.isb", "stub.isb", "zeros.isb", "empty.isb", "missing.isb", "."}) {
    expectFailure(1, {"verify", name}, name);
    const std::string said = fs::is_directory(path(name)) ? "cannot read the folder" : name;
    expectFailure(1, {"info", name}, said);
    expectFailure(1, {"extract", name, "--iso", "0", "-o", "bad.ply"}, said);
    expectFailure(1, {"render", name, "--iso", "0", "-o", "bad.png"}, said);
  }
  expectFailure(1, {"build", "sphere.isb"}, "pyramid already");
}

TEST_F(CliTest, QueriesThatThePyramidCannotAnswer) {
  makeSphere();
  runWell({"build", "sphere.nrrd", "--no-curvature", "-o", "plain.isb"});
  expectFailure(1, {"extract", "sphere.isb", "--iso", "0", "--level", "9"}, "level 9");
  expectFailure(1, {"extract", "plain.isb", "--iso", "0", "--curvature", "1"}, "curvature");
  expectFailure(1, {"extract", "sphere.isb", "--iso", "0", "-o", "mesh.xyz"}, ".ply");
  expectFailure(1, {"render", "sphere.isb", "--iso", "0", "-o", "picture.gif"}, ".png");
  expectFailure(1, {"phantom", "sphere", "--voxels", "16", "-o", "volume.xyz"}, ".nrrd");
}

TEST_F(CliTest, OutputThatCannotBeWritten) {
  makeSphere();
  writeBytes(path("file"), "in the way");
  for (const char* folder : {"nowhere", "file", "/sys"}) {
    const std::string base = std::string(folder) + "/out";
    expectFailure(1, {"build", "sphere.nrrd", "-o", base + ".isb"}, base);
    expectFailure(1, {"extract", "sphere.isb", "--iso", "0", "-o", base + ".ply"}, base);
    expectFailure(1, {"extract", "sphere.isb", "--iso", "0", "-o", base + ".stl"}, base);
    expectFailure(1, {"render", "sphere.isb", "--iso", "0", "-o", base + ".png"}, base);
    expectFailure(1, {"phantom", "sphere", "--voxels", "16", "-o", base + ".nrrd"}, base);
  }
  expectFailure(1, {"build", "sphere.nrrd", "-o", "."}, "'.'");
  expectFailure(1, {"build", "sphere.nrrd", "-o", "/dev/null"}, "/dev/null");
}

TEST_F(CliTest, NoSpaceLeavesNothing) {
  makeSphere();
  const std::set<std::string> before = files();
  const auto runLimited = [&](Words words) {
    // Files of at most 20 blocks of 512 bytes: the same failing write() as on a full disk.
    const Words shell = {"/bin/sh", "-c", "ulimit -f 20; exec \"$@\"", "sh", isobrickCommand()};
    words.insert(words.begin(), shell.begin(), shell.end());
    return wait(start(std::move(words)));
  };
  checkFailure(runLimited({"build", "sphere.nrrd", "-o", "new.isb"}), 1, "new.isb");
  checkFailure(runLimited({"build", "sphere.nrrd", "--rebuild"}), 1, "sphere.isb");
  checkFailure(runLimited({"extract", "sphere.isb", "--iso", "0", "-o", "new.ply"}), 1, "new.ply");
  checkFailure(runLimited({"extract", "sphere.isb", "--iso", "0", "-o", "new.stl"}), 1, "new.stl");
  checkFailure(runLimited({"phantom", "sphere", "--voxels", "32", "-o", "new.mhd"}), 1, "new");
  EXPECT_EQ(files(), before);
  EXPECT_EQ(run({"verify", "sphere.isb"}).status, 0);
  // A failure to print counts too.
  const Outcome full = wait(start(
      {"/bin/sh", "-c", "exec \"$0\" info sphere.isb --json > /dev/full", isobrickCommand()}));
  checkFailure(full, 1, "standard output");
}

TEST_F(CliTest, ABuildThatFailsLeavesTheOldPyramid) {
  makeSphere();
  const std::string old = readBytes(path("sphere.isb"));
  writeBytes(path("bad.nrrd"), readBytes(path("sphere.nrrd")).substr(0, 5000));
  expectFailure(1, {"build", "bad.nrrd", "-o", "sphere.isb", "--force"}, "bad.nrrd");
  EXPECT_EQ(readBytes(path("sphere.isb")), old);
}

TEST_F(CliTest, APipeAsInputIsRefusedAtOnce) {
  ASSERT_EQ(mkfifo(path("pipe.nrrd").c_str(), 0600), 0);
  expectFailure(1, {"build", "pipe.nrrd"}, "neither a file nor a folder");
  expectFailure(1, {"build", "pipe.nrrd", "--raw-dims", "4,4,4", "--raw-type", "u8"},
                "neither a file nor a folder");
  // As what else it may be called, and for every command that opens a file.
  for (const char* name : {"pipe.isb", "pipe.h5", "pipe.vdb", "pipe.mhd", "pipe"})
    ASSERT_EQ(mkfifo(path(name).c_str(), 0600), 0);
  for (const char* name : {"pipe.isb", "/dev/zero", "/dev/null"}) {
    expectFailure(1, {"info", name}, "not a regular file");
    expectFailure(1, {"verify", name}, "not a regular file");
    expectFailure(1, {"extract", name, "--iso", "0"}, "not a regular file");
    expectFailure(1, {"render", name, "--iso", "0", "-o", "a.png"}, "not a regular file");
    expectFailure(1, {"convert", name, "-o", "a.nrrd"}, "neither a file nor a folder");
  }
  for (const char* name : {"pipe.h5:/a", "pipe.vdb", "pipe.mhd", "pipe", "pipe.nrrd"}) {
    const Outcome outcome = run({"convert", name, "-o", "a.isb"});
    checkFailure(outcome, 1, std::string(name).substr(0, 4));
  }
  // A member of a folder, and what a header names.
  fs::create_directory(path("slices"));
  ASSERT_EQ(mkfifo(path("slices/1.tif").c_str(), 0600), 0);
  expectFailure(1, {"build", "slices"}, "1.tif");
  for (const char* encoding : {"raw", "gzip", "text"}) {
    writeBytes(path("named.nrrd"),
               std::string("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\n") +
                   "encoding: " + encoding + "\ndata file: pipe\n\n");
    expectFailure(1, {"build", "named.nrrd"}, "pipe");
  }
  for (const char* compressed : {"True", "False"}) {
    writeBytes(path("named.mhd"), std::string("NDims = 3\nDimSize = 4 4 4\nCompressedData = ") +
                                      compressed +
                                      "\nElementType = MET_UCHAR\nElementDataFile = pipe\n");
    expectFailure(1, {"build", "named.mhd"}, "pipe");
  }
}

TEST_F(CliTest, SpacingAndOriginAreGivenByHand) {
  writeBytes(path("plain.raw"), std::string(6 * 5 * 4, 'a'));
  const Words raw = {"plain.raw", "--raw-dims", "6,5,4", "--raw-type", "u8"};
  const auto with = [](Words words, const Words& more) {
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  const auto build = [&](const Words& more) {
    return runForJson(with({"build"}, with(with(raw, {"-o", "plain.isb"}), more)));
  };
  EXPECT_FALSE(build({"--spacing", "0.5,2,3", "--origin", "-1,2,3.25"})["skipped"].get<bool>());
  Json info = runForJson({"info", "plain.isb"});
  EXPECT_EQ(info["spacing"], Json::array({0.5, 2, 3}));
  EXPECT_EQ(info["origin"], Json::array({-1, 2, 3.25}));
  // They say what was built: another place is another pyramid.
  EXPECT_TRUE(build({"--spacing", "0.5,2,3", "--origin=-1,2,3.25"})["skipped"].get<bool>());
  EXPECT_FALSE(build({"--spacing", "0.5,2,4"})["skipped"].get<bool>());
  EXPECT_EQ(runForJson({"info", "plain.isb"})["spacing"], Json::array({0.5, 2, 4}));

  // For a file with a place of its own, with a note; a level of a pyramid; a phantom.
  runWell({"convert", "plain.isb", "-o", "own.nrrd"});
  const Json converted = runForJson(
      {"convert", "own.nrrd", "-o", "other.nrrd", "--spacing", "1,1,7", "--box", "1,0,0,4,3,2"});
  EXPECT_EQ(converted["spacing"], Json::array({1, 1, 7}));
  EXPECT_EQ(converted["origin"], Json::array({1, 0, 0}));
  EXPECT_NE(converted["notes"].dump().find("the spacing 1,1,7 was given in place of 0.5,2,4"),
            std::string::npos)
      << converted["notes"];
  EXPECT_EQ(runForJson({"convert", "plain.isb", "-o", "coarse.nrrd", "--level", "1", "--spacing",
                        "1,1,7"})["spacing"],
            Json::array({2, 2, 14}));
  runWell({"build", "phantom:sphere:16", "--spacing", "2,2,2", "-o", "sphere.isb"});
  EXPECT_EQ(runForJson({"info", "sphere.isb"})["spacing"], Json::array({2, 2, 2}));

  for (const char* wrong : {"0,1,1", "1,-1,1", "1,1", "nan,1,1"})
    expectFailure(2, {"build", "own.nrrd", "--spacing", wrong}, "--spacing");
  expectFailure(2, {"view", "plain.isb", "--spacing", "1,1,1"}, "--spacing");
  expectFailure(1, {"build", "own.nrrd", "--select", "series=1"}, "no folder of DICOM series");
}

TEST_F(CliTest, NoMessageShowsTheValueOfAVariable) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"info", "a.isb", "env:SECRET"},
        {"env:SECRET"},
        {"extract", "--threads", "env:SECRET"},
        {"info", "env:PLACE", "env:SECRET"}}) {
    std::vector<std::string> all{"/usr/bin/env", "PLACE=https", "SECRET=https://a/?key=9",
                                 isobrickCommand()};
    all.insert(all.end(), words.begin(), words.end());
    const Outcome outcome = wait(start(all));
    EXPECT_EQ(outcome.status, 2);
    EXPECT_EQ(outcome.err.find("key=9"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("env:SECRET"), std::string::npos) << outcome.err;
  }
}

TEST_F(CliTest, AMeshNeverReplacesItsPyramidNorWritesThroughALink) {
  runWell({"phantom", "sphere", "--voxels", "16", "-o", "sphere.nrrd"});
  runWell({"build", "sphere.nrrd", "-o", "sphere.ply"});
  expectFailure(1, {"extract", "sphere.ply", "--iso", "0", "-o", "sphere.ply"}, "is the input");
  // The faces of a PLY wait in a second file, under a name that nobody else has.
  writeBytes(path("victim"), "precious");
  fs::create_symlink(path("victim"), path("mesh.ply.faces.partial"));
  runWell({"extract", "sphere.ply", "--iso", "0", "-o", "mesh.ply"});
  EXPECT_EQ(readBytes(path("victim")), "precious");
}

}  // namespace
}  // namespace isobrick
