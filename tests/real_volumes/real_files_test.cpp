// The files of real scans as the readers deliver them.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/dicom_folder_tests.h"
#include "tests/support/test_paths.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

const fs::path kSharedData = sharedData();

INSTANTIATE_TEST_SUITE_P(Real, DicomFolder,
                         testing::Values(DicomSlices{
                             "VisibleHuman", 1600, Index3(512, 512, 1), 1599,
                             "1.2.826.0.1.3680043.2.1125.1.75064541463040.2005072610384286453",
                             [](int number) {
                               return readBytes(kSharedData / "vhf_head_ct" / "dicom" /
                                                ("vhf." + std::to_string(number) + ".dcm"));
                             }}),
                         testing::PrintToStringParamName());

class RealFiles : public VolumeFilesTest {};

TEST_F(RealFiles, HeadCtIsTheSameAsNrrdAndAsDicom) {
  const fs::path folder = kSharedData / "vhf_head_ct";
  const auto nrrd = openVolume((folder / "vhf_head.nrrd").string());
  const auto dicom = openVolume((folder / "dicom").string());
  for (const VolumeSource* source : {nrrd.get(), dicom.get()}) {
    EXPECT_EQ(source->info().voxels, Index3(512, 512, 234));
    EXPECT_EQ(source->info().voxel_type, VoxelType::kInt16);
    EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(1));
    EXPECT_EQ(source->info().geometry.direction, glm::dmat3(1));
  }
  EXPECT_EQ(dicom->info().geometry.origin, glm::dvec3(0, 0, 1500));
  EXPECT_EQ(dicom->info().format, "DICOM series");
  std::vector<std::int16_t> a(512 * 512), b(512 * 512);
  for (std::int64_t k = 0; k < 234; ++k) {
    nrrd->readRows(512 * k, 512, a.data());
    dicom->readRows(512 * k, 512, b.data());
    std::size_t different = 0;
    for (std::size_t i = 0; i < a.size(); ++i) different += a[i] != b[i] + 1024;
    ASSERT_EQ(different, 0u) << "slice " << k;
  }
}

TEST_F(RealFiles, ToothIsBigEndian) {
  const fs::path path = kSharedData / "tooth_u16be" / "tooth.nhdr";
  const auto source = openVolume(path.string());
  EXPECT_EQ(source->info().voxels, Index3(103, 94, 161));
  ASSERT_EQ(source->info().voxel_type, VoxelType::kUint16);
  const auto values = readVoxels<std::uint16_t>(*source, 10);
  EXPECT_EQ(*std::max_element(values.begin(), values.end()), 1300);
  const auto raw = openRawSource((kSharedData / "tooth_u16be" / "tooth.raw").string(),
                                 {Index3(103, 94, 161), "u16", true});
  EXPECT_EQ(readVoxels<std::uint16_t>(*raw, 7), values);
}

TEST_F(RealFiles, HeadsqHasItsSpacing) {
  const fs::path path = kSharedData / "headsq_quarter" / "headsq_quarter.mhd";
  const auto source = openVolume(path.string());
  EXPECT_EQ(source->info().voxels, Index3(64, 64, 93));
  EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(3.2, 3.2, 1.5));
  ASSERT_EQ(source->info().voxel_type, VoxelType::kUint16);
  EXPECT_EQ(bytesOfValues(readVoxels<std::uint16_t>(*source)),
            readBytes(path.parent_path() / "headsq_quarter_64x64x93_uint16_le.raw"));
}

TEST_F(RealFiles, NiftiSlopeIsAppliedAndTruncationIsFound) {
  const fs::path path = kSharedData / "mr_nifti" / "MR.nii.gz";
  const auto source = openVolume(path.string());
  EXPECT_EQ(source->info().voxels, Index3(160, 232, 160));
  EXPECT_NEAR(source->info().geometry.spacing.x, 1, 1e-6);
  EXPECT_NEAR(source->info().geometry.spacing.y, 0.898437, 1e-6);
  ASSERT_EQ(source->info().voxel_type, VoxelType::kFloat32);
  EXPECT_FALSE(source->info().notes.empty());
  const auto values = readVoxels<float>(*source, 160);
  constexpr double kSlope = 2.0078431372549;
  std::size_t off_grid = 0;
  double greatest = 0;
  for (const float v : values) {
    const double stored = static_cast<double>(v) / kSlope;
    off_grid += std::abs(stored - std::round(stored)) > 1e-3;
    greatest = std::max(greatest, stored);
  }
  EXPECT_EQ(off_grid, 0u);
  EXPECT_NEAR(greatest, 255, 1e-3);

  // ITK would fill the rest with zeros.
  const std::string bytes = readBytes(path);
  EXPECT_CONTAINS(
      errorOf([&] { openAndRead(write("cut.nii.gz", bytes.substr(0, bytes.size() / 2))); }),
      "cut short");
  std::string flipped = bytes;
  flipped[bytes.size() / 2] = static_cast<char>(flipped[bytes.size() / 2] ^ 0x10);
  EXPECT_CONTAINS(errorOf([&] { openAndRead(write("flipped.nii.gz", flipped)); }), "damaged");
}

