// What MRC headers say.
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <string>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/mrc_file.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

class MrcSourceTest : public VolumeFilesTest {
 protected:
  template <typename T>
  std::string writeMrc(const MrcFile& file, const std::vector<T>& values) const {
    return write("map.mrc", file.header() + bytesOfValues(values, file.big_endian));
  }
};

TEST_F(MrcSourceTest, FloatsOfBothByteOrdersAreRead) {
  std::vector<float> values(24);
  for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<float>(i) - 7.5f;
  MrcFile file;
  for (const bool big_endian : {false, true}) {
    file.big_endian = big_endian;
    const auto source = openVolume(writeMrc(file, values));
    EXPECT_EQ(readVoxels<float>(*source), values);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(source->info().geometry.spacing[axis], (axis + 1) * 1e-6, 1e-12);
  }
}

// Crystallographers' maps have any axis first.
TEST_F(MrcSourceTest, AxesLieWhereTheHeaderSays) {
  MrcFile file;
  file.axes = {3, 1, 2};
  file.counts = {4, 2, 3};
  const auto source = openVolume(writeMrc(file, std::vector<float>(24, 1.5f)));
  const GridGeometry& geometry = source->info().geometry;
  EXPECT_EQ(source->info().voxels, Index3(4, 2, 3));
  EXPECT_EQ(geometry.direction[0], glm::dvec3(0, 0, 1));
  EXPECT_EQ(geometry.direction[1], glm::dvec3(1, 0, 0));
  EXPECT_EQ(geometry.direction[2], glm::dvec3(0, 1, 0));
  EXPECT_NEAR(geometry.spacing.x, 3e-6, 1e-12);
  EXPECT_NEAR(geometry.spacing.y, 1e-6, 1e-12);
  EXPECT_NEAR(geometry.spacing.z, 2e-6, 1e-12);
  file.axes = {1, 1, 2};
  EXPECT_CONTAINS(errorOf([&] { openVolume(writeMrc(file, std::vector<float>(24, 1.5f))); }),
                  "map.mrc");
}

TEST_F(MrcSourceTest, BytesHaveASignIfTheHeaderSaysSo) {
  std::vector<std::int8_t> values(24);
  for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<std::int8_t>(10 * i - 128);
  constexpr std::int32_t kImod = 1146047817;
  struct {
    std::int32_t version, stamp, flags;
    bool is_signed;
  } const cases[] = {{0, 0, 0, false},           {0, kImod, 0, false}, {0, kImod, 1, true},
                     {20140, 0, 0, true},        {20141, 0, 0, true},  {20140, kImod, 0, false},
                     {20141, kImod, 1 | 4, true}};
  for (const auto& [version, stamp, flags, is_signed] : cases) {
    MrcFile file;
    file.mode = 0;
    file.version = version;
    file.imod_stamp = stamp;
    file.imod_flags = flags;
    const auto source = openVolume(writeMrc(file, values));
    if (!is_signed) {
      EXPECT_EQ(source->info().voxel_type, VoxelType::kUint8) << version << " " << flags;
      continue;
    }
    ASSERT_EQ(source->info().voxel_type, VoxelType::kInt8) << version << " " << flags;
    EXPECT_EQ(readVoxels<std::int8_t>(*source), values);
  }
}

TEST_F(MrcSourceTest, ComplexNumbersAreTwoComponents) {
  std::vector<float> floats(48);
  std::vector<std::int16_t> shorts(48);
  for (std::size_t i = 0; i < 48; ++i)
    floats[i] = shorts[i] = static_cast<std::int16_t>(i % 2 == 0 ? 3 * i : 4 * (i - 1));
  MrcFile file;
  for (const std::int32_t mode : {3, 4}) {
    file.mode = mode;
    const std::string path = mode == 3 ? writeMrc(file, shorts) : writeMrc(file, floats);
    EXPECT_CONTAINS(errorOf([&] { openVolume(path); }), "2 values per voxel");
    OpenOptions options;
    options.component = {.magnitude = true};
    const auto source = openVolume(path, options);
    const auto magnitudes = readVoxels<float>(*source);
    for (std::size_t i = 0; i < 24; ++i)
      EXPECT_FLOAT_EQ(magnitudes[i], 10 * static_cast<float>(i)) << mode;
  }
}

