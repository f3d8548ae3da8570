// Surfaces of volumes that have no pyramid, read once or in memory, against those of their
// pyramids.
#include "isobrick/extract/one_pass_surface.h"

#include <gtest/gtest.h>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/preprocess/brick_stream.h"
#include "isobrick/preprocess/kernels/sample_block.h"
#include "tests/extract/random_case.h"
#include "tests/support/file_bytes.h"
#include "tests/support/repetitions.h"
#include "tests/support/requirement.h"

namespace isobrick::test {
namespace {

// The same voxels box by box, in any order.
template <typename T>
class BoxedSource final : public VolumeSource {
 public:
  BoxedSource(const VolumeInfo& info, const std::vector<T>& values)
      : info_(info), values_(values) {}
  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return "boxes"; }
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    const auto all = SampleBlock<T>::dense(values_.data(), {Index3(0), info_.voxels});
    copyBox(all, box, static_cast<T*>(out), box);
  }

 private:
  const VolumeInfo info_;
  const std::vector<T>& values_;
};

std::string meshFile(const TemporaryFolder& folder,
                     const std::function<void(TriangleSink&)>& extract) {
  const std::string path = folder.file("mesh.ply");
  const auto sink = makeMeshFileSink(path, {});
  extract(*sink);
  return readBytes(path);
}

bool areEqual(const SurfaceMesh& a, const SurfaceMesh& b) {
  if (a.positions().size() != b.positions().size()) return false;
  for (std::size_t v = 0; v < a.positions().size(); ++v)
    if (a.worldPosition(v) != b.worldPosition(v) || a.normals()[v] != b.normals()[v]) return false;
  return std::ranges::equal(a.triangles(), b.triangles());
}

template <typename T>
void testCase(RandomCase& random) {
  const TemporaryFolder folder;
  GridGeometry geometry;
  if (random.chance(0.5)) geometry.spacing = {0.5, 1.25, 2};
  if (random.chance(0.3)) geometry.direction = glm::dmat3(-1, 0, 0, 0, 1, 0, 0, 0, 1);
  Index3 dims = random.chance(0.3) ? random.wideDims() : random.dims();
  if (random.chance(0.1)) dims = {66, 67, 135};
  std::vector<T> values = random.field<T>(dims);
  if (std::is_same_v<T, float> && random.chance(0.3))
    for (T& value : values) value = static_cast<T>(static_cast<double>(value) * 1e-20);
  const double scale = static_cast<double>(*std::max_element(values.begin(), values.end())) / 200;

  ArraySource<T> built(dims, values, geometry);
  const VolumeInfo info = built.info();
  buildPyramid(built, folder.file("case.isb"), {});
  const Pyramid pyramid(folder.file("case.isb"));
  Query query;
  query.isovalue = scale * std::round(random.real(20, 180));
  if (random.chance(0.3)) {
    const glm::dvec3 last(dims - Index3(1));
    query.box = QueryBox{last * 0.2 + 0.3, last * random.real(0.5, 1.2) + 1.0};
  }
  if (random.chance(0.2)) query.simplify = SimplifyOptions{random.real(0.2, 1.5), false, true};
  if (random.chance(0.5)) query.uniform_level = 0;
  query.cap = random.chance(0.3);
  const std::string wanted =
      meshFile(folder, [&](TriangleSink& sink) { extractIsosurface(pyramid, query, sink); });
  SurfaceMesh wanted_mesh, mesh;
  const ExtractionReport wanted_report = extractIsosurface(pyramid, query, wanted_mesh);

  // Read in order or in boxes, in windows of any size.
  for (const bool in_boxes : {false, true}) {
    BrickStreamOptions options;
    options.open = [&]() -> std::unique_ptr<VolumeSource> {
      if (in_boxes) return std::make_unique<BoxedSource<T>>(info, values);
      return std::make_unique<ArraySource<T>>(dims, values, geometry);
    };
    const auto slab =
        static_cast<std::uint64_t>(dims.x * dims.y * std::min<std::int64_t>(dims.z, 67)) *
        sizeof(T);
    options.memory_bytes = (random.chance(0.5) ? slab * 4 / 3 : slab * 4) + 8;
    if (in_boxes && random.chance(0.5))
      options.memory_bytes = 67 * 67 * 67 * sizeof(T) * 3 + 8;  // a brick at a time
    BrickStream stream(options);
    ASSERT_TRUE(stream.fits());
    EXPECT_EQ(stream.pyramid().spec().voxels, dims);
    const IndexBox bricks = finestBricksOf(stream.pyramid().layout(), query);
    ExtractionReport report;
    // Twice: a source that is read in order is opened anew.
    for (int time = 0; time < 2; ++time)
      EXPECT_EQ(meshFile(folder,
                         [&](TriangleSink& sink) {
                           OnePassSurface surface(stream.pyramid(), query, sink);
                           stream.run(bricks, [&](const IndexBox& some) { surface.mesh(some); });
                           report = surface.finish();
                         }),
                wanted);
    EXPECT_EQ(report.triangles, wanted_report.triangles);
    OnePassSurface surface(stream.pyramid(), query, mesh);
    stream.run(bricks, [&](const IndexBox& some) { surface.mesh(some); });
    surface.finish();
    EXPECT_TRUE(areEqual(mesh, wanted_mesh));
  }

  // Where it lies: rows with room between them, slices from the last to the first.
  const std::int64_t row = dims.x + 3, slice = row * dims.y + 5;
  std::vector<T> spread(static_cast<std::size_t>(slice * dims.z));
  for (std::int64_t z = 0; z < dims.z; ++z)
    for (std::int64_t y = 0; y < dims.y; ++y)
      std::copy_n(values.data() + (z * dims.y + y) * dims.x, dims.x,
                  spread.data() + (dims.z - 1 - z) * slice + y * row);
  const auto array = pyramidOfArray(info, {spread.data() + (dims.z - 1) * slice, row, -slice});
  EXPECT_EQ(meshFile(folder, [&](TriangleSink& sink) { extractIsosurface(*array, query, sink); }),
            wanted);
  EXPECT_EQ(extractIsosurface(*array, query, mesh).triangles, wanted_report.triangles);
  EXPECT_TRUE(areEqual(mesh, wanted_mesh));
}

