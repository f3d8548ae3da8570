// The real peers: built only if bench_peers is. OpenVDB is always there, VTK if it was found.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <sstream>

#include "tests/support/command_test.h"
#include "tools/bench/plain_mesh.h"
#include "tools/bench/triangle_tree.h"

namespace isobrick {
namespace {

using namespace test;

constexpr bool kHasVtk = ISOBRICK_BENCH_WITH_VTK;

class BenchPeersTest : public CommandTest {
 protected:
  void makeVolume(const std::string& type) {
    // Not a multiple of a brick, so that every brick's share of the voxels counts.
    runWell(
        {"phantom", "gyroid", "--voxels", "37", "--type", type, "-o", "gyroid.nrrd", "--force"});
    runWell({"build", "gyroid.nrrd", "--brick", "16", "--force"});
  }
  static const Json& rowOf(const Json& bench, const std::string& name) {
    for (const Json& row : bench["rows"])
      if (row["name"] == name) return row;
    throw std::runtime_error("no row " + name);
  }
};

TEST_F(BenchPeersTest, SayWhatRowsTheyHave) {
  Words words = {ISOBRICK_BENCH_PEERS, "--list"};
  const Outcome outcome = wait(start(words));
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.out,
            std::string(kHasVtk ? "vtkFlyingEdges3D exact\nvtkSynchronizedTemplates3D exact\n"
                                  "vtkMarchingCubes exact\n"
                                : "") +
                "openvdb-0 approximate\nopenvdb-0.1 approximate\nopenvdb-0.5 approximate\n");
  // Of further names those with a number that fits.
  for (const char* name : {"openvdb-0.03", "openvdb-0.1", "openvdb-1.5", "openvdb-x", "isobrick",
                           "vtkDecimatePro-0.8", "vtkDecimatePro-2", "vtkMarchingCubes-0.5"})
    words.push_back(name);
  const Outcome further = wait(start(words));
  EXPECT_EQ(further.status, 0) << further.err;
  EXPECT_EQ(further.out, outcome.out + "openvdb-0.03 approximate\n" +
                             (kHasVtk ? "vtkDecimatePro-0.8 approximate\n" : ""));
}

TEST_F(BenchPeersTest, MakeSurfacesSmaller) {
  makeVolume("u16");
  std::vector<std::string> names = {"openvdb-0.2", "simplify-1"};
  if (kHasVtk) names.insert(names.end(), {"vtkQuadricDecimation-0.7", "vtkDecimatePro-0.7"});
  const Json bench =
      runForJson({"bench", "gyroid.isb", "--iso", "32767.5", "--rounds", "1", "--repeat", "1",
                  "--rows", fmt::format("isobrick,{}", fmt::join(names, ","))});
  ASSERT_EQ(bench["rows"].size(), names.size() + 1);
  for (const std::string& name : names) {
    const Json& row = rowOf(bench, name);
    EXPECT_GT(row["triangles"], 0) << name;
    EXPECT_LT(row["triangles"], rowOf(bench, "isobrick")["triangles"]) << name;
    EXPECT_LT(row["distance"]["to_finest"]["mean"], 0.5) << name;
  }
}

// Pyramids in memory, of tools/benchmark.sh.
TEST_F(BenchPeersTest, MakeLevelsOfHalfTheSize) {
  makeVolume("u16");
  const Outcome listed = wait(start({ISOBRICK_BENCH_PYRAMID_PEERS}));
  EXPECT_EQ(listed.out, "itkRecursivePyramid\nitkBinShrink\nopenvdbMultiResGrid\n");
  std::istringstream rows(listed.out);
  for (std::string row; rows >> row;) {
    const Outcome outcome =
        wait(start({ISOBRICK_BENCH_PYRAMID_PEERS, "gyroid.isb", row, "4", "2", "2"}));
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    const Json made = Json::parse(outcome.out);
    EXPECT_EQ(made["seconds"].size(), 2u) << row;
    EXPECT_GT(made["peak_rss_bytes"], made["bytes"]) << row;
    const auto coarser = made["coarser_samples"].get<double>();
    // OpenVDB's levels reach a sample further, as ours do.
    constexpr double kFewest = 18 * 18 * 18 + 9 * 9 * 9 + 4 * 4 * 4;
    constexpr double kMost = 20 * 20 * 20 + 11 * 11 * 11 + 7 * 7 * 7;
    EXPECT_GE(coarser, kFewest) << row;
    EXPECT_LE(coarser, row == "openvdbMultiResGrid" ? kMost : kFewest) << row;
  }
  const Outcome wrong =
      wait(start({ISOBRICK_BENCH_PYRAMID_PEERS, "gyroid.isb", "other", "4", "2", "2"}));
  EXPECT_EQ(wrong.status, 1);
  EXPECT_EQ(
      wrong.err,
      "bench_pyramid_peers: there is no row 'other'; without arguments the rows are listed\n");
}

// `bench` finds bench_peers by itself, and puts all its rows beside ours.
TEST_F(BenchPeersTest, AreBesideOurRows) {
  makeVolume("u16");
  const Json bench = runForJson({"bench", "gyroid.isb", "--iso", "32767.5", "--rounds", "1",
                                 "--repeat", "1", "--threads", "2"});
  ASSERT_EQ(bench["rows"].size(), kHasVtk ? 7u : 4u);
  const char* const one = kHasVtk ? "vtkFlyingEdges3D" : "isobrick";
  EXPECT_EQ(rowOf(bench, "openvdb-0")["ratio_to"], one);
  EXPECT_EQ(rowOf(bench, one)["ratio"], 1.0);
  double least = 0;
  for (const char* name : {"openvdb-0", "openvdb-0.1", "openvdb-0.5"}) {
    const Json& row = rowOf(bench, name);
    EXPECT_GT(row["prepare_seconds"]["median"], 0) << name;
    for (const char* way : {"to_finest", "from_finest"}) {
      EXPECT_GT(row["distance"][way]["mean"], least) << name;
      EXPECT_LT(row["distance"][way]["mean"], 0.3) << name;
    }
    least = row["distance"]["from_finest"]["mean"];
  }
  EXPECT_LT(rowOf(bench, "openvdb-0.5")["triangles"], rowOf(bench, "openvdb-0")["triangles"]);
}

// The peers' voxels are the volume's, in each of its types: the surfaces agree.
TEST_F(BenchPeersTest, TheirSurfacesAreOurs) {
  const std::pair<const char*, const char*> types[] = {
      {"u8", "127.5"}, {"i8", "-0.5"}, {"u16", "32767.5"}, {"i16", "-0.5"}, {"f32", "0.01"}};
  for (const auto& [type, isovalue] : types) {
    makeVolume(type);
    const Json bench = runForJson(
        {"bench", "gyroid.isb", std::string("--iso=") + isovalue, "--rounds", "1", "--repeat", "1",
         "--rows",
         kHasVtk ? "isobrick,vtkFlyingEdges3D,vtkMarchingCubes,openvdb-0" : "isobrick,openvdb-0"});
    const Json& own = rowOf(bench, "isobrick");
    EXPECT_GT(own["triangles"], 10000);
    for (const char* name : {"vtkFlyingEdges3D", "vtkMarchingCubes"}) {
      if (!kHasVtk) break;
      EXPECT_EQ(rowOf(bench, name)["vertices"], own["vertices"]) << type << " " << name;
      // Ambiguous faces may be cut differently.
      EXPECT_NEAR(rowOf(bench, name)["triangles"].get<double>(), own["triangles"].get<double>(),
                  0.01 * own["triangles"].get<double>())
          << type << " " << name;
    }
    for (const char* way : {"to_finest", "from_finest"})
      EXPECT_LT(rowOf(bench, "openvdb-0")["distance"][way]["mean"], 0.1) << type;
  }
}

#if ISOBRICK_BENCH_WITH_VTK
// VTK's vertices lie on our surface, point by point.
TEST_F(BenchPeersTest, TheVerticesOfAnExactPeerLieOnOurSurface) {
  makeVolume("u16");
  const Words words = {
      ISOBRICK_BENCH_PEERS, "gyroid.isb", "--iso",          "32767.5", "--threads", "1", "--row",
      "vtkFlyingEdges3D",   "--mesh",     path("peer_mesh")};
  EXPECT_EQ(wait(start(words)).status, 0);
  runWell({"bench-row", "gyroid.isb", "--iso", "32767.5", "--row", "isobrick", "--mesh",
           path("own_mesh")});
  const PlainMesh peer = readPlainMesh(path("peer_mesh")), own = readPlainMesh(path("own_mesh"));
  EXPECT_GT(own.triangles.size(), 10000u);
  for (const auto& [from, to] : {std::pair(&peer, &own), std::pair(&own, &peer)}) {
    const TriangleTree tree(*to);
    TriangleTree::Hint hint;
    double furthest = 0;
    for (const auto& [x, y, z] : from->positions)
      furthest = std::max(furthest, tree.distance({x, y, z}, hint));
    // Ours keep 1/4096 away from an edge's ends.
    EXPECT_LT(furthest, 1.0 / 2048);
  }
}

#endif

TEST_F(BenchPeersTest, FailuresAreOneLine) {
  makeVolume("u8");
  const auto expectPeerFailure = [&](Words words, const std::string& message) {
    words.insert(words.begin(), ISOBRICK_BENCH_PEERS);
    const Outcome outcome = wait(start(words));
    EXPECT_NE(outcome.status, 0);
    EXPECT_EQ(outcome.out, "");
    EXPECT_NE(outcome.err.find(message), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
  };
  expectPeerFailure({"gyroid.isb", "--iso", "1", "--row", "none"}, "there is no row 'none'");
  expectPeerFailure({"no.isb", "--iso", "1", "--row", "openvdb-0"}, "no.isb");
}

}  // namespace
}  // namespace isobrick
