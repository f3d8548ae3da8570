// Coarse versions of a volume while it is built: where they are, what they hold, that they go.
#include <gtest/gtest.h>

#include <filesystem>
#include <glm/geometric.hpp>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/preview_maker.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

namespace fs = std::filesystem;

GridGeometry slantedGeometry() {
  const double c = std::cos(0.3), s = std::sin(0.3);
  GridGeometry geometry;
  geometry.spacing = {0.5, 0.75, 1.25};
  geometry.origin = {100.0, -20.0, 7.0};
  geometry.direction = glm::dmat3(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, -1.0);
  return geometry;
}

template <typename T>
std::vector<T> samplesOf(const std::string& pyramid) {
  const auto source = makePyramidSource(std::make_shared<const Pyramid>(pyramid), 1 << 24, 0);
  const Index3 voxels = source->info().voxels;
  std::vector<T> samples(static_cast<std::size_t>(elementCount(voxels)));
  source->readBox({Index3(0), voxels}, samples.data());
  return samples;
}

TEST(PreviewTest, ItsGridIsTheFinestThatIsSmall) {
  EXPECT_FALSE(previewGridOf(Index3(128)));
  EXPECT_FALSE(previewGridOf({4096, 4096, 3}));  // a slice would be left
  const auto expectGrid = [](const Index3& voxels, std::int64_t step, const Index3& samples) {
    const auto grid = previewGridOf(voxels);
    ASSERT_TRUE(grid);
    EXPECT_EQ(grid->step, step);
    EXPECT_EQ(grid->samples, samples);
  };
  expectGrid(Index3(129), 2, Index3(65));
  expectGrid({512, 512, 234}, 4, {128, 128, 59});
  expectGrid(Index3(2048), 16, Index3(128));
  expectGrid({1024, 1024, 3}, 2, {512, 512, 2});
}

