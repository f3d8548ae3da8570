// At any moment, whatever the user does, the mesh on the screen is closed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <thread>

#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/viewer/session/drawn_scene.h"
#include "isobrick/viewer/session/view_session.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/mesh_checker.h"

namespace isobrick {
namespace {

TEST(ShownMeshTest, AtAHundredMomentsItPassesTheChecker) {
  const test::TemporaryFolder folder;
  BuildOptions options;
  options.brick_cells = 8;
  const auto pyramid = std::make_shared<const Pyramid>(test::buildField(
      folder, Index3(40),
      [](const glm::dvec3& p) {
        return std::sin(0.5 * p.x) * std::cos(0.4 * p.y) + std::sin(0.45 * p.z) + 0.02 * p.x;
      },
      options));
  test::KeepingRenderer renderer;
  ViewSession session(pyramid, renderer, {2, std::uint64_t{1} << 30});
  session.apply(InputEvent::resized(100.0, 100.0), 0.0, false);

  std::mt19937 random(17);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  double clock = 0.0;
  std::size_t with_triangles = 0;
  std::uint64_t reused = 0;                // triangles of what was looked at
  std::map<std::uint64_t, int> looked_at;  // by the pass that was shown
  for (int moment = 0; moment < 100; ++moment) {
    ViewState& state = session.state();
    switch (random() % 5) {
      case 0:
        state.surfaces[0].isovalue = 1.6 * share(random) - 0.8;
        break;
      case 1:
        state.focus.radius = 4.0 + 30.0 * share(random);
        break;
      case 2:
        state.focus.center = 40.0 * glm::dvec3(share(random), share(random), share(random));
        break;
      case 3:
        state.curvature_tolerance.reset();
        if (share(random) < 0.5) state.curvature_tolerance = 0.1 * share(random);
        break;
      default:
        break;  // the user rests
    }
    for (int frame = 0; frame < 4; ++frame) {
      session.update(clock += 0.05);
      session.draw();
      std::this_thread::yield();
    }
    IndexedMeshSink sink;
    takeShownMesh(renderer, renderer.frame().chunks, {}, sink);
    const IndexedMesh& mesh = sink.mesh();
    ++looked_at[session.status().passes];
    reused += session.status().triangles -
              std::min(session.status().triangles, session.status().triangles_made);
    if (mesh.triangles.empty()) continue;
    ++with_triangles;
    const test::MeshReport report =
        test::checkMesh(mesh.positions, mesh.triangles, test::indexOptions(Index3(40)));
    ASSERT_TRUE(report.ok()) << moment << ": " << report.summary();
  }
  // However slow the machine, there is a surface in the end.
  do {
    session.update(clock += 0.05);
    std::this_thread::yield();
  } while (!session.settled());
  session.draw();
  IndexedMeshSink sink;
  takeShownMesh(renderer, renderer.frame().chunks, {}, sink);
  const IndexedMesh& mesh = sink.mesh();
  ASSERT_FALSE(mesh.triangles.empty());
  EXPECT_TRUE(test::checkMesh(mesh.positions, mesh.triangles, test::indexOptions(Index3(40))).ok());
  RecordProperty("triangles_used_again", static_cast<int>(reused));
  RecordProperty("moments_with_triangles", static_cast<int>(with_triangles));
  RecordProperty("surfaces", static_cast<int>(looked_at.size()));
}

}  // namespace
}  // namespace isobrick
