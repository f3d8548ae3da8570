// Volumes written in every format and read back: voxels, type, spacing, origin, direction.
#include "isobrick/preprocess/export/formats/export_volume.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>
#include <tiffio.h>

#include <cmath>
#include <filesystem>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat4x4.hpp>
#include <limits>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/array_source.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

// Odd and different along every axis.
constexpr Index3 kWildVoxels(19, 7, 13);
constexpr std::uint64_t kBudget = 1 << 20;

// A rotation about no axis of the grid, numbers that no decimal has, and with `flips` the other
// handedness.
GridGeometry obliqueGeometry(bool flips = false) {
  GridGeometry geometry;
  geometry.direction =
      glm::dmat3(glm::rotate(glm::dmat4(1.0), 0.7, glm::normalize(glm::dvec3(1, -2, 3))));
  if (flips) geometry.direction[2] *= -1.0;
  geometry.spacing = {0.7, 1.0 / 3, 2.5};
  geometry.origin = {-101.3, 17.77, 1e3 / 7};
  return geometry;
}

// All over the type's numbers, its least and greatest among them.
template <typename T>
std::vector<T> wildValues(const Index3& voxels = kWildVoxels) {
  std::vector<T> values;
  std::uint64_t state = 1;
  for (std::int64_t i = 0; i < elementCount(voxels); ++i) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    if constexpr (std::is_same_v<T, float>)
      values.push_back(std::ldexp(static_cast<float>(state >> 40) - 8e6f,
                                  static_cast<int>(state >> 20 & 31) - 16));
    else
      values.push_back(static_cast<T>(state >> 33));
  }
  values[1] = std::numeric_limits<T>::lowest();
  values[2] = std::numeric_limits<T>::max();
  return values;
}

struct Format {
  const char* name;
  double geometry_tolerance;  // relative
};
// Those that keep all types and every geometry.
const Format kFormats[] = {{"volume.nrrd", 1e-12},     {"volume.mhd", 1e-12},
                           {"volume.mha", 1e-12},      {"volume.vti", 1e-12},
                           {"volume.nii", 1e-6},       {"volume.nii.gz", 1e-6},
                           {"volume.ome.zarr", 1e-12}, {"volume.h5", 1e-12}};

void expectGeometry(const GridGeometry& found, const GridGeometry& expected, double tolerance) {
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(found.spacing[axis], expected.spacing[axis], tolerance);
    EXPECT_NEAR(found.origin[axis], expected.origin[axis], 300 * tolerance);
    for (int row = 0; row < 3; ++row)
      EXPECT_NEAR(found.direction[axis][row], expected.direction[axis][row], tolerance);
  }
}

class ExportVolumeTest : public VolumeFilesTest {
 protected:
  template <typename T>
  VolumeWriteReport write(const std::string& name, const std::vector<T>& values,
                          const GridGeometry& geometry, const ExportOptions& options = {}) {
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<T>>(kWildVoxels, values, geometry));
    return exportVolume(levels, pathOf(name), options);
  }

  template <typename T>
  void checkRoundTrip(const Format& format, const GridGeometry& geometry, std::uint64_t memory) {
    SCOPED_TRACE(format.name + std::string(" of ") + std::string(voxelTypeName(voxelTypeOf<T>())));
    const std::vector<T> values = wildValues<T>();
    ExportOptions options;
    options.memory_bytes = memory;
    write(format.name, values, geometry, options);
    const auto source = openVolume(pathOf(format.name));
    ASSERT_EQ(source->info().voxels, kWildVoxels);
    ASSERT_EQ(source->info().voxel_type, voxelTypeOf<T>());
    expectGeometry(source->info().geometry, geometry, format.geometry_tolerance);
    EXPECT_EQ(readVoxels<T>(*source), values);
  }

  template <typename T>
  void checkRoundTrips() {
    for (const Format& format : kFormats)
      for (const bool flips : {false, true})
        checkRoundTrip<T>(format, obliqueGeometry(flips), flips ? 100 : 1 << 20);
  }
};

