// `isobrick extract -o NAME.precomputed`: read back as Neuroglancer's specification of
// multi-resolution meshes says, and held against the meshes of the levels.
#include <draco/compression/decode.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "tests/support/command_test.h"
#include "tests/support/ply_reader.h"

namespace isobrick::test {
namespace {

constexpr std::int64_t kMost = 65535;  // of a coordinate within a fragment

// On the lattice of a level: a fragment's edge is kMost long.
using Place = std::array<std::int64_t, 3>;
using Triangle = std::array<Place, 3>;

// The least corner first; the sense of rotation stays.
Triangle fromLeast(Triangle triangle) {
  std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()), triangle.end());
  return triangle;
}

struct Node {
  Place at;
  std::uint32_t bytes = 0;
};

struct Segment {
  float edge = 0;  // voxels of a finest fragment
  std::vector<float> scales;
  std::vector<std::vector<Node>> levels;
  std::vector<std::vector<Triangle>> triangles;
};

class Bytes {
 public:
  explicit Bytes(std::string bytes) : bytes_(std::move(bytes)) {}
  template <typename T>
  T take() {
    T value{};
    EXPECT_LE(at_ + sizeof value, bytes_.size());
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::string takeText(std::size_t count) {
    EXPECT_LE(at_ + count, bytes_.size());
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  bool isAtEnd() const { return at_ == bytes_.size(); }

 private:
  std::string bytes_;
  std::size_t at_ = 0;
};

void readFragment(const std::string& packed, const Node& node, bool is_finest,
                  std::vector<Triangle>& out) {
  draco::DecoderBuffer buffer;
  buffer.Init(packed.data(), packed.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  ASSERT_TRUE(decoded.ok()) << decoded.status().error_msg_string();
  const draco::Mesh& mesh = *decoded.value();
  const auto* const positions = mesh.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  ASSERT_NE(positions, nullptr);
  // As Neuroglancer wants it.
  ASSERT_EQ(positions->data_type(), draco::DT_INT32);
  ASSERT_EQ(positions->num_components(), 3);
  ASSERT_EQ(positions->size(), mesh.num_points());
  for (std::uint32_t f = 0; f < mesh.num_faces(); ++f) {
    Triangle triangle;
    std::array<bool, 3> is_low{true, true, true}, is_high{true, true, true};
    for (std::size_t c = 0; c < 3; ++c) {
      std::array<std::int32_t, 3> place{};
      positions->GetMappedValue(mesh.face(draco::FaceIndex(f))[c], place.data());
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_TRUE(place[axis] >= 0 && place[axis] <= kMost);
        is_low[axis] = is_low[axis] && place[axis] <= 1 << 15;
        is_high[axis] = is_high[axis] && place[axis] >= 1 << 15;
        triangle[c][axis] = node.at[axis] * kMost + place[axis];
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_TRUE(is_finest || is_low[axis] || is_high[axis]) << "crosses the middle";
    out.push_back(fromLeast(triangle));
  }
}

Segment readSegment(const std::string& folder, int number) {
  Segment segment;
  const std::string name = folder + "/" + std::to_string(number);
  Bytes index(readBytes(name + ".index")), data(readBytes(name));
  segment.edge = index.take<float>();
  EXPECT_EQ(index.take<float>(), segment.edge);
  EXPECT_EQ(index.take<float>(), segment.edge);
  for (int axis = 0; axis < 3; ++axis) EXPECT_EQ(index.take<float>(), 0);
  const auto levels = index.take<std::uint32_t>();
  for (std::uint32_t l = 0; l < levels; ++l) segment.scales.push_back(index.take<float>());
  for (std::uint32_t i = 0; i < 3 * levels; ++i) EXPECT_EQ(index.take<float>(), 0);
  for (std::uint32_t l = 0; l < levels; ++l)
    segment.levels.emplace_back(index.take<std::uint32_t>());
  for (std::vector<Node>& nodes : segment.levels) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (Node& node : nodes) node.at[axis] = index.take<std::uint32_t>();
    for (Node& node : nodes) node.bytes = index.take<std::uint32_t>();
  }
  EXPECT_TRUE(index.isAtEnd());
  for (std::size_t l = 0; l < levels; ++l) {
    segment.triangles.emplace_back();
    for (const Node& node : segment.levels[l])
      if (node.bytes > 0)
        readFragment(data.takeText(node.bytes), node, l == 0, segment.triangles.back());
    std::sort(segment.triangles.back().begin(), segment.triangles.back().end());
  }
  EXPECT_TRUE(data.isAtEnd());
  return segment;
}

// Neuroglancer's order: the highest bit that differs decides, of the same bit z before y before x.
bool isBefore(const Place& a, const Place& b) {
  for (int bit = 20; bit >= 0; --bit)
    for (int axis = 2; axis >= 0; --axis) {
      const std::size_t i = static_cast<std::size_t>(axis);
      const auto x = a[i] >> bit & 1, y = b[i] >> bit & 1;
      if (x != y) return x < y;
    }
  return false;
}

// The mesh of a level, its vertices on the lattice of the fragments.
std::vector<Triangle> onLattice(const PlyMesh& mesh, double edge) {
  std::vector<Triangle> triangles;
  for (std::size_t t = 0; t < mesh.triangles.size(); t += 3) {
    Triangle triangle;
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double place = mesh.positions[mesh.triangles[t + c]][static_cast<int>(axis)] / edge;
        const double whole = std::floor(place);
        triangle[c][axis] = static_cast<std::int64_t>(whole) * kMost +
                            static_cast<std::int64_t>(std::floor((place - whole) * kMost + 0.5));
      }
    triangles.push_back(fromLeast(triangle));
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

class PrecomputedMeshesTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"build", "phantom:head:70", "--brick", "16", "-o", "head.isb"});
  }
  // A run that warns of what the format loses, and of nothing else; its stdout.
  std::string write(const Words& words) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_NE(outcome.err.find("takes millimetres"), std::string::npos) << outcome.err;
    return outcome.out;
  }
};

