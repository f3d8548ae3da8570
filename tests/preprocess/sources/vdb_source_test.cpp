// OpenVDB files, written here with OpenVDB, and files that must be refused.
#include <gtest/gtest.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <glm/gtc/constants.hpp>
#include <sstream>
#include <thread>
#include <tuple>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/volume_source.h"
#include "tests/support/command_test.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

// The active voxels of fogGrid().
const openvdb::Coord kFogMin(-3, 5, 100), kFogMax(8, 11, 117);

template <typename Grid>
typename Grid::Ptr fogGrid(const std::string& name = "fog") {
  openvdb::initialize();
  using Value = typename Grid::ValueType;
  auto grid = Grid::create(Value(0));
  auto to = grid->getAccessor();
  for (int z = kFogMin.z(); z <= kFogMax.z(); ++z)
    for (int y = kFogMin.y(); y <= kFogMax.y(); ++y)
      for (int x = kFogMin.x(); x <= kFogMax.x(); ++x)
        // Numbers that halves hold too.
        to.setValue({x, y, z}, static_cast<Value>((x * 7 + y * 13 + z * 29) % 101));
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  return grid;
}

// A ball of radius 10 around (1, 2, 3), its voxels 0.5 apart, its narrow band 3 voxels wide.
openvdb::FloatGrid::Ptr levelSetBall() {
  openvdb::initialize();
  auto grid = openvdb::createLevelSet<openvdb::FloatGrid>(0.5f, 3);
  auto to = grid->getAccessor();
  for (int z = -30; z <= 30; ++z)
    for (int y = -30; y <= 30; ++y)
      for (int x = -30; x <= 30; ++x) {
        const float distance = std::sqrt(static_cast<float>(x * x + y * y + z * z)) / 2 - 10;
        if (std::abs(distance) < 1.5f) to.setValue({x + 2, y + 4, z + 6}, distance);
      }
  openvdb::tools::signedFloodFill(grid->tree());
  return grid;
}

class VdbSourceTest : public VolumeFilesTest {
 protected:
  std::string writeGrids(const openvdb::GridCPtrVec& grids, const std::string& name = "test.vdb") {
    fs::remove(pathOf(name));
    openvdb::io::File(pathOf(name)).write(grids);
    return pathOf(name);
  }
  std::string message(const openvdb::GridCPtrVec& grids) {
    const std::string path = writeGrids(grids);
    const std::string text = errorOf([&] { openVdbSource(path); });
    EXPECT_CONTAINS(text, path);
    return text;
  }
};

// The source has the grid's facts and delivers its values, voxel by voxel.
template <typename Grid>
void checkVoxels(VolumeSource& source, const Grid& grid, const openvdb::Coord& first) {
  const Index3 n = source.info().voxels;
  const auto rows = readVoxels<typename Grid::ValueType>(source);
  ASSERT_TRUE(source.readsBoxes());
  const IndexBox box{Index3(1, 2, 3), n - Index3(2, 3, 3)};
  std::vector<typename Grid::ValueType> boxed(static_cast<std::size_t>(box.size()));
  source.readBox(box, boxed.data());
  auto from = grid.getConstAccessor();
  std::size_t at = 0, at_box = 0;
  for (std::int64_t z = 0; z < n.z; ++z)
    for (std::int64_t y = 0; y < n.y; ++y)
      for (std::int64_t x = 0; x < n.x; ++x) {
        const openvdb::Coord xyz =
            first.offsetBy(static_cast<int>(x), static_cast<int>(y), static_cast<int>(z));
        const auto expected = from.getValue(xyz);
        ASSERT_EQ(rows[at++], expected) << xyz;
        const Index3 index(x, y, z);
        if (glm::all(glm::greaterThanEqual(index, box.first)) &&
            glm::all(glm::lessThan(index, box.end()))) {
          ASSERT_EQ(boxed[at_box++], expected) << xyz;
        }
      }
}