TEST_F(ExportVolumeTest, EveryFormatKeepsVoxelsAndAnObliqueGeometry) {
  checkRoundTrips<std::uint8_t>();
  checkRoundTrips<std::int8_t>();
  checkRoundTrips<std::uint16_t>();
  checkRoundTrips<std::int16_t>();
  checkRoundTrips<float>();
}

// Two chunks along x and y, three along z; in shards of one and of eight chunks, some beyond the
// volume.
TEST_F(ExportVolumeTest, OmeZarrIsTheSameVolumeInBothVersionsAndInShardsOfAnySize) {
  const Index3 voxels(100, 65, 130);
  const auto values = wildValues<std::uint16_t>(voxels);
  const auto write = [&](const std::string& name, int version, std::int64_t shard) {
    VolumeLevels levels;
    levels.push_back(
        std::make_unique<ArraySource<std::uint16_t>>(voxels, values, obliqueGeometry()));
    ExportOptions options;
    options.zarr_version = version;
    options.zarr_shard = shard;
    const VolumeWriteReport report = exportVolume(levels, pathOf(name), options);
    std::uint64_t bytes = 0, files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(pathOf(name)))
      if (entry.is_regular_file()) {
        bytes += entry.file_size();
        ++files;
      }
    EXPECT_EQ(report.bytes, bytes) << name;
    const auto source = openVolume(pathOf(name));
    expectGeometry(source->info().geometry, obliqueGeometry(), 1e-12);
    EXPECT_EQ(readVoxels<std::uint16_t>(*source, 9), values) << name;
    return files;
  };
  EXPECT_EQ(write("one.zarr", 3, 512), 2u + 1);
  EXPECT_EQ(write("two.zarr", 3, 128), 2u + 2);
  EXPECT_EQ(write("twelve.zarr", 3, 64), 2u + 12);
  EXPECT_EQ(write("chunks.zarr", 2, 512), 3u + 12);
}

TEST_F(ExportVolumeTest, WhatAFormatLosesIsSaid) {
  const auto values = wildValues<std::uint8_t>();
  EXPECT_TRUE(write("a.nrrd", values, obliqueGeometry()).lost.empty());
  EXPECT_EQ(write("a.nrrd", values, obliqueGeometry()).space, "LPS");
  const VolumeWriteReport nifti = write("a.nii", values, obliqueGeometry());
  EXPECT_EQ(nifti.space, "RAS");
  ASSERT_EQ(nifti.lost.size(), 1u);
  EXPECT_CONTAINS(nifti.lost[0], "single precision");
  EXPECT_TRUE(write("a.nii", values, {}).lost.empty());
  const VolumeWriteReport raw = write("a.raw", values, {});
  ASSERT_EQ(raw.lost.size(), 1u);
  EXPECT_CONTAINS(raw.lost[0], "voxels 19,7,13 of type u8");
  EXPECT_EQ(raw.bytes, 19u * 7 * 13);
}

TEST_F(ExportVolumeTest, NiftiRefusesMoreVoxelsThanItsHeaderCounts) {
  const Index3 voxels(40000, 2, 2);
  VolumeLevels levels;
  levels.push_back(std::make_unique<ArraySource<std::uint8_t>>(
      voxels, std::vector<std::uint8_t>(static_cast<std::size_t>(elementCount(voxels)))));
  EXPECT_CONTAINS(errorOf([&] { exportVolume(levels, pathOf("a.nii"), {}); }), "32767");
  EXPECT_EQ(filesLeft(), 0u);
}

TEST_F(ExportVolumeTest, NothingIsPublishedWhereTheInputChangedMeanwhile) {
  ExportOptions options;
  options.before_publishing = [] { throw Error("it changed"); };
  for (const Format& format : kFormats)
    EXPECT_CONTAINS(errorOf([&] { write(format.name, wildValues<std::uint8_t>(), {}, options); }),
                    "changed");
  EXPECT_EQ(filesLeft(), 0u);
}

// ---- OpenVDB ------------------------------------------------------------------------------------

