// `isobrick extract` of some of a surface's connected pieces.
#include <array>
#include <cstdint>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <map>
#include <numeric>
#include <set>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class ComponentsCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"phantom", "head", "--voxels", "64", "-o", "head.nrrd"});
    runWell({"build", "head.nrrd"});
  }
  Json extracted(const Words& more) {
    Words words = {"extract", "head.isb", "--iso", "900"};
    words.insert(words.end(), more.begin(), more.end());
    return runForJson(words);
  }
};

TEST_F(ComponentsCommandTest, AreListedAndThoseThatAreWantedWritten) {
  const Json whole = extracted({"--components"});
  const Json& list = whole["components"];
  ASSERT_GE(list.size(), 3u);
  std::uint64_t triangles = 0;
  for (const Json& one : list) triangles += one["triangles"].get<std::uint64_t>();
  EXPECT_EQ(whole["triangles"], triangles);
  EXPECT_EQ(whole["components_kept"], list.size());
  EXPECT_TRUE(list[0]["volume"].is_null());  // the neck reaches the border
  EXPECT_TRUE(list[1]["volume"].is_number());

  // The head with its cavities; their walls lie within its box.
  std::size_t kept = 1;
  std::uint64_t kept_triangles = list[0]["triangles"];
  for (const Json& one : list)
    if (!one["volume"].is_null() && one["volume"] < 0) {
      ++kept;
      kept_triangles += one["triangles"].get<std::uint64_t>();
    }
  EXPECT_GT(kept, 1u);
  const Json largest = extracted({"--keep-largest", "1", "-o", "largest.ply"});
  EXPECT_EQ(largest["components"], list);
  EXPECT_EQ(largest["components_kept"], kept);
  EXPECT_EQ(largest["triangles"], kept_triangles);
  EXPECT_EQ(largest["ranked_by"], "volume");
  const double area = list[1]["area"];
  const Json dropped = extracted({"--drop-below", std::to_string(area * 0.999)});
  EXPECT_EQ(dropped["components_kept"], 2u);

  const std::string text = runWell({"extract", "head.isb", "--iso", "900", "--keep-largest", "2"});
  EXPECT_NE(text.find("of them kept, the largest by volume"), std::string::npos) << text;
}