template <typename Grid>
void checkFog(const std::string& path, const Grid& grid, std::size_t notes) {
  const auto source = openVdbSource(path);
  const VolumeInfo& info = source->info();
  EXPECT_EQ(info.voxels, Index3(14, 9, 20));
  EXPECT_EQ(info.voxel_type, voxelTypeOf<typename Grid::ValueType>());
  EXPECT_EQ(info.notes.size(), notes);
  EXPECT_EQ(source->files(), std::vector<std::string>{path});
  EXPECT_GT(source->bufferBytes(), 12u * 7 * 18 * 4);
  checkVoxels(*source, grid, kFogMin.offsetBy(-1));
}

TEST_F(VdbSourceTest, ReadsFogOfAllTypesWithTheBackgroundAroundIt) {
  const auto check = [&](auto grid, std::size_t notes) {
    checkFog(writeGrids({grid}), *grid, notes);
  };
  check(fogGrid<openvdb::FloatGrid>(), 0);
  check(fogGrid<openvdb::DoubleGrid>(), 0);
  check(fogGrid<openvdb::Int32Grid>(), 0);
  check(fogGrid<openvdb::Int64Grid>(), 0);
  auto half = fogGrid<openvdb::FloatGrid>();
  half->setSaveFloatAsHalf(true);
  check(half, 0);
}

TEST_F(VdbSourceTest, ReadsAllCompressionsAndStreamsWithoutOffsets) {
  using namespace openvdb::io;
  const auto grid = fogGrid<openvdb::FloatGrid>();
  const auto mask = openvdb::MaskGrid::create();
  for (const std::uint32_t flags : {std::uint32_t{COMPRESS_NONE}, std::uint32_t{COMPRESS_ZIP},
                                    std::uint32_t{COMPRESS_BLOSC | COMPRESS_ACTIVE_MASK}}) {
    File file(pathOf("packed.vdb"));
    file.setCompression(flags);
    file.write({grid});
    checkFog(pathOf("packed.vdb"), *grid, 0);
  }
  std::ostringstream out;
  Stream(out).write({mask, grid});
  checkFog(write("streamed.vdb", out.str()), *grid, 1);
}

TEST_F(VdbSourceTest, ReadsALevelSetWithItsInsideAndByManyThreads) {
  const auto sphere = levelSetBall();
  const auto source = openVdbSource(writeGrids({sphere}));
  const VolumeInfo& info = source->info();
  ASSERT_EQ(info.notes.size(), 1u);
  EXPECT_CONTAINS(info.notes[0], "negative inside");
  const auto box = sphere->evalActiveVoxelBoundingBox();
  checkVoxels(*source, *sphere, box.min().offsetBy(-1));
  EXPECT_EQ(info.geometry.spacing, glm::dvec3(0.5));

  // The box around the middle is inside throughout.
  std::vector<std::thread> threads;
  std::vector<std::vector<float>> read(4, std::vector<float>(1000));
  for (auto& values : read)
    threads.emplace_back([&source, &info, &values] {
      source->readBox({info.voxels / std::int64_t{2} - Index3(5), Index3(10)}, values.data());
    });
  for (std::thread& thread : threads) thread.join();
  for (const auto& values : read)
    for (const float value : values) ASSERT_EQ(value, -1.5f);
}

TEST_F(VdbSourceTest, AppliesLinearTransforms) {
  const auto check = [&](const openvdb::math::Transform::Ptr& transform) {
    const auto grid = fogGrid<openvdb::FloatGrid>();
    grid->setTransform(transform);
    const auto source = openVdbSource(writeGrids({grid}));
    const GridGeometry& g = source->info().geometry;
    for (const glm::dvec3 index : {glm::dvec3(0), glm::dvec3(13, 0, 0), glm::dvec3(4, 8, 19)}) {
      const auto expected = transform->indexToWorld(openvdb::Vec3d(index.x, index.y, index.z) +
                                                    kFogMin.offsetBy(-1).asVec3d());
      const glm::dvec3 world = g.origin + g.direction * (g.spacing * index);
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(world[axis], expected[axis], 1e-9) << *transform;
    }
  };
  using openvdb::math::Transform;
  check(Transform::createLinearTransform(0.25));
  auto moved = Transform::createLinearTransform(2.0);
  moved->postTranslate({-7, 0.125, 1000});
  check(moved);
  auto turned = Transform::createLinearTransform(1.0);
  turned->preScale(openvdb::Vec3d(0.5, 2, 3));
  turned->postRotate(0.7, openvdb::math::X_AXIS);
  turned->postRotate(-1.1, openvdb::math::Z_AXIS);
  turned->postTranslate({1, 2, 3});
  check(turned);
  auto mirrored = Transform::createLinearTransform(1.0);
  mirrored->preScale(openvdb::Vec3d(1, -2, 1));
  check(mirrored);
}

