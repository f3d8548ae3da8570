// A client without a network: its chunks make closed surfaces, and it slows nobody but itself.
#include "isobrick/viewer/serve/surface_session.h"

#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <array>
#include <chrono>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/random_numbers.h"
#include "tests/support/two_balls.h"

namespace isobrick {
namespace {

using Steps = std::array<std::int32_t, 3>;

std::uint32_t word(const std::vector<std::byte>& packet, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, packet.data() + at, sizeof value);
  return value;
}

struct JoinedMesh {
  std::map<Steps, std::uint32_t> numbers;
  std::vector<glm::dvec3> positions;  // voxels
  std::vector<std::uint32_t> triangles;

  void add(const std::vector<std::byte>& packet, double step) {
    const std::uint32_t vertices = word(packet, 24), corners = 3 * word(packet, 28);
    const auto* const data = reinterpret_cast<const unsigned char*>(packet.data()) + 48;
    std::vector<std::array<std::uint16_t, 4>> places(vertices);
    ASSERT_EQ(meshopt_decodeVertexBuffer(places.data(), vertices, 8, data, word(packet, 32)), 0);
    const auto padded = [&](std::size_t at) { return (word(packet, at) + 3u) & ~3u; };
    const std::size_t behind = padded(32) + padded(36);
    std::vector<std::uint32_t> indices(corners);
    ASSERT_EQ(
        meshopt_decodeIndexBuffer(indices.data(), corners, 4, data + behind, word(packet, 40)), 0);
    std::vector<std::uint32_t> joined;
    for (const auto& place : places) {
      Steps steps{};
      glm::dvec3 position(0.0);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const unsigned high = place[3] >> (5 * axis) & 31u;
        steps[axis] =
            static_cast<std::int32_t>(word(packet, 12 + 4 * axis) + place[axis] + 65536u * high);
        position[static_cast<int>(axis)] = step * steps[axis];
      }
      const auto [at, is_new] =
          numbers.try_emplace(steps, static_cast<std::uint32_t>(positions.size()));
      if (is_new) positions.push_back(position);
      joined.push_back(at->second);
    }
    for (const std::uint32_t index : indices) triangles.push_back(joined[index]);
  }
};

class TestLine : public ClientLine {
 public:
  void sendWord(const nlohmann::ordered_json& word) override {
    const nlohmann::json json = word;
    EXPECT_EQ(json["volume"], 7);
    said.push_back(json);
    for (const auto& range : json.value("show", nlohmann::json::array()))
      for (std::uint32_t id = range[0]; id <= range[1].get<std::uint32_t>(); ++id) shown.insert(id);
    for (const auto& range : json.value("drop", nlohmann::json::array()))
      for (std::uint32_t id = range[0]; id <= range[1].get<std::uint32_t>(); ++id) {
        shown.erase(id);
        kept.erase(id);
      }
  }
  void sendChunk(std::vector<std::byte> packet) override {
    const std::uint32_t id = word(packet, 4);
    EXPECT_EQ(word(packet, 44), 7u) << "of the volume";
    EXPECT_TRUE(kept.emplace(id, std::move(packet)).second);
  }
  bool hasRoom() const override { return has_room; }

  bool has_room = true;
  std::map<std::uint32_t, std::vector<std::byte>> kept;
  std::set<std::uint32_t> shown;
  std::vector<nlohmann::json> said;
};

