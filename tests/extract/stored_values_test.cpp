// Surfaces of volumes whose numbers no pyramid holds, and of values that float32 barely holds.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/value_fit.h"
#include "isobrick/storage/isovalue_suggestions.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr Index3 kBallVoxels(24, 23, 25);
constexpr double kBallRadius = 7.3;
const double kBallVolume = 4.0 / 3.0 * std::numbers::pi * std::pow(kBallRadius, 3);

// The distance from the surface of a ball, positive inside.
double ballDistance(const Index3& p) {
  return kBallRadius - glm::length(glm::dvec3(p) - glm::dvec3(11.6, 11.3, 12.2));
}

template <typename T, typename F>
std::vector<T> ballOf(F&& value) {
  return arrayOfField<T>(kBallVoxels, [&](const Index3& p) { return value(ballDistance(p)); });
}

template <typename T>
struct BuiltNumbers {
  VolumeInfo info;
  std::shared_ptr<const Pyramid> pyramid;
};

template <typename T>
BuiltNumbers<T> buildNumbers(const TemporaryFolder& folder, const std::vector<T>& numbers,
                             BuildOptions options = {}) {
  options.brick_cells = 8;
  const auto open = [&]() -> std::unique_ptr<VolumeSource> {
    return std::make_unique<ArraySource<T>>(kBallVoxels, numbers);
  };
  const auto source = withVoxels(open(), open);
  const std::string path = folder.file("numbers.isb");
  buildPyramid(*source, path, options);
  return {source->info(), std::make_shared<const Pyramid>(path)};
}

MeshReport surfaceAt(const Pyramid& pyramid, double isovalue) {
  Query query;
  query.isovalue = isovalue;
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return checkMesh(sink.mesh().positions, sink.mesh().triangles,
                   indexOptions(pyramid.spec().voxels));
}

void expectBall(const Pyramid& pyramid, double isovalue, double tolerance = 0.015) {
  const MeshReport report = surfaceAt(pyramid, isovalue);
  EXPECT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.components, 1);
  EXPECT_NEAR(report.volume, kBallVolume, tolerance * kBallVolume);
  const PyramidFaults faults = verifyPyramid(pyramid, {});
  EXPECT_TRUE(faults.rest.empty() && faults.bricks.empty());
}

std::string lastNote(const VolumeInfo& info) { return info.notes.empty() ? "" : info.notes.back(); }

TEST(StoredValues, DoublesFarFromZeroKeepTheirDifferences) {
  const TemporaryFolder folder;
  const auto [info, pyramid] =
      buildNumbers(folder, ballOf<double>([](double s) { return 101325 + 0.001 * s; }));
  EXPECT_EQ(info.voxel_type, VoxelType::kFloat32);
  EXPECT_EQ(pyramid->spec().values, (ValueTransform{1, 101325}));
  EXPECT_NE(lastNote(info).find("by at most"), std::string::npos) << lastNote(info);
  expectBall(*pyramid, 101325);
  EXPECT_NEAR(pyramid->realRange().max, 101325.007, 1e-3);
  for (const IsovalueSuggestion& one : suggestIsovalues(*pyramid).values)
    EXPECT_NEAR(one.value, 101325, 0.03);
  std::vector<double> values(1);
  PyramidValues(*pyramid).evaluate(std::vector{glm::dvec3(11.6, 11.3, 12.2)}, {}, values);
  EXPECT_NEAR(values[0], 101325.007, 0.01);
}

// Most voxels have no data, and the mean of all lies between both.
TEST(StoredValues, AFillingFarAwayCostsTheDataNothing) {
  const TemporaryFolder folder;
  for (const double filling : {0.0, -1e30}) {
    const auto numbers =
        ballOf<double>([&](double s) { return s < -4 ? filling : 101325 + 0.001 * s; });
    const auto [info, pyramid] = buildNumbers(folder, numbers);
    SCOPED_TRACE(lastNote(info));
    expectBall(*pyramid, 101325);
  }
  // What is too large for float32 is no number that it could stand beside.
  const auto numbers = ballOf<double>([&](double s) { return s < -4 ? -1e300 : 1e5 + 1e-3 * s; });
  EXPECT_THROW(buildNumbers(folder, numbers), Error);
  BuildOptions options;
  options.nan_as = 99999;
  expectBall(*buildNumbers(folder, numbers, options).pyramid, 1e5);
}