template <typename T>
void checkVdb(const std::string& path, VolumeWriteReport report, const std::vector<T>& values,
              const GridGeometry& geometry) {
  EXPECT_EQ(report.lost.empty(), (std::is_same_v<T, float>));
  const auto source = openVolume(path);
  ASSERT_EQ(source->info().voxels, kWildVoxels);
  expectGeometry(source->info().geometry, geometry, 1e-12);
  EXPECT_EQ(readVoxels<float>(*source), std::vector<float>(values.begin(), values.end()));
}

TEST_F(ExportVolumeTest, OpenVdbKeepsValuesAsFloatsAndTheInactiveRim) {
  const GridGeometry geometry = obliqueGeometry(true);
  ExportOptions options;
  options.memory_bytes = std::uint64_t{64} << 20;
  const auto check = [&](auto values) {
    // Nothing on one side, a constant block, and the rest as it comes.
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (i % 19 < 3) values[i] = 0;
      if (i % 19 >= 10 && i / (19 * 7) < 9) values[i] = 5;
    }
    checkVdb(pathOf("a.vdb"), write("a.vdb", values, geometry, options), values, geometry);
  };
  check(wildValues<std::uint8_t>());
  check(wildValues<std::int8_t>());
  check(wildValues<std::uint16_t>());
  check(wildValues<std::int16_t>());
  check(wildValues<float>());
}

TEST_F(ExportVolumeTest, OpenVdbStoresWhatDiffersFromTheBackground) {
  std::vector<float> values(static_cast<std::size_t>(elementCount(kWildVoxels)), 100.0f);
  values[7] = 100.5f;
  values[500] = 103;
  ExportOptions options;
  options.memory_bytes = std::uint64_t{64} << 20;
  options.vdb_background = 100.0f;
  options.vdb_tolerance = 1;
  const VolumeWriteReport report = write("a.vdb", values, {}, options);
  ASSERT_EQ(report.lost.size(), 1u);
  EXPECT_CONTAINS(report.lost[0], "tolerance");
  values[7] = 100;
  const auto source = openVolume(pathOf("a.vdb"));
  EXPECT_EQ(source->info().properties.at("vdb.background"), "100");
  EXPECT_EQ(readVoxels<float>(*source), values);
}

// Several of the boxes that are read and packed at a time, which no axis of the grid is in line
// with: full, empty, constant and single voxels, with any number of threads.
TEST_F(ExportVolumeTest, OpenVdbOfManyNodesIsTheSameWithAnyThreads) {
  const Index3 voxels(290, 131, 137);
  const auto check = [&](auto first_value) {
    using T = decltype(first_value);
    const auto values = arrayOfField<T>(voxels, [&](const Index3& at) -> T {
      if (at.x < 150 && at.y < 70) return 0;
      if (at.z > 100) return first_value;
      if (at.x > 200) return at == Index3(250, 99, 50) ? T(9) : T(0);
      return static_cast<T>((at.x * 7919 + at.y * 104729 + at.z * 1299709) % 251 - 100);
    });
    for (const int threads : {1, 3}) {
      VolumeLevels levels;
      auto source = std::make_unique<ArraySource<T>>(voxels, values);
      source->editInfo().properties["vdb.first"] = "-100,-200,77";
      levels.push_back(std::move(source));
      ExportOptions options;
      options.memory_bytes = std::uint64_t{100} << 20;
      tbb::task_arena(threads).execute([&] { exportVolume(levels, pathOf("many.vdb"), options); });
      const auto back = openVolume(pathOf("many.vdb"));
      ASSERT_EQ(back->info().voxels, voxels);
      EXPECT_EQ(back->info().properties.at("vdb.first"), "-100,-200,77");
      const auto found = readVoxels<float>(*back);
      EXPECT_TRUE(std::equal(found.begin(), found.end(), values.begin(), values.end()))
          << voxelTypeName(voxelTypeOf<T>()) << " with " << threads << " threads";
    }
  };
  check(std::int8_t{-5});
  check(std::uint16_t{40000});
  check(2.5f);
}

TEST_F(ExportVolumeTest, OpenVdbSaysHowMuchMemoryItsTreeTakes) {
  ExportOptions options;
  options.memory_bytes = std::uint64_t{18} << 20;  // no room for a single leaf
  const std::string message = errorOf([&] { write("a.vdb", wildValues<float>(), {}, options); });
  EXPECT_CONTAINS(message, "MiB");
  EXPECT_CONTAINS(message, "<more memory>");
  EXPECT_EQ(filesLeft(), 0u);
}