TEST_F(PrecomputedMeshesTest, FragmentsAreTheMeshesOfAllLevels) {
  const Json json = Json::parse(
      write({"extract", "head.isb", "--iso", "500,1324", "-o", "m.precomputed", "--json"}));
  EXPECT_EQ(json["lost"].size(), 1u);
  EXPECT_TRUE(json["seconds"].contains("extract"));
  ASSERT_EQ(json["segments"].size(), 2u);
  std::size_t most_nodes = 0;
  for (int number = 1; number <= 2; ++number) {
    SCOPED_TRACE(number);
    const Segment segment = readSegment(path("m.precomputed"), number);
    EXPECT_EQ(segment.edge, 16);
    ASSERT_GE(segment.levels.size(), 3u);
    for (std::size_t l = 0; l < segment.levels.size(); ++l) {
      SCOPED_TRACE("level " + std::to_string(l));
      EXPECT_EQ(segment.scales[l], static_cast<float>(1 << l));
      const std::vector<Node>& nodes = segment.levels[l];
      most_nodes = std::max(most_nodes, nodes.size());
      for (std::size_t i = 1; i < nodes.size(); ++i)
        EXPECT_TRUE(isBefore(nodes[i - 1].at, nodes[i].at));
      // A node without a parent would not be drawn.
      for (const Node& child : l > 0 ? segment.levels[l - 1] : std::vector<Node>{})
        EXPECT_TRUE(std::any_of(nodes.begin(), nodes.end(), [&](const Node& parent) {
          return parent.at == Place{child.at[0] / 2, child.at[1] / 2, child.at[2] / 2};
        }));
      runWell({"extract", "head.isb", "--iso", number == 1 ? "500" : "1324", "--level",
               std::to_string(l), "-o", "level.ply", "--force"});
      const std::vector<Triangle> expected =
          onLattice(readPly(path("level.ply")), 16.0 * static_cast<double>(1 << l));
      EXPECT_EQ(segment.triangles[l].size(), expected.size());
      // A vertex that fragments share has one place in all of them: nothing gapes between them.
      EXPECT_TRUE(segment.triangles[l] == expected);
      EXPECT_EQ(json["segments"][static_cast<std::size_t>(number - 1)]["triangles"][l],
                expected.size());
    }
  }
  EXPECT_GT(most_nodes, 50u);
}