TEST(StoredValues, TinyNumbersAreScaled) {
  const TemporaryFolder folder;
  const auto [info, pyramid] =
      buildNumbers(folder, ballOf<double>([](double s) { return 1e-200 * s; }));
  expectBall(*pyramid, 0);
  EXPECT_NEAR(pyramid->realRange().max, 7e-200, 0.5e-200);
}

TEST(StoredValues, IntegersWhoseRangeFitsSixteenBitsAreStoredSo) {
  const TemporaryFolder folder;
  {
    const auto [info, pyramid] = buildNumbers(
        folder, ballOf<std::int32_t>([](double s) { return 1700000000 + std::lround(10 * s); }));
    EXPECT_EQ(info.voxel_type, VoxelType::kUint8);
    EXPECT_NE(lastNote(info).find("no value changed"), std::string::npos) << lastNote(info);
    expectBall(*pyramid, 1700000000, 0.05);
    EXPECT_NEAR(pyramid->realRange().max, 1700000070, 4);
  }
  {  // a CT
    const auto [info, pyramid] =
        buildNumbers(folder, ballOf<std::int32_t>([](double s) { return std::lround(100 * s); }));
    EXPECT_EQ(info.voxel_type, VoxelType::kInt16);
    EXPECT_TRUE(info.values.isIdentity());
    expectBall(*pyramid, 0.5);
  }
  {
    const auto [info, pyramid] = buildNumbers(
        folder, ballOf<std::uint64_t>([](double s) {
          return (std::uint64_t{1} << 60) + static_cast<std::uint64_t>(std::lround(100 * s + 5000));
        }));
    EXPECT_EQ(info.voxel_type, VoxelType::kUint16);
    // Doubles of this size are 256 apart.
    expectBall(*pyramid, 0x1p60 + 5120, 0.7);
  }
}

TEST(StoredValues, IdsOneApartStayApart) {
  const TemporaryFolder folder;
  for (const std::int32_t id : {1 << 24, 2147483646, -2147483647}) {
    const auto [info, pyramid] =
        buildNumbers(folder, ballOf<std::int32_t>([&](double s) { return id + (s > 0 ? 1 : 0); }));
    const MeshReport report = surfaceAt(*pyramid, id + 0.5);
    EXPECT_NEAR(report.volume, kBallVolume, 0.05 * kBallVolume);
  }
}

// Floats have no two numbers of the one group, or of the other.
TEST(StoredValues, TheSurfaceBetweenTwoDistantGroupsIsThere) {
  const TemporaryFolder folder;
  for (const bool is_low_inside : {false, true}) {
    const auto [info, pyramid] = buildNumbers(
        folder, ballOf<std::uint64_t>([&](double s) {
          const auto small = static_cast<std::uint64_t>(std::lround(100 * std::abs(s)));
          return ((s > 0) != is_low_inside) ? (std::uint64_t{1} << 63) + 4096 * small
                                            : (std::uint64_t{1} << 20) + small;
        }));
    for (const double isovalue : {0x1p20 + 5000, 0x1p30, 0x1p50, 0x1p62, 0x1p63}) {
      const MeshReport report = surfaceAt(*pyramid, isovalue);
      EXPECT_TRUE(report.ok()) << report.summary();
      const double volume = std::abs(report.volume);
      EXPECT_GT(volume, 0.7 * kBallVolume) << isovalue << " " << lastNote(info);
      EXPECT_LT(volume, 1.4 * kBallVolume) << isovalue;
    }
  }
}