// ---- slices -------------------------------------------------------------------------------------

TEST_F(ExportVolumeTest, ExrSlicesKeepVoxelsTypeAndGeometry) {
  const auto check = [&](const auto& values) {
    using T = typename std::decay_t<decltype(values)>::value_type;
    SCOPED_TRACE(voxelTypeName(voxelTypeOf<T>()));
    EXPECT_EQ(write("exr/slice%03d.exr", values, obliqueGeometry()).lost.size(), 1u);
    EXPECT_TRUE(fs::exists(pathOf("exr/slice012.exr")));
    const auto source = openVolume(pathOf("exr"));
    ASSERT_EQ(source->info().voxels, kWildVoxels);
    ASSERT_EQ(source->info().voxel_type, voxelTypeOf<T>());
    expectGeometry(source->info().geometry, obliqueGeometry(), 1e-12);
    EXPECT_EQ(readVoxels<T>(*source), values);
  };
  check(wildValues<std::uint8_t>());
  check(wildValues<std::int8_t>());
  check(wildValues<std::uint16_t>());
  check(wildValues<std::int16_t>());
  check(wildValues<float>());
}

TEST_F(ExportVolumeTest, ExrSlicesThatAreCutShortOrOthersAreRefused) {
  write("exr/%d.exr", wildValues<std::uint16_t>(), {});
  OpenOptions depth;
  depth.grid = "Z";
  EXPECT_CONTAINS(errorOf([&] { openVolume(pathOf("exr"), depth); }), "'Y'");
  const std::string whole = readBytes(pathOf("exr/5.exr"));
  for (std::size_t length = 0; length < whole.size(); length += 7) {
    writeBytes(pathOf("exr/5.exr"), whole.substr(0, length));
    EXPECT_CONTAINS(errorOf([&] { readAll(*openVolume(pathOf("exr"))); }), "exr/5.exr");
  }
  write("other/%d.exr", wildValues<float>(), {});
  fs::copy_file(pathOf("other/5.exr"), pathOf("exr/5.exr"), fs::copy_options::overwrite_existing);
  EXPECT_CONTAINS(errorOf([&] { readAll(*openVolume(pathOf("exr"))); }), "exr/5.exr");
}

TEST_F(ExportVolumeTest, TiffSlicesAndPagesKeepVoxels) {
  const auto check = [&](const auto& values) {
    using T = typename std::decay_t<decltype(values)>::value_type;
    GridGeometry geometry;
    geometry.spacing = {0.5, 0.25, 3};
    EXPECT_EQ(write("tiff/%02d.tif", values, geometry).lost.size(), 1u);
    write("pages.tif", values, geometry);
    for (const char* name : {"tiff", "pages.tif"}) {
      SCOPED_TRACE(name + std::string(voxelTypeName(voxelTypeOf<T>())));
      const auto source = openVolume(pathOf(name));
      ASSERT_EQ(source->info().voxels, kWildVoxels);
      ASSERT_EQ(source->info().voxel_type, voxelTypeOf<T>());
      EXPECT_NEAR(source->info().geometry.spacing.x, 0.5, 1e-6);
      EXPECT_NEAR(source->info().geometry.spacing.y, 0.25, 1e-6);
      EXPECT_EQ(readVoxels<T>(*source), values);
    }
  };
  check(wildValues<std::uint8_t>());
  check(wildValues<std::int8_t>());
  check(wildValues<std::uint16_t>());
  check(wildValues<std::int16_t>());
  check(wildValues<float>());
}

TEST_F(ExportVolumeTest, TiffLeavesTheHandlersOfTheHostAlone) {
  const TIFFErrorHandler own = [](const char*, const char*, va_list) {};
  const TIFFErrorHandler errors = TIFFSetErrorHandler(own), warnings = TIFFSetWarningHandler(own);
  write("pages.tif", wildValues<std::uint8_t>(), {});
  write("tiff/%02d.tif", wildValues<std::uint8_t>(), {});
  readAll(*openVolume(pathOf("pages.tif")));
  EXPECT_EQ(TIFFSetErrorHandler(errors), own);
  EXPECT_EQ(TIFFSetWarningHandler(warnings), own);
}