class SurfaceSessionTest : public ::testing::Test {
 protected:
  SurfaceSessionTest() {
    OpenedVolume opened;
    opened.file = test::openTwoBalls(folder_);
    opened.histogram = histogramOf(*opened.file);
    opened_ = std::make_shared<const OpenedVolume>(std::move(opened));
    session_ = std::make_unique<SurfaceSession>(opened_, 7, 2, line_, [] {});
  }
  void wish(const std::string& text) {
    session_->take(parseClientMessage(Asked::ofMessage(text), session_->volume()));
  }
  const nlohmann::json& until(const std::string& type) {
    const std::size_t before = line_.said.size();
    while (line_.said.size() == before || line_.said.back()["type"] != type) {
      session_->update();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return line_.said.back();
  }
  JoinedMesh joined() const {
    JoinedMesh mesh;
    for (const std::uint32_t id : line_.shown) mesh.add(line_.kept.at(id), 1.0 / 128);
    return mesh;
  }
  void expectClosed(const JoinedMesh& mesh) const {
    const test::MeshReport report =
        test::checkMesh(mesh.positions, mesh.triangles, test::indexOptions(Index3(81)));
    EXPECT_TRUE(report.ok()) << report.summary();
    EXPECT_EQ(report.border_edges, 0);
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const OpenedVolume> opened_;
  TestLine line_;
  std::unique_ptr<SurfaceSession> session_;
};

TEST_F(SurfaceSessionTest, ChunksMakeTheSurface) {
  wish(R"({"type":"wish","wish":3,"surfaces":[{"iso":0}]})");
  EXPECT_EQ(until("fine")["wish"], 3);
  const JoinedMesh mesh = joined();
  expectClosed(mesh);
  IndexedMeshSink exact;
  extractIsosurface(*opened_->file, Query(), exact);
  EXPECT_EQ(mesh.triangles.size(), exact.mesh().triangles.size());
  EXPECT_EQ(mesh.positions.size(), exact.mesh().positions.size());
  for (const glm::dvec3& position : mesh.positions) {
    const double distance = std::min(std::abs(glm::distance(position, test::kLarge) - 22.0),
                                     std::abs(glm::distance(position, test::kSmall) - 12.0));
    ASSERT_LT(distance, 0.1);
  }
}

TEST_F(SurfaceSessionTest, AnyWishesEndInTheLastOne) {
  test::Random random(5);
  for (int i = 0; i < 30; ++i) {
    wish(R"({"type":"wish","wish":)" + std::to_string(i) + R"(,"surfaces":[{"iso":)" +
         std::to_string(test::randomReal(random, -3, 8)) + R"(}],"focus":[)" +
         std::to_string(test::randomInt(random, 0, 80)) + R"(,20,30],"radius":)" +
         std::to_string(test::randomInt(random, 1, 40)) + "}");
    for (int frames = 0; frames < test::randomInt(random, 0, 20); ++frames) {
      session_->update();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      if (!line_.shown.empty()) expectClosed(joined());
    }
  }
  EXPECT_EQ(until("fine")["wish"], 29);
  expectClosed(joined());
  EXPECT_EQ(line_.kept.size(), line_.shown.size()) << "all others were dropped";
}

TEST_F(SurfaceSessionTest, AClientThatTakesNothingGetsNothingAndThenAll) {
  line_.has_room = false;
  wish(R"({"type":"wish","wish":1,"surfaces":[{"iso":0}]})");
  for (int frame = 0; frame < 100; ++frame) {
    session_->update();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(line_.kept.empty());
  line_.has_room = true;
  until("fine");
  expectClosed(joined());
}

TEST_F(SurfaceSessionTest, ABoundOfTheClientHolds) {
  wish(R"({"type":"wish","wish":1,"surfaces":[{"iso":0}],"most_triangles":4000})");
  EXPECT_TRUE(until("fine").contains("limited"));
  const JoinedMesh mesh = joined();
  EXPECT_LE(mesh.triangles.size(), 3u * 4000);
  expectClosed(mesh);
}

TEST(PositionSteps, DifferentPlacesStayApart) {
  const PositionSteps steps(Index3(512, 512, 219));
  EXPECT_EQ(steps.step(), 1.0 / 128);
  EXPECT_EQ(steps.nearest({1.0, 2.5, 511.0}), glm::i32vec3(128, 320, 511 * 128));
  // The nearest crossings to a voxel do not fall on it.
  const double near = 1.0 / 4096;
  EXPECT_EQ(steps.nearest({7 + near, 7 - near, 7.0}), glm::i32vec3(7 * 128 + 1, 7 * 128 - 1, 896));
  EXPECT_EQ(PositionSteps(Index3(2, 2, 1 << 20)).step(), 0.5);
  EXPECT_EQ(PositionSteps(Index3(16384)).step(), 1.0 / 128);
}

TEST(PositionSteps, AChunkOfAnySizeIsPacked) {
  const PositionSteps steps(Index3(4000));
  SurfaceChunk chunk;
  chunk.origin = {1000, 0, 0};
  chunk.vertices = {{{0.0f, 0.0f, 0.0f}}, {{2900.5f, 0.0f, 1.0f}}, {{0.0f, 3999.0f, 700.25f}}};
  chunk.triangles = {0, 1, 2};
  packForClient(steps, chunk);
  EXPECT_TRUE(chunk.vertices.empty() && chunk.triangles.empty());
  EXPECT_EQ(trianglesOfPacket(chunk.packed), 1u);
  EXPECT_EQ(chunk.packed[11], std::byte{1});
  JoinedMesh mesh;
  mesh.add(chunk.packed, steps.step());
  const std::set<Steps> wanted{{128000, 0, 0}, {499264, 0, 128}, {128000, 511872, 89632}};
  std::set<Steps> got;
  for (const auto& [place, number] : mesh.numbers) got.insert(place);
  EXPECT_EQ(got, wanted);
}

}  // namespace
}  // namespace isobrick