TEST_F(RealFiles, HeadCtIsStreamedAndEqualsTheSeriesInOddPieces) {
  const fs::path folder = kSharedData / "vhf_head_ct";
  const auto nrrd = openVolume((folder / "vhf_head.nrrd").string());
  const auto dicom = openVolume((folder / "dicom").string());
  EXPECT_LE(nrrd->bufferBytes(), 400u << 10);
  std::vector<std::int16_t> a(512 * 777), b(a.size());
  constexpr std::int64_t kAll = 512 * 234;
  for (std::int64_t row = 0; row < kAll; row += 1500) {
    const std::int64_t count = std::min<std::int64_t>(777, kAll - row);
    nrrd->readRows(row, count, a.data());
    dicom->readRows(row, count, b.data());
    std::size_t different = 0;
    for (std::size_t i = 0; i < static_cast<std::size_t>(count) * 512; ++i)
      different += a[i] != b[i] + 1024;
    ASSERT_EQ(different, 0u) << row;
  }
}

TEST_F(RealFiles, PackedNiftiEqualsTheUnpackedOne) {
  const fs::path path = kSharedData / "mr_nifti" / "MR.nii.gz";
  const gzFile in = gzopen(path.c_str(), "rb");
  ASSERT_NE(in, nullptr);
  std::string bytes(160 * 232 * 160 + 352, '\0');
  EXPECT_EQ(gzread(in, bytes.data(), static_cast<unsigned>(bytes.size())),
            static_cast<int>(bytes.size()));
  gzclose(in);
  const auto plain = openVolume(write("MR.nii", bytes));
  const auto packed = openVolume(path.string());
  EXPECT_EQ(packed->info().notes, plain->info().notes);
  EXPECT_EQ(packed->info().geometry.origin, plain->info().geometry.origin);
  const auto values = readVoxels<float>(*packed, 7);
  EXPECT_EQ(readVoxels<float>(*plain, 3), values);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto stored = static_cast<unsigned char>(bytes[352 + i]);
    ASSERT_NEAR(values[i], stored * 2.0078431f, 1e-3);
  }
}

// The lowest and highest voxel, and how many are below 0.
std::tuple<float, float, double> surveyed(VolumeSource& source) {
  const auto values = readVoxels<float>(source);
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const auto inside = std::count_if(values.begin(), values.end(), [](float v) { return v < 0; });
  return {*low, *high, static_cast<double>(inside)};
}

TEST_F(RealFiles, ReadsARealFogVolume) {
  const fs::path path = kSharedData / "vdb/smoke.vdb";
  const auto source = openVdbSource(path.string());
  const auto [low, high, inside] = surveyed(*source);
  EXPECT_EQ(low, 0);
  EXPECT_GT(high, 0.5f);
}

TEST_F(RealFiles, ReadsARealLevelSetOfASphere) {
  const fs::path path = kSharedData / "vdb/sphere.vdb";
  const auto source = openVdbSource(path.string());
  const auto [low, high, inside] = surveyed(*source);
  EXPECT_LT(low, 0);
  EXPECT_GT(high, 0);
  // The outermost active voxel on the x axis says how far it is from the surface.
  const VolumeInfo& info = source->info();
  const double spacing = info.geometry.spacing.x;
  const Index3 middle = info.voxels / std::int64_t{2};
  float outside = 0;
  source->readBox({Index3(1, middle.y, middle.z), Index3(1)}, &outside);
  const double radius = static_cast<double>(middle.x - 1) * spacing - static_cast<double>(outside);
  const double volume = inside * spacing * spacing * spacing;
  EXPECT_NEAR(volume / (4.0 / 3 * glm::pi<double>() * std::pow(radius, 3)), 1, 0.01);
}

template <typename T>
void checkRealVolume(const fs::path& path, const Index3& voxels, double least, double greatest) {
  const auto source = openVtiSource(path.string());
  EXPECT_EQ(source->info().voxels, voxels);
  EXPECT_LE(source->bufferBytes(), 400u << 10);
  const auto values = readVoxels<T>(*source, 5);
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  EXPECT_NEAR(static_cast<double>(*low), least, 1e-5);
  EXPECT_NEAR(static_cast<double>(*high), greatest, 1e-5);
}

TEST_F(RealFiles, VtiVolumes) {
  checkRealVolume<std::uint8_t>(kSharedData / "engine" / "engine.vti", Index3(256, 256, 128), 0,
                                255);
  checkRealVolume<std::uint8_t>(kSharedData / "aneurism" / "aneurism.vti", Index3(256), 0, 255);
  checkRealVolume<float>(kSharedData / "fingers_f32" / "fingers.vti", Index3(64), 0, 110.95757294);
}

}  // namespace
}  // namespace isobrick