TEST_F(ExportVolumeTest, SlicesNeedAFolderAndAPlaceForTheirNumber) {
  for (const char* name : {"a.exr", "x/a.exr", "%q.exr", "x/%d%d.exr", "x%d/a%d.tif", "x/%99d.tif"})
    EXPECT_CONTAINS(errorOf([&] { write(name, wildValues<std::uint8_t>(), {}); }), "folder/%04d")
        << name;
  EXPECT_EQ(filesLeft(), 0u);
}

// ---- folders ------------------------------------------------------------------------------------

TEST_F(ExportVolumeTest, AFolderOfAnotherWriterIsRefusedAndALeftoverIsTakenOver) {
  const auto values = wildValues<std::uint8_t>();
  fs::create_directories(folder_ / "a.ome.zarr.isobrick.partial/0");
  writeBytes(pathOf("a.ome.zarr.isobrick.partial/0/old"), "left by a killed run");
  write("a.ome.zarr", values, {});
  EXPECT_FALSE(fs::exists(pathOf("a.ome.zarr/0/old")));
  {
    AtomicFolder busy(pathOf("a.ome.zarr"));
    EXPECT_CONTAINS(errorOf([&] { write("a.ome.zarr", values, {}); }), "another process");
  }
  writeBytes(pathOf("b.ome.zarr"), "a file");
  EXPECT_CONTAINS(errorOf([&] { write("b.ome.zarr", values, {}); }), "no folder");
  EXPECT_EQ(filesLeft(), 2u);
}

TEST_F(ExportVolumeTest, ACancelledExportLeavesNothing) {
  for (const char* name : {"a.ome.zarr", "a.h5", "a.vdb", "a.nii.gz"}) {
    CancelFlag cancel;
    ExportOptions options;
    options.cancel = &cancel;
    options.memory_bytes = std::uint64_t{64} << 20;
    options.progress = [&](double) { cancel.request(); };
    EXPECT_THROW(write(name, wildValues<std::uint8_t>(), {}, options), Cancelled) << name;
    EXPECT_EQ(filesLeft(), 0u) << name;
  }
}

// ---- levels of a pyramid, boxes and windows -----------------------------------------------------

TEST_F(ExportVolumeTest, ALevelOfAPyramidIsWhatItsBricksHold) {
  const Index3 voxels(37, 21, 50);
  const auto values = wildValues<std::int16_t>(voxels);
  ArraySource<std::int16_t> source(voxels, values, obliqueGeometry());
  BuildOptions build;
  build.brick_cells = 8;
  buildPyramid(source, pathOf("a.isb"), build);
  const auto pyramid = std::make_shared<const Pyramid>(pathOf("a.isb"));
  const auto finest = makePyramidSource(pyramid, kBudget, 0);
  EXPECT_EQ(readVoxels<std::int16_t>(*finest, 7), values);
  for (int level = 0; level < pyramid->lattice().levels(); ++level) {
    const auto coarse = makePyramidSource(pyramid, kBudget, level);
    const VolumeInfo& info = coarse->info();
    ASSERT_EQ(info.voxels, pyramid->lattice().samples(level));
    expectGeometry(info.geometry,
                   {obliqueGeometry().spacing * std::ldexp(1.0, level), obliqueGeometry().origin,
                    obliqueGeometry().direction},
                   1e-12);
    const auto all = readVoxels<std::int16_t>(*coarse, 5);
    const BrickSamples last = pyramid->samples(level, pyramid->layout().bricks(level) - Index3(1));
    EXPECT_EQ(all.back(), last.data<std::int16_t>()[last.box.size() - 1]) << level;
    const IndexBox box{Index3(1, 0, 1), glm::max(info.voxels - Index3(1, 0, 2), Index3(1))};
    std::vector<std::int16_t> boxed(static_cast<std::size_t>(box.size()));
    coarse->readBox(box, boxed.data());
    EXPECT_EQ(boxed.front(), all[static_cast<std::size_t>(linearIndex(box.first, info.voxels))]);
    EXPECT_EQ(boxed.back(),
              all[static_cast<std::size_t>(linearIndex(box.end() - Index3(1), info.voxels))]);
  }
  EXPECT_CONTAINS(errorOf([&] { makePyramidSource(pyramid, kBudget, 7); }), "0 to 6");
  EXPECT_CONTAINS(errorOf([&] { openVolume(pathOf("a.isb")); }), "pyramid already");
}