TEST(StoredValues, OthersBecomeFloatsAndWhatChangesIsCounted) {
  const TemporaryFolder folder;
  // 100,000 apart on one side; one of them beyond 2^24 steps from all others.
  auto numbers =
      ballOf<std::int64_t>([](double s) { return (std::int64_t{1} << 50) + std::lround(1e4 * s); });
  numbers.back() = -1;
  const auto [info, pyramid] = buildNumbers(folder, numbers);
  EXPECT_EQ(info.voxel_type, VoxelType::kFloat32);
  EXPECT_NE(lastNote(info).find("; 1 of 13800 values changed"), std::string::npos)
      << lastNote(info);
  // What floats hold is left alone.
  const auto plain = buildNumbers(
      folder, ballOf<double>([](double s) { return static_cast<double>(static_cast<float>(s)); }));
  EXPECT_TRUE(plain.info.values.isIdentity());
  EXPECT_NE(lastNote(plain.info).find("no value changed"), std::string::npos);
  expectBall(*plain.pyramid, 0);
}

// The choice, and with it the file, is the same for rows and boxes and any number of threads.
TEST(StoredValues, TheFileDependsOnTheNumbersAlone) {
  const TemporaryFolder folder;
  const auto numbers = ballOf<double>([](double s) { return 1e6 + 1e-3 * s * s; });
  std::string first;
  for (const int threads : {1, 4}) {
    tbb::task_arena(threads).execute([&] { buildNumbers(folder, numbers); });
    const std::string bytes = readBytes(folder.file("numbers.isb"));
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

TEST(StoredValues, NanIsReplacedByAValueOfTheInput) {
  const TemporaryFolder folder;
  auto numbers = ballOf<double>([](double s) { return 101325 + 0.001 * s; });
  numbers[5] = std::numeric_limits<double>::quiet_NaN();
  BuildOptions options;
  options.nan_as = 101324;
  const auto [info, pyramid] = buildNumbers(folder, numbers, options);
  EXPECT_NEAR(pyramid->realRange().min, 101324, 1e-3);
  expectBall(*pyramid, 101325);
  EXPECT_NE(pyramid->provenance().find("1 voxels that were not finite became 101324"),
            std::string::npos);
  // Without any it says nothing.
  numbers[5] = 101325;
  const auto without = buildNumbers(folder, numbers, options);
  EXPECT_EQ(without.pyramid->provenance().find("not finite"), std::string::npos);
}

// The difference of two such values is no float.
TEST(StoredValues, CrossingsBetweenTheGreatestFloatsAreHalfWay) {
  const TemporaryFolder folder;
  for (const float most : {3.4e38f, std::numeric_limits<float>::max(), 1.8e38f}) {
    const std::string path = buildField<float>(folder, kBallVoxels, [&](const glm::dvec3& p) {
      return ballDistance(Index3(p)) > 0 ? most : -most;
    });
    const Pyramid pyramid(path);
    const Pyramid ones(buildField<float>(
        folder, kBallVoxels,
        [&](const glm::dvec3& p) { return ballDistance(Index3(p)) > 0 ? 1 : -1; }, {}, {},
        "ones.isb"));
    std::optional<FocusSphere> focus;
    for (int round = 0; round < 2; ++round, focus = FocusSphere{glm::dvec3(8), 2}) {
      Query query;
      query.focus = focus;
      IndexedMeshSink sink, expected;
      extractIsosurface(pyramid, query, sink);
      extractIsosurface(ones, query, expected);
      ASSERT_EQ(sink.mesh().positions.size(), expected.mesh().positions.size());
      double furthest = 0;
      for (std::size_t i = 0; i < sink.mesh().positions.size(); ++i)
        furthest = std::max(furthest, static_cast<double>(glm::distance(
                                          sink.mesh().positions[i], expected.mesh().positions[i])));
      EXPECT_LT(furthest, 1e-3);
      EXPECT_TRUE(
          checkMesh(sink.mesh().positions, sink.mesh().triangles, indexOptions(kBallVoxels)).ok());
    }
    EXPECT_FALSE(suggestIsovalues(pyramid).values.empty());
    const PyramidFaults faults = verifyPyramid(pyramid, {});
    EXPECT_TRUE(faults.rest.empty() && faults.bricks.empty());
  }
}

}  // namespace
}  // namespace isobrick::test