TEST_F(PrecomputedMeshesTest, InfoPlacesVoxelsWhereTheVolumeHasThem) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "--spacing", "0.5,0.25,2", "-o", "s.isb"});
  write({"extract", "s.isb", "--iso", "500", "-o", "m.precomputed"});
  const Json info = Json::parse(readBytes(path("m.precomputed/info")));
  EXPECT_EQ(info["@type"], "neuroglancer_multilod_draco");
  EXPECT_EQ(info["vertex_quantization_bits"], 16);
  EXPECT_EQ(info["transform"], Json({5e5, 0., 0., 2.5e5, 0., 2.5e5, 0., 1.25e5, 0., 0., 2e6, 1e6}));
  const Json properties = Json::parse(readBytes(path("m.precomputed/segment_properties/info")));
  EXPECT_EQ(properties["inline"]["ids"], Json({"1"}));
  EXPECT_EQ(properties["inline"]["properties"][0]["values"], Json({"isovalue 500"}));
}

TEST_F(PrecomputedMeshesTest, AnyThreadsWriteTheSameBytes) {
  write({"extract", "head.isb", "--iso", "500", "-o", "a.precomputed", "--threads", "1"});
  write({"extract", "head.isb", "--iso", "500", "-o", "b.precomputed", "--threads", "4", "--memory",
         "1M"});
  for (const char* name : {"1", "1.index", "info"})
    EXPECT_EQ(readBytes(path(std::string("a.precomputed/") + name)),
              readBytes(path(std::string("b.precomputed/") + name)))
        << name;
}

TEST_F(PrecomputedMeshesTest, AnIsovalueWithoutASurfaceGetsNoSegment) {
  const Outcome outcome = run({"extract", "head.isb", "--iso", "1e6,500", "-o", "m.precomputed"});
  EXPECT_EQ(outcome.status, 0);
  EXPECT_NE(outcome.err.find("the mesh is empty"), std::string::npos) << outcome.err;
  EXPECT_TRUE(fs::exists(path("m.precomputed/1")));
  EXPECT_FALSE(fs::exists(path("m.precomputed/2")));
  EXPECT_FALSE(fs::exists(path("m.precomputed/mesh.fragments")));
}

TEST_F(PrecomputedMeshesTest, OptionsThatDoNotFitAreRefused) {
  for (const Words& words :
       {Words{"--focus", "9,9,9", "--radius", "4"}, Words{"--simplify", "1"}, Words{"--level", "1"},
        Words{"--box", "1,1,1,9,9,9"}, Words{"--components"}, Words{"--repeat", "2"},
        Words{"--triangles", "100"}, Words{"--attribute", "head.isb"}}) {
    Words all{"extract", "head.isb", "--iso", "500", "-o", "m.precomputed"};
    all.insert(all.end(), words.begin(), words.end());
    expectFailure(2, all, "does not go with a .precomputed output");
  }
}