TEST_F(VdbSourceTest, TakesTheFirstFloatGridAndNamesIt) {
  const auto grid = fogGrid<openvdb::FloatGrid>("smoke\n1");
  auto other = openvdb::FloatGrid::create(1.0f);
  other->setName("other");
  const auto counts = fogGrid<openvdb::Int32Grid>("counts");
  auto vectors = openvdb::Vec3SGrid::create();
  vectors->setName("vel");
  const auto path = writeGrids({vectors, counts, grid, other});
  checkFog(path, *grid, 1);
  EXPECT_CONTAINS(openVdbSource(path)->info().notes[0], "of 4 grids, 'smoke 1' was taken");
  const auto source = openVdbSource(writeGrids({vectors, counts}));
  ASSERT_EQ(source->info().notes.size(), 1u);
  EXPECT_CONTAINS(source->info().notes[0], "'counts'");
}

TEST_F(VdbSourceTest, ReadsAGridThatSharesItsTree) {
  const auto first = fogGrid<openvdb::FloatGrid>("first");
  auto second = first->copy();  // shallow
  second->setName("second");
  second->setTransform(openvdb::math::Transform::createLinearTransform(0.5));
  checkFog(writeGrids({first, second}), *first, 1);
}

TEST_F(VdbSourceTest, BoolsAndMasksBecomeZerosAndOnes) {
  openvdb::initialize();
  const auto check = [&](const auto& grid) {
    const auto source = openVdbSource(writeGrids({grid}));
    ASSERT_EQ(source->info().voxel_type, VoxelType::kUint8);
    ASSERT_EQ(source->info().voxels, Index3(14, 9, 20));
    const auto found = readVoxels<std::uint8_t>(*source);
    auto from = grid->getConstAccessor();
    for (std::size_t i = 0; i < found.size(); ++i) {
      const auto at = static_cast<int>(i);
      const openvdb::Coord xyz = kFogMin.offsetBy(at % 14 - 1, at / 14 % 9 - 1, at / (14 * 9) - 1);
      ASSERT_EQ(found[i], from.getValue(xyz) ? 1 : 0) << xyz;
    }
  };
  check(fogGrid<openvdb::BoolGrid>());
  auto mask = openvdb::MaskGrid::create();
  auto to = mask->getAccessor();
  for (int y = kFogMin.y(); y <= kFogMax.y(); ++y)
    for (int x = kFogMin.x(); x <= kFogMax.x(); ++x) {
      to.setValueOn({x, y, kFogMin.z()});
      to.setValueOn({x, y, kFogMax.z()});
    }
  check(mask);
}

TEST_F(VdbSourceTest, AGridIsChosenByItsName) {
  const std::string path =
      writeGrids({fogGrid<openvdb::FloatGrid>("smoke"), fogGrid<openvdb::Int32Grid>("fire")});
  EXPECT_CONTAINS(openVdbSource(path)->info().notes[0], "the others are 'fire' (int32)");
  OpenOptions options;
  options.grid = "fire";
  const auto source = openVdbSource(path, options);
  EXPECT_EQ(source->info().properties.at("vdb.name"), "fire");
  EXPECT_EQ(source->info().properties.at("vdb.class"), "fog volume");
  EXPECT_EQ(source->info().properties.at("vdb.first"), "-4,4,99");
  options.grid = "water";
  EXPECT_CONTAINS(errorOf([&] { openVdbSource(path, options); }),
                  "'smoke' (float), 'fire' (int32)");
}