TEST(OnePassSurface, IsThatOfThePyramid) {
  const int cases = repetitions(15);
  for (int n = 0; n < cases; ++n) {
    SCOPED_TRACE(n);
    RandomCase random(static_cast<std::uint32_t>(n));
    switch (n % 5) {
      case 0:
        testCase<std::uint8_t>(random);
        break;
      case 1:
        testCase<std::int8_t>(random);
        break;
      case 2:
        testCase<std::uint16_t>(random);
        break;
      case 3:
        testCase<std::int16_t>(random);
        break;
      default:
        testCase<float>(random);
    }
    if (testing::Test::HasFailure()) return;
  }
}

// Bricks of level 0 alone come in the order of the brick table, so that a stream can make them.
TEST(OnePassSurface, PlansOfLevel0AreInTheOrderOfTheTable) {
  const TemporaryFolder folder;
  RandomCase random(1);
  const Index3 dims(70, 60, 66);
  ArraySource<float> source(dims, random.field<float>(dims));
  BuildOptions build;
  build.brick_cells = 16;
  buildPyramid(source, folder.file("case.isb"), build);
  const Pyramid pyramid(folder.file("case.isb"));
  Query query;
  query.isovalue = 100;
  query.cull_by_ranges = false;
  const auto plan = Extractor(pyramid).plan(query);
  const Index3 all = pyramid.layout().bricks(0);
  ASSERT_EQ(plan.bricks().size(), static_cast<std::size_t>(elementCount(all)));
  for (std::size_t i = 0; i < plan.bricks().size(); ++i)
    EXPECT_EQ(linearIndex(plan.bricks()[i].brick, all), static_cast<std::int64_t>(i));
}

TEST(OnePassSurface, RefusesWhatLevel0CannotGive) {
  const std::vector<float> values(27, 1.0f);
  VolumeInfo info;
  info.voxels = Index3(3);
  info.voxel_type = VoxelType::kFloat32;
  info.source = "memory";
  const auto array = pyramidOfArray(info, {values.data(), 3, 9});
  SurfaceMesh mesh;
  Query query;
  query.uniform_level = 1;
  EXPECT_THROW(extractIsosurface(*array, query, mesh), Error);
  query.uniform_level.reset();
  query.focus = FocusSphere{{1, 1, 1}, 1};
  EXPECT_THROW(extractIsosurface(*array, query, mesh), Error);
  query.focus.reset();
  query.is_progressive = true;
  EXPECT_THROW(extractIsosurface(*array, query, mesh), Error);
  query.is_progressive = false;
  EXPECT_EQ(extractIsosurface(*array, query, mesh).triangles, 0u);  // all voxels are equal
}

TEST(OnePassSurface, RefusesVoxelsThatAreNotFinite) {
  std::vector<float> values(4 * 4 * 4, 1.0f);
  values[4 * 4 + 2] = std::numeric_limits<float>::quiet_NaN();
  VolumeInfo info;
  info.voxels = Index3(4);
  info.voxel_type = VoxelType::kFloat32;
  info.source = "memory";
  const auto expectRefused = [](const std::function<void()>& call) {
    try {
      call();
      FAIL() << "is not refused";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("(2,0,1)"), std::string::npos) << error.what();
    }
  };
  expectRefused([&] { pyramidOfArray(info, {values.data(), 4, 16}); });
  BrickStreamOptions options;
  options.open = [&] { return std::make_unique<ArraySource<float>>(Index3(4), values); };
  expectRefused([&] { BrickStream stream(options); });
}

TEST(OnePassSurface, SaysIfTheMemoryIsTooSmall) {
  const std::vector<std::uint8_t> values(20 * 20 * 20);
  BrickStreamOptions options;
  options.open = [&] { return std::make_unique<ArraySource<std::uint8_t>>(Index3(20), values); };
  options.memory_bytes = 8000;
  EXPECT_FALSE(BrickStream(options).fits());
  options.memory_bytes = 11000;
  EXPECT_TRUE(BrickStream(options).fits());
}

}  // namespace
}  // namespace isobrick::test