TEST_F(PrecomputedMeshesTest, OnlyMeshesAreReplacedAndOnlyByForce) {
  const Words words{"extract", "head.isb", "--iso", "500", "-o", "m.precomputed"};
  Words forced = words;
  forced.push_back("--force");
  write(words);
  expectFailure(1, words, "exists already");
  write(forced);
  for (const char* name :
       {"m.precomputed/letter.txt", "m.precomputed/segment_properties/letter.txt",
        "m.precomputed/7/letter.txt"}) {
    fs::create_directories(fs::path(path(name)).parent_path());
    std::ofstream(path(name)) << "dear";
    expectFailure(1, forced, "something else in it");
    EXPECT_EQ(readBytes(path(name)), "dear");
    fs::remove(path(name));
  }
  fs::remove(path("m.precomputed/7"));
  // Neither an input that lies within, nor a volume for Neuroglancer; nor a pipe for its info.
  fs::copy(path("head.isb"), path("m.precomputed/1"), fs::copy_options::overwrite_existing);
  expectFailure(1, {"extract", "m.precomputed/1", "--iso", "500", "-o", "m.precomputed", "--force"},
                "holds the input");
  fs::create_directory(path("v.precomputed"));
  std::ofstream(path("v.precomputed/info")) << R"({"@type": "neuroglancer_multiscale_volume"})";
  expectFailure(1, {"extract", "head.isb", "--iso", "500", "-o", "v.precomputed", "--force"},
                "something else in it");
  fs::create_directory(path("p.precomputed"));
  ASSERT_EQ(mkfifo(path("p.precomputed/info").c_str(), 0600), 0);
  expectFailure(1, {"extract", "head.isb", "--iso", "500", "-o", "p.precomputed", "--force"},
                "something else in it");
  std::ofstream(path("f.precomputed")) << "dear";
  expectFailure(1, {"extract", "head.isb", "--iso", "500", "-o", "f.precomputed", "--force"},
                "is no folder");
}

// Six times the volume that the triangles enclose: above 0 if they turn left seen from outside.
double signedVolume(const std::vector<Triangle>& triangles) {
  double sum = 0;
  for (const Triangle& t : triangles) {
    const auto at = [&](std::size_t c, std::size_t axis) {
      return static_cast<double>(t[c][axis]);
    };
    sum += at(0, 0) * (at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1)) +
           at(0, 1) * (at(1, 2) * at(2, 0) - at(1, 0) * at(2, 2)) +
           at(0, 2) * (at(1, 0) * at(2, 1) - at(1, 1) * at(2, 0));
  }
  return sum;
}

TEST_F(PrecomputedMeshesTest, AMirroredVolumeIsNotInsideOut) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  std::string file = readBytes(path("head.nrrd"));
  const std::size_t at = file.find("space directions: (1");
  ASSERT_NE(at, std::string::npos);
  file.insert(at + std::string("space directions: (").size(), "-");
  std::ofstream(path("mirrored.nrrd"), std::ios::binary) << file;
  std::vector<std::vector<Triangle>> surfaces;
  for (const char* name : {"head", "mirrored"}) {
    runWell({"build", std::string(name) + ".nrrd", "-o", std::string(name) + "-1.isb"});
    write({"extract", std::string(name) + "-1.isb", "--iso", "500", "-o",
           std::string(name) + ".precomputed"});
    surfaces.push_back(readSegment(path(std::string(name) + ".precomputed"), 1).triangles[0]);
  }
  EXPECT_GT(signedVolume(surfaces[0]), 0);
  EXPECT_NEAR(signedVolume(surfaces[1]) / signedVolume(surfaces[0]), 1, 1e-3);
}

TEST_F(PrecomputedMeshesTest, TheInsideMayBeBelow) {
  write({"extract", "head.isb", "--iso", "500", "--inside", "below", "-o", "b.precomputed"});
  EXPECT_LT(signedVolume(readSegment(path("b.precomputed"), 1).triangles[0]), 0);
}

TEST_F(PrecomputedMeshesTest, LevelsThatHaveLostTheSurfaceAreLeftOut) {
  write({"extract", "head.isb", "--iso", "1324", "-o", "m.precomputed"});
  const Segment segment = readSegment(path("m.precomputed"), 1);
  EXPECT_FALSE(segment.triangles.back().empty());
  EXPECT_LT(segment.levels.size(), 7u);
}

TEST_F(PrecomputedMeshesTest, AnIsovalueIsWrittenOnce) {
  const Json info = runForJson({"info", "head.isb"});
  const std::string first = std::to_string(info["isovalues"][0]["value"].get<double>());
  const Outcome outcome =
      run({"extract", "head.isb", "--iso", "auto," + first, "-o", "m.precomputed"});
  EXPECT_EQ(outcome.status, 2);
  EXPECT_NE(outcome.err.find("given twice"), std::string::npos) << outcome.err;
  EXPECT_FALSE(fs::exists(path("m.precomputed")));
}

}  // namespace
}  // namespace isobrick::test