TEST_F(VdbSourceTest, GridsOfOneNameAreCounted) {
  const auto first = fogGrid<openvdb::FloatGrid>("smoke"), second = first->deepCopy();
  second->tree().setValue(openvdb::Coord(0, 8, 103), 77);
  const std::string path = writeGrids({fogGrid<openvdb::Int32Grid>("fire"), first, second});
  EXPECT_CONTAINS(openVdbSource(path)->info().notes[0], "'smoke[0]' was taken");
  const auto open = [&](const std::string& name) {
    OpenOptions options;
    options.grid = name;
    return openVdbSource(path, options);
  };
  checkVoxels(*open("smoke"), *first, kFogMin.offsetBy(-1));
  checkVoxels(*open("smoke[0]"), *first, kFogMin.offsetBy(-1));
  checkVoxels(*open("smoke[1]"), *second, kFogMin.offsetBy(-1));
  EXPECT_CONTAINS(errorOf([&] { open("smoke[2]"); }), "'smoke[0]' (float), 'smoke[1]' (float)");
}

TEST_F(VdbSourceTest, AGridLargerThanMemoryIsReadSlabBySlab) {
  const auto check = [&](const auto& grid, std::uint32_t packing = openvdb::io::COMPRESS_NONE) {
    // Behind another grid, so that nothing is where a file begins.
    const std::string path = pathOf("slabs.vdb");
    openvdb::io::File file(path);
    file.setCompression(packing);
    file.write({openvdb::Vec3SGrid::create(), grid});
    const auto whole = openVdbSource(path);
    OpenOptions options;
    options.memory_bytes = 1;
    const auto slabs = openVdbSource(path, options);
    EXPECT_TRUE(whole->readsBoxes());
    EXPECT_FALSE(slabs->readsBoxes());
    EXPECT_EQ(slabs->info().voxels, whole->info().voxels);
    using Value = typename std::decay_t<decltype(*grid)>::ValueType;
    EXPECT_EQ(readVoxels<Value>(*slabs), readVoxels<Value>(*whole));
  };
  check(fogGrid<openvdb::DoubleGrid>());
  using namespace openvdb::io;
  for (const std::uint32_t packing :
       {std::uint32_t{COMPRESS_NONE}, std::uint32_t{COMPRESS_ZIP}, std::uint32_t{COMPRESS_BLOSC},
        std::uint32_t{COMPRESS_ACTIVE_MASK}, std::uint32_t{COMPRESS_BLOSC | COMPRESS_ACTIVE_MASK}})
    for (const bool is_half : {false, true}) {
      SCOPED_TRACE(std::to_string(packing) + (is_half ? " half" : ""));
      const auto fog = fogGrid<openvdb::FloatGrid>(), ball = levelSetBall();
      fog->setSaveFloatAsHalf(is_half);
      ball->setSaveFloatAsHalf(is_half);
      check(fog, packing);
      check(ball, packing);
    }
}

// Tiles of every level, active and not, beside leaves of several nodes, in slabs of every height.
TEST_F(VdbSourceTest, SlabsHaveTheTilesOfEveryLevel) {
  openvdb::initialize();
  const auto grid = openvdb::FloatGrid::create(0.5f);
  auto& tree = grid->tree();
  using openvdb::Coord;
  for (int i = 0; i < 40000; ++i)
    tree.setValue({i * 11 % 217 - 20, i * 5 % 26 + 4070, i * 29 % 83 - 20}, static_cast<float>(i));
  tree.addTile(1, {8, 4080, 8}, 2.0f, true);
  tree.addTile(1, {-16, 4072, -16}, -3.0f, false);
  tree.addTile(2, {-128, 4096, -128}, -5.0f, false);
  tree.addTile(3, {0, 4096, 0}, -6.0f, false);
  tree.setValue({-5, 4119, 59}, 7.0f);
  const std::string path = writeGrids({grid});
  const auto whole = openVdbSource(path);
  ASSERT_EQ(whole->info().voxels, Index3(219, 52, 85));
  const auto expected = readVoxels<float>(*whole);
  // A slice, a layer of leaves, and several at a time.
  tbb::task_arena(1).execute([&] {
    for (const std::uint64_t memory :
         {std::uint64_t{1}, std::uint64_t{1500000}, std::uint64_t{2200000}}) {
      OpenOptions options;
      options.memory_bytes = memory;
      const auto slabs = openVdbSource(path, options);
      EXPECT_FALSE(slabs->readsBoxes());
      EXPECT_TRUE(readVoxels<float>(*slabs) == expected) << memory;
    }
  });
}

