// Lists of components for all uses, held against a finder over the whole surface, and against
// balls.
#include "isobrick/viewer/stream/listed_components.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/viewer/stream/surface_set.h"
#include "isobrick/viewer/stream/surface_stream.h"
#include "tests/extract/random_case.h"
#include "tests/support/array_source.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/keeping_renderer.h"
#include "tests/support/two_balls.h"

namespace isobrick::test {
namespace {

// The numbers of all vertices, with their voxels; and that a component of a batch has one.
class NumberedVertices : public TriangleSink {
 public:
  struct Vertex {
    glm::dvec3 voxel{0.0};
    std::uint32_t number = 0;
    bool is_uniform = false;
  };

  void write(PlacedBatch& placed) override {
    const MeshBatch& batch = placed.batch;
    ASSERT_EQ(placed.components.size(), batch.positions.size());
    const std::lock_guard lock(mutex_);
    for (std::size_t v = 0; v < batch.positions.size(); ++v)
      vertices.push_back({glm::dvec3(batch.origin) + glm::dvec3(batch.positions[v]),
                          placed.components[v], batch.is_uniform});
    for (std::size_t i = 0; i < batch.triangles.size(); ++i)
      are_flat = are_flat && placed.components[batch.triangles[i]] ==
                                 placed.components[batch.triangles[i - i % 3]];
  }

  std::vector<Vertex> vertices;
  bool are_flat = true;

 private:
  std::mutex mutex_;
};

class RandomPyramid {
 public:
  explicit RandomPyramid(std::uint32_t seed) : random(seed) {
    const Index3 dims = random.dims();
    BuildOptions build;
    build.brick_cells = std::int64_t{8} << random.uniform(0, 1);
    GridGeometry geometry;
    geometry.spacing = {random.real(0.3, 2), random.real(0.3, 2), random.real(0.3, 2)};
    geometry.origin = {random.real(-99, 99), 50, -1000};
    geometry.direction = glm::dmat3(0, 1, 0, -1, 0, 0, 0, 0, 1);
    ArraySource<float> source(dims, random.field<float>(dims), geometry);
    buildPyramid(source, folder_.file("case.isb"), build);
    pyramid.emplace(folder_.file("case.isb"));
  }
  glm::dvec3 point() {
    const glm::dvec3 last(pyramid->spec().voxels - Index3(1));
    return pyramid->spec().geometry.indexToWorld(
        {random.real(-2, last.x + 2), random.real(-2, last.y + 2), random.real(-2, last.z + 2)});
  }

  RandomCase random;
  std::optional<Pyramid> pyramid;

