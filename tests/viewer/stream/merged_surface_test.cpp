// Passes as meshes, by news alone: closed, the same triangles as a query gives, in any order of
// requests.
#include "isobrick/viewer/stream/merged_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <mutex>
#include <semaphore>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/mesh_checker.h"

namespace isobrick {
namespace {

using MessageKind = StreamMessage::Kind;

class MergedSurfaceTest : public ::testing::Test {
 protected:
  MergedSurfaceTest() {
    pyramid_ = test::openField(folder_, Index3(70), [](const glm::dvec3& p) {
      const glm::dvec3 q = p * 0.3;
      return 10.0 * (std::sin(q.x) * std::cos(q.y) + std::sin(q.y) * std::cos(q.z) +
                     std::sin(q.z) * std::cos(q.x));
    });
  }

  StreamPass pass(double radius, double isovalue = 1.25) const {
    StreamPass result;
    result.radius = radius;
    Query query;
    query.isovalue = isovalue;
    query.focus = FocusSphere{{20.0, 30.0, 35.0}, radius};
    result.queries.push_back({0, query});
    return result;
  }
  // The next end of a pass, woken by news and nothing else; none after 20 s without any.
  std::optional<StreamMessage> wait(SurfaceStream& stream, SurfaceMerger& merger) {
    do {
      if (auto end = merger.next(stream)) return end;
    } while (news_.try_acquire_for(std::chrono::seconds(20)));
    return std::nullopt;
  }
  void expectIs(const MergedSurface& merged, const Query& query) const {
    IndexedMeshSink sink;
    extractIsosurface(*pyramid_, query, sink);
    const IndexedMesh& mesh = sink.mesh();
    EXPECT_EQ(merged.triangles.size(), mesh.triangles.size());
    EXPECT_EQ(merged.vertices.size(), mesh.positions.size());
    EXPECT_EQ(merged.normals.size(), merged.vertices.size());
    EXPECT_EQ(3 * merged.levels.size(), merged.triangles.size());
    const test::MeshReport report =
        test::checkMesh(merged.vertices, merged.triangles,
                        test::volumeOptions(pyramid_->spec().geometry, pyramid_->spec().voxels));
    EXPECT_TRUE(report.ok()) << report.summary();
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  std::counting_semaphore<> news_{0};
};

TEST_F(MergedSurfaceTest, EveryPassIsAMeshAndNewsIsAllThatAFrontEndWaitsFor) {
  SurfaceStream stream(pyramid_, 2, [&] { news_.release(); });
  SurfaceMerger merger(pyramid_->spec().geometry);
  EXPECT_TRUE(merger.merged().vertices.empty());
  const StreamRequest request{{pass(6.0), pass(20.0), pass(70.0)}, false};
  stream.request(request);
  std::size_t coarse = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto end = wait(stream, merger);
    ASSERT_TRUE(end);
    ASSERT_EQ(end->kind, MessageKind::kPassDone) << end->error;
    EXPECT_EQ(end->pass, i);
    const MergedSurface merged = merger.merged();
    expectIs(merged, request.passes[i].queries[0].query);
    const auto of_level = [&](int level) {
      return static_cast<std::uint64_t>(
          std::count(merged.levels.begin(), merged.levels.end(), level));
    };
    for (const LevelCounts& level : end->surfaces[0].levels)
      EXPECT_EQ(of_level(level.level), level.triangles);
    coarse += of_level(1) + of_level(2);
    for (const glm::vec3& normal : merged.normals) EXPECT_NEAR(glm::length(normal), 1.0f, 1e-3f);
  }
  EXPECT_GT(coarse, 0u);
  EXPECT_FALSE(merger.next(stream));
  EXPECT_FALSE(stream.busy());
}

TEST_F(MergedSurfaceTest, TheLatestRequestIsTheOneThatStays) {
  SurfaceStream stream(pyramid_, 2, [&] { news_.release(); });
  SurfaceMerger merger(pyramid_->spec().geometry);
  std::uint64_t last = 0;
  for (int i = 0; i < 30; ++i) {
    last = stream.request({{pass(10.0, 0.1 * i), pass(60.0, 0.1 * i)}});
    if (i % 7 == 0) stream.cancel();
    if (i % 3 == 0) merger.next(stream);
  }
  for (bool is_last = false; !is_last;) {
    const auto end = wait(stream, merger);
    ASSERT_TRUE(end);
    ASSERT_NE(end->kind, MessageKind::kFailed) << end->error;
    is_last = end->kind == MessageKind::kPassDone && end->request == last && end->last_pass;
  }
  expectIs(merger.merged(), pass(60.0, 0.1 * 29).queries[0].query);
}

TEST_F(MergedSurfaceTest, SurfacesStayApart) {
  SurfaceStream stream(pyramid_, 2, [&] { news_.release(); });
  SurfaceMerger merger(pyramid_->spec().geometry);
  StreamPass both = pass(30.0, 1.25);
  both.queries.push_back({7, pass(30.0, -6.5).queries[0].query});
  stream.request({{both}, false});
  const auto end = wait(stream, merger);
  ASSERT_TRUE(end && end->kind == MessageKind::kPassDone);
  expectIs(merger.merged(), both.queries[0].query);
  expectIs(merger.merged(7), both.queries[1].query);
  EXPECT_TRUE(merger.merged(1).vertices.empty());
}

// From the bricks in memory at once, and whole when all were read.
TEST_F(MergedSurfaceTest, AQueryIsOneRequest) {
  SurfaceStream stream(pyramid_, 2, [&] { news_.release(); });
  SurfaceMerger merger(pyramid_->spec().geometry);
  Query query;
  query.isovalue = 2.5;
  stream.request(requestOf(query));
  int passes = 0;
  for (bool is_last = false; !is_last; ++passes) {
    const auto end = wait(stream, merger);
    ASSERT_TRUE(end && end->kind == MessageKind::kPassDone);
    EXPECT_EQ(end->last_pass, end->is_complete);
    const test::MeshReport report =
        test::checkMesh(merger.merged().vertices, merger.merged().triangles,
                        test::volumeOptions(pyramid_->spec().geometry, pyramid_->spec().voxels));
    EXPECT_TRUE(report.ok()) << report.summary();
    is_last = end->last_pass;
  }
  EXPECT_LE(passes, 2);
  expectIs(merger.merged(), query);
}

TEST_F(MergedSurfaceTest, AnErrorIsNewsToo) {
  SurfaceStream stream(pyramid_, 2, [&] { news_.release(); });
  SurfaceMerger merger(pyramid_->spec().geometry);
  StreamPass wrong = pass(20.0);
  wrong.queries[0].query.focus->radius = -1.0;
  stream.request({{pass(10.0)}, false});
  ASSERT_TRUE(wait(stream, merger));
  stream.request({{wrong}, false});
  const auto end = wait(stream, merger);
  ASSERT_TRUE(end && end->kind == MessageKind::kFailed);
  EXPECT_FALSE(end->error.empty());
  expectIs(merger.merged(), pass(10.0).queries[0].query);  // stays
  stream.request({{pass(12.0)}, false});
  ASSERT_TRUE(wait(stream, merger));
  expectIs(merger.merged(), pass(12.0).queries[0].query);
}

}  // namespace
}  // namespace isobrick