TEST_F(ComponentsCommandTest, AnEmptyChoiceIsSaid) {
  const std::vector<std::pair<Words, const char*>> choices = {
      {{"--drop-below", "1e9"}, "is below --drop-below"},
      {{"--box", "0,0,0,1,1,1"}, "in --box"},
      {{"--level", "6"}, "ask for a finer level"}};
  for (const auto& [more, why] : choices) {
    Words words = {"extract", "head.isb", "--iso", "900", "--json"};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(Json::parse(outcome.out)["triangles"], 0) << more[0];
    EXPECT_NE(outcome.err.find("the mesh is empty"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find(why), std::string::npos) << outcome.err;
  }
}

// The mesh of a .ply as floats, with the numbers of its vertices, and its faces.
struct NumberedMesh {
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> numbers;
  std::vector<std::array<std::uint32_t, 3>> faces;
};

NumberedMesh readNumbered(const std::string& path) {
  const std::string bytes = readBytes(path);
  NumberedMesh mesh;
  const std::size_t end = bytes.find("end_header\n"), vertex = bytes.find("element vertex ");
  const std::size_t face = bytes.find("element face ");
  if (end == std::string::npos || bytes.find("property uint component\n") > end) return mesh;
  mesh.positions.resize(std::stoul(bytes.substr(vertex + 15)));
  mesh.numbers.resize(mesh.positions.size());
  mesh.faces.resize(std::stoul(bytes.substr(face + 13)));
  const char* at = bytes.data() + end + 11;
  for (std::size_t v = 0; v < mesh.positions.size(); ++v, at += 28) {
    std::memcpy(&mesh.positions[v], at, 12);
    std::memcpy(&mesh.numbers[v], at + 24, 4);
  }
  for (auto& corners : mesh.faces) {
    std::memcpy(corners.data(), at + 1, 12);
    at += 14;
  }
  EXPECT_EQ(at, bytes.data() + bytes.size());
  return mesh;
}

TEST_F(ComponentsCommandTest, NumbersAreThoseOfTheMeshsOwnEdges) {
  const Words detail[] = {{}, {"--focus", "40,30,30", "--radius", "10"}, {"--simplify", "0.3"}};
  for (const Words& more : detail) {
    Words words = {"--attribute", "component", "-o", "numbered.ply", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    const Json json = extracted(words);
    EXPECT_EQ(json["attribute"]["name"], "component");
    const Json& list = json["components"];
    const NumberedMesh mesh = readNumbered(path("numbered.ply"));
    ASSERT_EQ(mesh.faces.size(), json["triangles"].get<std::size_t>());
    std::vector<std::uint32_t> parents(mesh.positions.size());
    std::iota(parents.begin(), parents.end(), 0u);
    const auto rootOf = [&](std::uint32_t v) {
      while (parents[v] != v) v = parents[v] = parents[parents[v]];
      return v;
    };
    for (const auto& corners : mesh.faces)
      for (const std::uint32_t corner : corners) parents[rootOf(corner)] = rootOf(corners[0]);
    std::map<std::uint32_t, std::uint32_t> number_of;  // by root
    std::vector<double> areas(list.size(), 0.0);
    std::vector<std::uint64_t> triangles(list.size(), 0);
    for (std::uint32_t v = 0; v < parents.size(); ++v) {
      ASSERT_LT(mesh.numbers[v], list.size());
      ASSERT_EQ(number_of.try_emplace(rootOf(v), mesh.numbers[v]).first->second, mesh.numbers[v]);
    }
    std::set<std::uint32_t> numbers;
    for (const auto& [root, number] : number_of) numbers.insert(number);
    EXPECT_EQ(numbers.size(), number_of.size());  // no two components have one number
    EXPECT_EQ(numbers.size(), list.size());
    for (const auto& corners : mesh.faces) {
      const std::uint32_t number = mesh.numbers[corners[0]];
      const glm::dvec3 a(mesh.positions[corners[0]]);
      areas[number] += glm::length(glm::cross(glm::dvec3(mesh.positions[corners[1]]) - a,
                                              glm::dvec3(mesh.positions[corners[2]]) - a)) /
                       2;
      ++triangles[number];
    }
    for (std::size_t i = 0; i < list.size(); ++i) {
      EXPECT_EQ(triangles[i], list[i]["triangles"].get<std::uint64_t>());
      EXPECT_NEAR(areas[i], list[i]["area"].get<double>(), 1e-4 * areas[i] + 1e-4);
      EXPECT_LE(list[i]["area"].get<double>(), list[i - (i > 0)]["area"].get<double>());
    }
  }
}

TEST_F(ComponentsCommandTest, NumbersAreTheSameBytesForAnyThreadsAndMemory) {
  for (const char* ending : {".ply", ".vtp", ".glb"}) {
    std::string first;
    for (const Words& more : {Words{"--threads", "1"}, Words{"--threads", "4"},
                              Words{"--threads", "3", "--memory", "1M"}}) {
      const std::string name = std::string("numbered") + ending;
      Words words = {"--attribute", "component", "-o", name, "--force"};
      words.insert(words.end(), more.begin(), more.end());
      extracted(words);
      const std::string bytes = readBytes(path(name));
      if (first.empty()) first = bytes;
      EXPECT_TRUE(bytes == first) << name << " " << more.back();
    }
    EXPECT_NE(first.find(ending == std::string(".glb") ? "_COMPONENT" : "component"),
              std::string::npos);
  }
  // Of those that are kept, the numbers of the table.
  const Json kept = extracted({"--attribute", "component", "--keep-largest", "2", "-o", "two.ply"});
  const NumberedMesh two = readNumbered(path("two.ply"));
  const std::set<std::uint32_t> numbers(two.numbers.begin(), two.numbers.end());
  EXPECT_EQ(numbers.size(), kept["components_kept"].get<std::size_t>());
  EXPECT_EQ(*numbers.begin(), 0u);
  const std::string text = runWell({"extract", "head.isb", "--iso", "900", "--components"});
  EXPECT_NE(text.find("number"), std::string::npos) << text;
  EXPECT_NE(text.find("\n       0 "), std::string::npos) << text;
}

// Pictures wait for the pieces: they are the same bytes whatever the threads do meanwhile.
TEST_F(ComponentsCommandTest, PicturesAreColouredByPieces) {
  writeBytes(path("view.json"), R"({"version": 1, "coloring": "component", "surfaces": [
      {"isovalue": 900}], "focus": {"everywhere": true}, "camera": {"pivot": [31.5, 31.5, 31.5],
      "distance": 150}})");
  const auto pictureOf = [&](const Words& more) {
    Words words = {"render", "head.isb", "--size", "96x96", "-o", "picture.png", "--force"};
    words.insert(words.end(), more.begin(), more.end());
    runWell(words);
    return readBytes(path("picture.png"));
  };
  const std::string by_view = pictureOf({"--state", "view.json", "--threads", "1"});
  for (const char* threads : {"2", "4"})
    EXPECT_TRUE(pictureOf({"--state", "view.json", "--threads", threads}) == by_view) << threads;
  const std::string plain = pictureOf({"--iso", "900"});
  const std::string colored = pictureOf({"--iso", "900", "--color-by-component"});
  EXPECT_TRUE(plain != colored);
  EXPECT_TRUE(pictureOf({"--iso", "900", "--color-by-component", "--threads", "1"}) == colored);
  EXPECT_TRUE(pictureOf({"--iso", "900", "--color-by-component", "--legend"}) != colored);
  const Outcome both = run({"render", "head.isb", "--iso", "900", "--color-by-component",
                            "--color-by-level", "-o", "both.png"});
  EXPECT_EQ(both.status, 2) << both.err;
}

TEST_F(ComponentsCommandTest, WrongUseIsRefused) {
  expectFailure(1,
                {"extract", "head.isb", "--iso", "900", "--attribute", "component", "-o", "a.obj"},
                "write .ply, .glb or .vtp");
  expectFailure(2,
                {"extract", "head.isb", "--iso", "900", "--attribute", "component", "-o", "a.isbm",
                 "--part", "1/2"},
                "--part");
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--attribute", "component"}, "--output");

  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--keep-largest", "0"},
                "--keep-largest");
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--drop-below", "-1"}, "--drop-below");
  expectFailure(2, {"extract", "head.isb", "--iso", "900", "--drop-small"}, "--simplify");
}

}  // namespace
}  // namespace isobrick::test