TEST_F(MrcSourceTest, HalvesAndNumbersOfFourBitsAreRead) {
  MrcFile file;
  file.mode = 12;
  std::vector<std::uint16_t> halves(24, 0x3c00);  // 1
  halves[1] = 0xc100;                             // -2.5
  for (const bool big_endian : {false, true}) {
    file.big_endian = big_endian;
    const auto source = openVolume(writeMrc(file, halves));
    EXPECT_EQ(readVoxels<float>(*source)[0], 1);
    EXPECT_EQ(readVoxels<float>(*openVolume(pathOf("map.mrc")))[1], -2.5f);
  }
  file = {};
  file.mode = 101;
  file.counts = {3, 3, 4};  // a row takes two bytes
  std::vector<std::uint8_t> pairs(24);
  for (std::size_t i = 0; i < 24; ++i)
    pairs[i] = static_cast<std::uint8_t>(i % 2 == 0 ? 0x21 : 0xf3);
  const auto source = openVolume(writeMrc(file, pairs));
  const auto read = readVoxels<std::uint8_t>(*source);
  for (std::size_t i = 0; i < 36; ++i) EXPECT_EQ(read[i], 1 + i % 3);
}

TEST_F(MrcSourceTest, PackedMapsAreRead) {
  std::vector<float> values(24);
  for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<float>(i);
  const std::string bytes = MrcFile().header() + bytesOfValues(values);
  for (const char* name : {"a.map.gz", "a.mrc.gz", "A.MAP.GZ"})
    EXPECT_EQ(readVoxels<float>(*openVolume(write(name, deflated(bytes, true)))), values) << name;
  std::string old = bytes;  // before 2000 there was no word
  old.replace(208, 8, 8, '\0');
  EXPECT_EQ(readVoxels<float>(*openVolume(write("old.st", old))), values);
}

// Two volumes of two sections each.
TEST_F(MrcSourceTest, OneVolumeOfAStackIsTaken) {
  std::vector<float> values(24);
  for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<float>(i);
  MrcFile file;
  file.group = 401;
  file.samples = {2, 3, 2};
  const std::string path = writeMrc(file, values);
  EXPECT_CONTAINS(errorOf([&] { openVolume(path); }), "2 images, 0 to 1");
  OpenOptions options;
  options.image = 1;
  const auto source = openVolume(path, options);
  EXPECT_EQ(source->info().voxels, Index3(2, 3, 2));
  EXPECT_NEAR(source->info().geometry.spacing.z, 6e-6, 1e-12);
  EXPECT_EQ(readVoxels<float>(*source), std::vector<float>(values.begin() + 12, values.end()));
  file.samples = {2, 3, 3};
  EXPECT_CONTAINS(errorOf([&] { openVolume(writeMrc(file, values), options); }), "stack");
}

TEST_F(MrcSourceTest, TheOriginIsStatedOrTheFirstIndexInTheCell) {
  const std::vector<float> values(24, 1.5f);
  MrcFile file;
  file.starts = {1, -2, 3};
  const auto origin = [&] { return openVolume(writeMrc(file, values))->info().geometry.origin; };
  EXPECT_LT(glm::length(origin() - glm::dvec3(10, -40, 90) * 1e-7), 1e-12);
  file.axes = {3, 1, 2};  // the starts are those of columns, rows and sections
  file.counts = {4, 2, 3};
  EXPECT_LT(glm::length(origin() - glm::dvec3(-20, 60, 30) * 1e-7), 1e-12);
  file.origin = {7, 8, 9};  // along x, y and z
  EXPECT_LT(glm::length(origin() - glm::dvec3(7, 8, 9) * 1e-7), 1e-12);
}

TEST_F(MrcSourceTest, SkewedCellsAreRefusedWithTheFigure) {
  const std::vector<float> values(24, 1.5f);
  MrcFile file;
  for (const glm::vec3 angles : {glm::vec3(90, 110, 90), glm::vec3(90, 90, 120)}) {
    file.angles = {angles.x, angles.y, angles.z};
    EXPECT_CONTAINS(errorOf([&] { openVolume(writeMrc(file, values)); }), "right angles");
  }
  file.angles = {0, 0, 0};  // not stated
  EXPECT_NO_THROW(openVolume(writeMrc(file, values)));
}

TEST_F(MrcSourceTest, ModesOfOtherNumbersAndShortFilesAreRefused) {
  MrcFile file;
  for (const std::int32_t mode : {-1, 5, 7, 1 << 20}) {
    file.mode = mode;
    EXPECT_CONTAINS(errorOf([&] { openVolume(writeMrc(file, std::vector<float>(24, 1))); }),
                    "map.mrc");
  }
  file.mode = 2;
  EXPECT_CONTAINS(errorOf([&] { openVolume(writeMrc(file, std::vector<float>(23, 1))); }),
                  "map.mrc': it has 1116 bytes");
}

}  // namespace
}  // namespace isobrick