// Level 1 arrives in boxes of any shape, and all samples come to where they belong.
TEST(PreviewTest, SamplesAreTakenFromAnyBoxes) {
  const Index3 voxels(43, 38, 70);
  const PreviewGrid grid{4, (voxels - Index3(1)) / std::int64_t{4} + Index3(1)};
  const auto field = [](const Index3& p) {
    return static_cast<float>(p.x + 100 * p.y + 10000 * p.z);
  };
  TemporaryFolder folder;
  VolumeInfo info;
  info.voxels = voxels;
  info.voxel_type = VoxelType::kFloat32;
  info.geometry = slantedGeometry();
  info.source = "field";
  BuildOptions options;
  options.preview.folder = folder.path();
  options.preview.most_share = 1.0;
  std::vector<std::int64_t> slices;
  options.preview.published = [&](const BuildPreview& preview) {
    EXPECT_EQ(preview.step, 4);
    EXPECT_EQ(preview.voxels, voxels);
    const Pyramid pyramid(preview.path);
    const Index3 samples = pyramid.spec().voxels;
    EXPECT_EQ(samples.x, grid.samples.x);
    EXPECT_EQ(samples.y, grid.samples.y);
    slices.push_back(samples.z);
    const GridGeometry& geometry = pyramid.spec().geometry;
    EXPECT_EQ(geometry.origin, info.geometry.origin);
    EXPECT_EQ(geometry.spacing, 4.0 * info.geometry.spacing);
    EXPECT_EQ(geometry.direction, info.geometry.direction);
    const std::vector<float> values = samplesOf<float>(preview.path);
    for (std::int64_t i = 0; i < elementCount(samples); ++i)
      ASSERT_EQ(values[static_cast<std::size_t>(i)], field(std::int64_t{4} * indexAt(i, samples)));
  };
  {
    PreviewMaker<float> maker(info, grid, options);
    const Index3 level1 = Lattice(voxels).samples(1);
    const std::vector<std::int64_t> cuts[] = {
        {0, 7, 8, level1.x}, {0, 5, level1.y}, {0, 3, 6, 17, level1.z}};
    for (std::size_t z = 0; z + 1 < cuts[2].size(); ++z) {
      for (std::size_t y = 0; y + 1 < cuts[1].size(); ++y)
        for (std::size_t x = 0; x + 1 < cuts[0].size(); ++x) {
          const IndexBox box{{cuts[0][x], cuts[1][y], cuts[2][z]},
                             {cuts[0][x + 1] - cuts[0][x], cuts[1][y + 1] - cuts[1][y],
                              cuts[2][z + 1] - cuts[2][z]}};
          const std::vector<float> samples = arrayOfField<float>(
              box.count, [&](const Index3& p) { return field(std::int64_t{2} * (box.first + p)); });
          maker.include(box, samples.data());
        }
      maker.offer(cuts[2][z + 1]);
    }
    EXPECT_FALSE(fs::is_empty(folder.path()));
  }
  EXPECT_EQ(slices, (std::vector<std::int64_t>{2, 3, 9, 18}));
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

class PreviewOfABuildTest : public testing::Test {
 protected:
  static constexpr double kRadius = 60.0;  // world units

  PreviewOfABuildTest() {
    const glm::dvec3 last(kVoxels - Index3(1));
    center_ = geometry_.indexToWorld(0.5 * last);
    values_ = arrayOfField<float>(kVoxels, [&](const Index3& p) {
      return kRadius - glm::distance(geometry_.indexToWorld(glm::dvec3(p)), center_);
    });
    options_.with_curvature = false;
    options_.codec = format::Codec::kStored;
    options_.preview.folder = folder_.path();
    options_.preview.most_share = 1.0;
  }

  void build() {
    ArraySource<float> source(kVoxels, values_, geometry_);
    buildPyramid(source, output_.file("sphere.isb"), options_);
  }

  // How far the vertices of its surface are from the sphere, in world units.
  double farthestFromSphere(const std::string& path) const {
    Query query;
    query.isovalue = 0.0;
    IndexedMeshSink sink;
    extractIsosurface(Pyramid(path), query, sink);
    double farthest = sink.mesh().positions.empty() ? 1e9 : 0.0;
    for (const glm::dvec3& position : sink.mesh().positions)
      farthest = std::max(farthest, std::abs(glm::distance(position, center_) - kRadius));
    return farthest;
  }

  const Index3 kVoxels{260, 180, 100};  // 130 x 135 x 125 world units
  const GridGeometry geometry_ = slantedGeometry();
  glm::dvec3 center_{0.0};
  std::vector<float> values_;
  BuildOptions options_;
  TemporaryFolder folder_, output_;
};

TEST_F(PreviewOfABuildTest, TheSurfaceIsWhereThatOfThePyramidIs) {
  std::vector<std::int64_t> slices;
  options_.preview.published = [&](const BuildPreview& preview) {
    EXPECT_EQ(preview.step, 2);
    EXPECT_EQ(preview.voxels, kVoxels);
    EXPECT_LT(farthestFromSphere(preview.path), 0.25);  // of voxels of 2.5
    slices.push_back(Pyramid(preview.path).spec().voxels.z);
  };
  build();
  EXPECT_EQ(slices, (std::vector<std::int64_t>{32, 50}));
  EXPECT_TRUE(fs::is_empty(folder_.path()));
  EXPECT_LT(farthestFromSphere(output_.file("sphere.isb")), 0.1);
  // They leave no trace in it.
  const std::string with_previews = readBytes(output_.file("sphere.isb"));
  options_.preview = {};
  build();
  EXPECT_TRUE(readBytes(output_.file("sphere.isb")) == with_previews);
}

// A build that is soon done has no time to spare for one before it ends.
TEST_F(PreviewOfABuildTest, TheFirstComesAtOnceHoweverSmallTheShare) {
  std::vector<std::int64_t> slices;
  options_.preview.published = [&](const BuildPreview& preview) {
    slices.push_back(Pyramid(preview.path).spec().voxels.z);
  };
  options_.preview.most_share = 1e-9;
  build();
  EXPECT_EQ(slices, (std::vector<std::int64_t>{32}));
}

TEST_F(PreviewOfABuildTest, AnInterruptedBuildLeavesNone) {
  CancelFlag cancel;
  options_.cancel = &cancel;
  options_.preview.published = [&](const BuildPreview& preview) {
    EXPECT_TRUE(fs::exists(preview.path));
    cancel.request();
  };
  EXPECT_THROW(build(), Cancelled);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

TEST_F(PreviewOfABuildTest, WhereThereCanBeNoneTheBuildGoesOn) {
  options_.preview.published = [&](const BuildPreview&) { ADD_FAILURE() << "a preview"; };
  options_.preview.folder = folder_.file("missing");
  build();
  options_.preview.folder = folder_.path();
  options_.preview.most_share = 0.0;
  build();
  options_.preview.most_share = 1.0;
  options_.memory_bytes = std::uint64_t{64} << 20;
  build();
  EXPECT_LT(farthestFromSphere(output_.file("sphere.isb")), 0.1);
  EXPECT_TRUE(fs::is_empty(folder_.path()));
}

}  // namespace
}  // namespace isobrick::test