TEST_F(VdbSourceTest, RefusesWhatItCannotUseWithOneLine) {
  openvdb::initialize();
  EXPECT_CONTAINS(message({}), "no grids");
  EXPECT_CONTAINS(message({openvdb::FloatGrid::create(1.0f)}), "no active voxels");
  EXPECT_CONTAINS(message({openvdb::MaskGrid::create()}), "no active voxels");
  auto flow = openvdb::Vec3SGrid::create();
  flow->setName("flow");
  EXPECT_CONTAINS(message({flow}), "'flow', is of the type 'vec3s'");

  auto grid = fogGrid<openvdb::FloatGrid>();
  grid->setTransform(openvdb::math::Transform::createFrustumTransform(
      openvdb::BBoxd(openvdb::Vec3d(0), openvdb::Vec3d(100)), 0.5, 10, 1));
  EXPECT_CONTAINS(message({grid}), "frustum");
  auto sheared = openvdb::math::Transform::createLinearTransform(1.0);
  sheared->preShear(0.5, openvdb::math::X_AXIS, openvdb::math::Y_AXIS);
  grid->setTransform(sheared);
  EXPECT_CONTAINS(message({grid}), "right angles");

  auto wide = openvdb::FloatGrid::create(0.0f);
  wide->tree().setValue({0, 0, 0}, 1.0f);
  wide->tree().setValue({1 << 20, 0, 0}, 1.0f);
  EXPECT_CONTAINS(message({wide}), "at most");
  wide->tree().setValue({std::numeric_limits<int>::max(), 0, 0}, 1.0f);
  wide->tree().setValue({std::numeric_limits<int>::min(), 0, 0}, 1.0f);
  EXPECT_CONTAINS(message({wide}), "at most");
  auto corner = openvdb::FloatGrid::create(0.0f);
  corner->tree().setValue(openvdb::Coord::max(), 1.0f);
  EXPECT_CONTAINS(message({corner}), "32-bit");
  errorOf([&] { openVdbSource(pathOf("missing.vdb")); });
  EXPECT_CONTAINS(errorOf([&] { openVdbSource(write("x.vdb", "not a grid at all")); }), "VDB");
  errorOf([&] { openVdbSource(write("x.vdb", std::string(5000, '\0'))); });
}

TEST_F(VdbSourceTest, RefusesFilesThatAreCutShortAndSaysSoItself) {
  const std::string bytes = readBytes(writeGrids({fogGrid<openvdb::FloatGrid>()}));
  std::ostringstream out;
  openvdb::io::Stream(out).write({fogGrid<openvdb::DoubleGrid>()});
  testing::internal::CaptureStderr();
  for (const std::string& whole : {bytes, out.str()})
    for (std::size_t size = 0; size < whole.size(); size += size < 1000 ? 1 : 97) {
      const std::string path = write("cut.vdb", whole.substr(0, size));
      EXPECT_CONTAINS(errorOf([&] { openVdbSource(path); }), path);
    }
  std::string newer = bytes;
  newer[8] = '\x7f';  // the format's version
  EXPECT_CONTAINS(errorOf([&] { openVdbSource(write("newer.vdb", newer)); }), "newer");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// The command as a whole, upper case and all.
class VdbCommandTest : public CommandTest {};
TEST_F(VdbCommandTest, BuildsPyramidsOfBothWhoseSurfacesAreClosed) {
  const auto grid = fogGrid<openvdb::FloatGrid>();
  openvdb::io::File(path("fog.VDB")).write({grid});
  const auto sphere = levelSetBall();
  openvdb::io::File(path("ball.vdb")).write({sphere});
  runWell({"build", "fog.VDB"});
  runWell({"build", "ball.vdb"});
  for (const auto& [name, iso] : {std::pair("fog", "0.5"), std::pair("ball", "0")}) {
    const std::string stem = name;
    runWell({"verify", stem + ".isb"});
    runWell({"extract", stem + ".isb", "--iso", iso, "-o", stem + ".ply"});
    EXPECT_GT(fs::file_size(path(stem + ".ply")), 10'000u);
  }
}

}  // namespace
}  // namespace isobrick