// A view of a source that is read by rows, or of one that is read by boxes.
std::unique_ptr<VolumeSource> arrayOrBoxes(const std::vector<std::uint16_t>& values,
                                           const std::string& path, bool boxes) {
  auto array = std::make_unique<ArraySource<std::uint16_t>>(kWildVoxels, values, obliqueGeometry());
  if (!boxes) return array;
  writeVolume(*array, path);
  return openVolume(path);
}

TEST_F(ExportVolumeTest, ABoxIsCutWhereItLies) {
  const auto values = wildValues<std::uint16_t>();
  for (const bool boxes : {false, true}) {
    const IndexBox box{Index3(3, 1, 5), Index3(11, 5, 8)};
    const auto cut = makeCroppedSource(arrayOrBoxes(values, pathOf("a.nrrd"), boxes), box);
    EXPECT_EQ(cut->readsBoxes(), boxes);
    EXPECT_LT(glm::distance(cut->info().geometry.origin,
                            obliqueGeometry().indexToWorld(glm::dvec3(3, 1, 5))),
              1e-12);
    const auto found = readVoxels<std::uint16_t>(*cut, 3);
    std::size_t at = 0;
    for (std::int64_t z = 0; z < 8; ++z)
      for (std::int64_t y = 0; y < 5; ++y)
        for (std::int64_t x = 0; x < 11; ++x)
          ASSERT_EQ(found[at++], values[static_cast<std::size_t>(
                                     linearIndex(box.first + Index3(x, y, z), kWildVoxels))]);
  }
  const auto refused = [&](const IndexBox& box) {
    return errorOf([&] {
      makeCroppedSource(std::make_unique<ArraySource<std::uint16_t>>(kWildVoxels, values), box);
    });
  };
  EXPECT_CONTAINS(refused({Index3(0), Index3(20, 7, 13)}), "0,0,0 to 18,6,12");
  EXPECT_CONTAINS(refused({Index3(0), Index3(1, 7, 13)}), "at least two");
  EXPECT_CONTAINS(refused({Index3(-1, 0, 0), Index3(5, 7, 13)}), "-1,0,0");
}

TEST_F(ExportVolumeTest, AWindowSpreadsValuesOverATypeAndSaysWhatItCosts) {
  const auto values = wildValues<std::uint16_t>();
  for (const bool boxes : {false, true}) {
    const auto window = makeWindowedSource(arrayOrBoxes(values, pathOf("a.nrrd"), boxes),
                                           {1000, 1000 + 2 * 255}, VoxelType::kUint8);
    const auto found = readVoxels<std::uint8_t>(*window);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double exact = std::clamp((values[i] - 1000.0) / 2, 0.0, 255.0);
      ASSERT_EQ(found[i], std::floor(exact + 0.5)) << values[i];
    }
    ASSERT_FALSE(window->info().notes.empty());
    EXPECT_CONTAINS(window->info().notes.back(), "steps of 2:");
  }
  const std::vector<float> wild(static_cast<std::size_t>(elementCount(kWildVoxels)),
                                std::numeric_limits<float>::quiet_NaN());
  const auto least = makeWindowedSource(std::make_unique<ArraySource<float>>(kWildVoxels, wild),
                                        {0, 1}, VoxelType::kInt16);
  EXPECT_EQ(readVoxels<std::int16_t>(*least).front(), -32768);
  const auto floats = makeFloatSource(
      std::make_unique<ArraySource<std::uint16_t>>(kWildVoxels, wildValues<std::uint16_t>()));
  EXPECT_EQ(readVoxels<float>(*floats)[2], 65535.0f);
}

}  // namespace
}  // namespace isobrick