 private:
  TemporaryFolder folder_;
};

TEST(ListedComponents, FindsAndChoosesAsTwoPassesDo) {
  std::size_t found_some = 0, kept_some = 0;
  for (std::uint32_t seed = 1; seed <= 50; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomPyramid volume(seed);
    const Pyramid& pyramid = *volume.pyramid;
    const int levels = pyramid.lattice().levels();
    Query query;
    query.isovalue = volume.random.real(20, 180);
    query.uniform_level = volume.random.chance(0.5) ? 0 : volume.random.uniform(0, levels - 1);
    ComponentPoints points;
    points.reach = volume.random.chance(0.5) ? std::numeric_limits<double>::infinity()
                                             : volume.random.real(0, 3);
    for (int i = 0; i < 10; ++i) points.points.push_back(volume.point());
    Extractor extractor(pyramid);
    ComponentFinder finder(query, points);
    extractor.extract(query, finder);
    const SurfaceComponents expected = finder.take();

    const ListedComponents listed(extractor, pyramid, {query.isovalue, *query.uniform_level});
    ASSERT_EQ(listed.list().size(), expected.list().size());
    ASSERT_EQ(listed.nearest(extractor, points, nullptr), expected.atPoints());
    for (const auto& at : expected.atPoints()) found_some += at.has_value();

    PieceChoice choice;
    const auto add = [&](std::vector<ComponentSeed>& seeds, std::size_t count) {
      for (std::size_t i = 0; i < std::min(count, listed.list().size()); ++i)
        seeds.push_back({listed.list()[i].point, listed.list()[i].area});
      seeds.push_back({volume.point(), 1e9});
    };
    if (volume.random.chance(0.4)) add(choice.keep, 2);
    if (volume.random.chance(0.7)) add(choice.hide, 3);
    choice.least_area = volume.random.chance(0.5) ? volume.random.real(0, 9) : 0.0;
    HashingSink in_two_passes, by_list;
    const ChosenExtraction once = extractChosen(extractor, query, choice, in_two_passes);
    ChosenComponents chosen = listed.chosen(extractor, choice, nullptr);
    EXPECT_EQ(chosen.lost, once.lost);
    kept_some += std::ranges::count(chosen.is_kept, 1) > 0;
    ComponentFilter filter(listed.components(), chosen.is_kept, by_list);
    extractor.extract(query, filter);
    EXPECT_EQ(by_list.value(), in_two_passes.value());
  }
  EXPECT_GT(found_some, 100u);
  EXPECT_GT(kept_some, 20u);
}

// In the ball that is nearer: 0 the large one.
std::uint32_t ballAt(const glm::dvec3& voxel, double isovalue) {
  const double large = std::abs(glm::distance(voxel, kLarge) - kLargeRadius + isovalue);
  const double small = std::abs(glm::distance(voxel, kSmall) - kSmallRadius + isovalue);
  return large <= small ? 0 : 1;
}

TEST(ListedComponents, NumbersTheBallsAndNothingCoarser) {
  const TemporaryFolder folder;
  const auto pyramid = openTwoBalls(folder);
  Extractor extractor(*pyramid);
  const ListedComponents listed(extractor, *pyramid, {0.0, 0});
  const ListedNumbers numbers(listed);
  for (int level = 0; level < 3; ++level) {
    SCOPED_TRACE("level " + std::to_string(level));
    Query query;
    query.uniform_level = level;
    NumberedVertices vertices;
    ComponentNumbering numbering(numbers, vertices);
    extractor.extract(query, numbering);
    ASSERT_FALSE(vertices.vertices.empty());
    for (const auto& vertex : vertices.vertices)
      ASSERT_EQ(vertex.number, level == 0 ? ballAt(vertex.voxel, 0.0) : kNoComponent);
  }
}

// In bricks that are all of the list's level, whatever is around them.
TEST(ListedComponents, NumbersBricksOfItsOwnLevelExactly) {
  std::size_t compared = 0;
  for (std::uint32_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE("mesh " + std::to_string(seed));
    RandomPyramid volume(seed + 100);
    const Pyramid& pyramid = *volume.pyramid;
    Extractor extractor(pyramid);
    Query query;
    query.isovalue = volume.random.real(20, 180);
    const ListedComponents listed(extractor, pyramid, {query.isovalue, 0});
    NumberedVertices all;
    ComponentFilter filter(listed.components(), listed.list().size(), all);
    extractor.extract(query, filter);
    std::map<std::array<double, 3>, std::uint32_t> expected;
    for (const auto& vertex : all.vertices)
      expected[{vertex.voxel.x, vertex.voxel.y, vertex.voxel.z}] = vertex.number;

    query.focus =
        FocusSphere{glm::dvec3(pyramid.spec().voxels / Index3(2)), volume.random.real(4, 20)};
    NumberedVertices vertices;
    const ListedNumbers numbers(listed);
    ComponentNumbering numbering(numbers, vertices);
    extractor.extract(query, numbering);
    EXPECT_TRUE(vertices.are_flat);
    for (const auto& vertex : vertices.vertices) {
      const auto same = expected.find({vertex.voxel.x, vertex.voxel.y, vertex.voxel.z});
      if (vertex.number == kNoComponent || same == expected.end()) continue;
      ASSERT_TRUE(vertex.is_uniform);
      ASSERT_EQ(vertex.number, same->second);
      ++compared;
    }
  }
  EXPECT_GT(compared, 5000u);
}

TEST(KnownComponents, ListsASurfaceOnceAndForgetsWhatWasNotUsed) {
  const TemporaryFolder folder;
  const auto pyramid = openTwoBalls(folder);
  Extractor extractor(*pyramid);
  const std::uint64_t bytes = ListedComponents(extractor, *pyramid, {0.0, 0}).bytes();
  EXPECT_GT(bytes, 1000u);
  EXPECT_LT(bytes, 100'000u);
  KnownComponents known(2 * bytes + bytes / 2);
  EXPECT_EQ(known.find(0.0, 0), nullptr);
  const auto first = known.findOrList(extractor, *pyramid, {0.0, 0});
  EXPECT_EQ(known.findOrList(extractor, *pyramid, {0.0, 0}), first);
  EXPECT_EQ(known.find(0.0, 1), nullptr);
  EXPECT_EQ(known.find(0.1, 0), nullptr);
  known.findOrList(extractor, *pyramid, {0.1, 0});
  EXPECT_EQ(known.find(0.0, 0), first);
  const auto third = known.findOrList(extractor, *pyramid, {0.2, 0});
  EXPECT_NE(third->number(), first->number());
  EXPECT_EQ(known.listings(), 3u);
  EXPECT_EQ(known.find(0.1, 0), nullptr);  // it was used longest ago
  EXPECT_EQ(known.find(0.0, 0), first);
  EXPECT_EQ(known.find(0.2, 0), third);
  KnownComponents small(1);
  const auto only = small.findOrList(extractor, *pyramid, {0.0, 0});
  EXPECT_EQ(small.find(0.0, 0), only);
  EXPECT_THROW(small.findOrList(extractor, *pyramid, {0.3, 0, nullptr, nullptr, 10}),
               TooManyTriangles);
}

// However many ask for it at the same time; one that gives up does not keep the others from it.
TEST(KnownComponents, ASurfaceThatSeveralThreadsAskForIsListedOnce) {
  const TemporaryFolder folder;
  const auto pyramid = openTwoBalls(folder);
  for (int round = 0; round < 20; ++round) {
    KnownComponents known;
    std::vector<std::shared_ptr<const ListedComponents>> lists(4);
    std::vector<std::thread> threads;
    for (auto& list : lists)
      threads.emplace_back([&] {
        Extractor extractor(*pyramid);
        list = known.findOrList(extractor, *pyramid, {0.0, 0});
      });
    CancelFlag cancel;
    std::thread gives_up([&] {
      Extractor extractor(*pyramid);
      try {
        known.findOrList(extractor, *pyramid, {0.0, 0, &cancel});
      } catch (const Cancelled&) {
      }
    });
    cancel.request();
    gives_up.join();
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(known.listings(), 1u);
    for (const auto& list : lists) EXPECT_EQ(list, known.find(0.0, 0));
  }
}

// A brick that was coloured by one list is not that of another.
TEST(SurfaceStreamColours, ChunksOfAnotherListAreMadeAgain) {
  const TemporaryFolder folder;
  const auto pyramid = openTwoBalls(folder);
  Extractor extractor(*pyramid);
  const auto first =
      std::make_shared<const ListedComponents>(extractor, *pyramid, ListingQuery{0.0, 0});
  const auto second =
      std::make_shared<const ListedComponents>(extractor, *pyramid, ListingQuery{0.0, 0});
  KeepingRenderer renderer;
  SurfaceSet set(renderer, std::uint64_t{1} << 30);
  SurfaceStream stream(pyramid, 2);
  const auto passOf = [&](const std::shared_ptr<const ListedComponents>& listed,
                          StreamValues::What what = StreamValues::What::kComponent) {
    StreamRequest request;
    Query query;
    query.isovalue = 0.0;
    request.passes = {{0.0, {{0, query, {}, listed}}}};
    request.at_once = false;
    request.values.what = what;
    stream.request(std::move(request));
    StreamMessage done;
    double clock = 0.0;
    while (stream.busy()) {
      UploadAllowance allowance;
      auto news = set.pump([&] { return stream.poll(); }, [&] { return clock += 1e-4; }, allowance);
      for (StreamMessage& pass : news.passes) done = std::move(pass);
    }
    EXPECT_EQ(done.what, what);
    return done;
  };
  const StreamMessage whole = passOf(first);
  EXPECT_GT(whole.triangles_made, 0u);
  EXPECT_EQ(whole.surfaces.at(0).largest, (std::vector<std::size_t>{0, 1}));
  EXPECT_EQ(whole.surfaces.at(0).pieces, 2u);
  EXPECT_EQ(passOf(first).triangles_made, 0u);
  EXPECT_EQ(passOf(second).triangles_made, whole.triangles);
  EXPECT_EQ(passOf(nullptr).triangles_made, whole.triangles);
  for (const ChunkId id : set.shown())
    for (const SurfaceVertex& vertex : renderer.download(id).vertices)
      ASSERT_EQ(vertex.value, kNoVertexValue);
  EXPECT_EQ(passOf(first, StreamValues::What::kNone).triangles_made, 0u);  // the same bytes
  EXPECT_EQ(passOf(first).triangles_made, whole.triangles);
  for (const ChunkId id : set.shown()) {
    const SurfaceChunk chunk = renderer.download(id);
    for (const SurfaceVertex& vertex : chunk.vertices)
      ASSERT_EQ(vertex.value, ballAt(chunk.origin + glm::dvec3(vertex.position), 0.0));
  }
}

}  // namespace
}  // namespace isobrick::test
