// An index and a pyramid of the same volume are the same but for where level 0 lies.
#include "isobrick/preprocess/sources/indexed_source.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <thread>

#include "isobrick/extract/extractor.h"
#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/every_brick.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/plain_reader.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

constexpr Index3 kIndexedVoxels{37, 30, 41};

double waveAt(const Index3& p) {
  if (p.x > 30 && p.z > 30) return 7;  // constant bricks
  return 90 + 60 * std::sin(0.3 * static_cast<double>(p.x)) *
                  std::cos(0.2 * static_cast<double>(p.y + p.z));
}

template <typename T>
std::vector<T> waves(double offset = 0) {
  return arrayOfField<T>(kIndexedVoxels, [&](const Index3& p) { return waveAt(p) + offset; });
}

class IndexedSourceTest : public VolumeFilesTest {
 protected:
  IndexedSourceTest() { readLevel0FromSources(); }

  // Written by isobrick, in the format of the ending.
  std::string writeWaves(const std::string& name, ExportOptions options = {}) const {
    options.memory_bytes = std::uint64_t{64} << 20;
    VolumeLevels levels;
    auto source =
        std::make_unique<ArraySource<std::int16_t>>(kIndexedVoxels, waves<std::int16_t>(-100));
    levels.push_back(std::move(source));
    exportVolume(levels, pathOf(name), options);
    return pathOf(name);
  }

  static BuildOptions smallBricksOf(const BuildOptions& options = {}) {
    BuildOptions small = options;
    small.brick_cells = 8;
    small.tile_cells = 4;
    return small;
  }

  std::string build(const std::string& path, const OpenOptions& open, const std::string& name,
                    bool is_index, const BuildOptions& options = {}) const {
    const auto source = openVolume(path, open);
    BuildOptions own = smallBricksOf(options);
    if (is_index) own.source_record = sourceRecord(*source, open, pathOf(name));
    buildPyramid(*source, pathOf(name), own);
    return pathOf(name);
  }

  // Builds both, and compares all that they give.
  void expectSame(const std::string& path, const OpenOptions& open = {},
                  const BuildOptions& options = {}) const {
    SCOPED_TRACE(path);
    const Pyramid whole(build(path, open, "whole.isb", false, options));
    const Pyramid index(build(path, open, "index.isb", true, options));
    expectSame(whole, index);
    EXPECT_LT(index.fileBytes(), whole.fileBytes());
    const PlainPyramid plain = readPlainPyramid(pathOf("index.isb"));
    EXPECT_TRUE(plain.is_index);
  }

  static void expectSame(const Pyramid& whole, const Pyramid& index) {
    EXPECT_EQ(index.spec().level0, Level0Place::kInFiles);
    EXPECT_TRUE(verifyPyramid(index).empty());
    forAllBricks(whole, [&](int level, const Index3& brick) {
      const BrickSamples a = whole.samples(level, brick), b = index.samples(level, brick);
      ASSERT_EQ(a.box.size(), b.box.size());
      const auto bytes =
          static_cast<std::size_t>(a.box.size()) * voxelBytes(whole.spec().voxel_type);
      EXPECT_EQ(std::memcmp(a.part.data(), b.part.data(), bytes), 0) << brickName(level, brick);
      std::vector<ValueRange> tiles, same;
      whole.tileRanges(level, brick, tiles);
      index.tileRanges(level, brick, same);
      EXPECT_TRUE(tiles == same);
      EXPECT_TRUE(whole.brickRange(level, brick) == index.brickRange(level, brick));
      if (level > 0) return;
      std::vector<std::uint8_t> codes, same_codes;
      whole.parts().curvature(brick, codes);
      index.parts().curvature(brick, same_codes);
      EXPECT_EQ(codes, same_codes);
    });
    Query query;
    query.isovalue = (whole.realRange().min + whole.realRange().max) / 2;
    EXPECT_EQ(meshOf(whole, query), meshOf(index, query));
    query.focus = FocusSphere{{10, 12, 14}, 6};
    EXPECT_EQ(meshOf(whole, query), meshOf(index, query));
  }

  static std::uint64_t meshOf(const Pyramid& pyramid, const Query& query) {
    HashingSink sink;
    extractIsosurface(pyramid, query, sink);
    EXPECT_GT(sink.triangles(), 0u);
    return sink.value();
  }

  static std::string readingErrorOf(const std::string& index) {
    const Pyramid pyramid(index);
    return errorOf([&] { (void)pyramid.samples(0, Index3(1)); });
  }

  static OpenOptions rawLayout(const std::string& type, bool big_endian = false,
                               std::uint64_t offset = 0) {
    OpenOptions options;
    options.raw = RawLayout{kIndexedVoxels, type, big_endian, offset};
    return options;
  }
};

TEST_F(IndexedSourceTest, AllFormatsGiveTheBricksOfThePyramid) {
  expectSame(write("a.raw", bytesOfValues(waves<std::uint8_t>())), rawLayout("u8"));
  expectSame(write("b.raw", "head" + bytesOfValues(waves<std::uint16_t>(), true)),
             rawLayout("u16", true, 4));
  for (const char* name : {"a.nrrd", "a.vti", "a.mha", "a.ome.zarr", "a.h5", "a.vdb"})
    expectSame(writeWaves(name));
  ExportOptions old_zarr;
  old_zarr.zarr_version = 2;
  expectSame(writeWaves("b.ome.zarr", old_zarr));
}

TEST_F(IndexedSourceTest, SlicesOfTiff) {
  fs::create_directory(pathOf("slices"));
  const std::vector<std::uint16_t> values = waves<std::uint16_t>();
  const auto slice = static_cast<std::size_t>(kIndexedVoxels.x * kIndexedVoxels.y);
  for (std::int64_t z = 0; z < kIndexedVoxels.z; ++z) {
    const auto first = values.begin() + z * static_cast<std::int64_t>(slice);
    const std::vector<std::uint16_t> some(first, first + static_cast<std::int64_t>(slice));
    write("slices/" + std::to_string(100 + z) + ".tif",
          tiffBytes(static_cast<std::uint32_t>(kIndexedVoxels.x),
                    static_cast<std::uint32_t>(kIndexedVoxels.y), 16, bytesOfValues(some)));
  }
  expectSame(pathOf("slices"));
}

TEST_F(IndexedSourceTest, NumbersThatNoPyramidHolds) {
  expectSame(write("a.raw", bytesOfValues(waves<double>(1e6))), rawLayout("f64"));
  expectSame(write("b.raw", bytesOfValues(waves<std::int32_t>(70000))), rawLayout("i32"));
}

TEST_F(IndexedSourceTest, ALabelOfAVolume) {
  OpenOptions options = rawLayout("u8");
  options.derivation.label = 7;
  const std::string path = write("a.raw", bytesOfValues(waves<std::uint8_t>()));
  expectSame(path, options);
}

TEST_F(IndexedSourceTest, VoxelsThatAreNotFinite) {
  std::vector<float> values = waves<float>();
  for (std::size_t i = 500; i < values.size(); i += 997)
    values[i] = i % 2 == 0 ? std::nanf("7") : std::numeric_limits<float>::infinity();
  const std::string path = write("a.raw", bytesOfValues(values));
  BuildOptions options;
  options.nan_as = 12.5f;
  expectSame(path, rawLayout("f32"), options);
  options.mask_nan = true;
  expectSame(path, rawLayout("f32"), options);
}

TEST_F(IndexedSourceTest, OfAPyramidOfManyFiles) {
  const std::string path = write("a.raw", bytesOfValues(waves<std::uint16_t>()));
  for (const bool is_index : {false, true}) {
    const std::string folder = pathOf(is_index ? "index.isbs" : "whole.isbs");
    fs::create_directory(folder);
    const auto source = openVolume(path, rawLayout("u16"));
    BuildOptions options = smallBricksOf();
    options.super_cells = 16;
    if (is_index) options.source_record = sourceRecord(*source, rawLayout("u16"), folder);
    const std::size_t count = superBrickFiles(source->info(), options).size();
    for (std::size_t number = 0; number < count; ++number)
      buildSuperBrick(*source, folder, number, options);
    joinPyramid(folder, {});
  }
  expectSame(Pyramid(pathOf("whole.isbs")), Pyramid(pathOf("index.isbs")));
}

TEST_F(IndexedSourceTest, BothMoveTogether) {
  fs::create_directory(pathOf("here"));
  write("here/a.raw", bytesOfValues(waves<std::uint16_t>()));
  build(pathOf("here/a.raw"), rawLayout("u16"), "here/a.isb", true);
  fs::rename(pathOf("here"), pathOf("there"));
  EXPECT_TRUE(verifyPyramid(Pyramid(pathOf("there/a.isb"))).empty());
  // One beside it has its whole path.
  fs::create_directory(pathOf("other"));
  build(pathOf("there/a.raw"), rawLayout("u16"), "other/a.isb", true);
  fs::rename(pathOf("other"), pathOf("moved"));
  EXPECT_TRUE(verifyPyramid(Pyramid(pathOf("moved/a.isb"))).empty());
}

TEST_F(IndexedSourceTest, ASourceThatChangedIsNamed) {
  const std::vector<std::uint16_t> values = waves<std::uint16_t>();
  const std::string path = write("a.raw", bytesOfValues(values));
  const std::string index = build(path, rawLayout("u16"), "a.isb", true);
  const auto written = fs::last_write_time(path);
  fs::last_write_time(path, written + std::chrono::seconds(3));
  std::string message = readingErrorOf(index);
  EXPECT_CONTAINS(message, path);
  EXPECT_CONTAINS(message, "changed since '" + index + "' was built of it");
  EXPECT_CONTAINS(message, "at another time");
  fs::last_write_time(path, written);
  EXPECT_TRUE(verifyPyramid(Pyramid(index)).empty());

  fs::resize_file(path, fs::file_size(path) - 1);
  EXPECT_CONTAINS(readingErrorOf(index), "bytes, and had");
  fs::remove(path);
  EXPECT_CONTAINS(readingErrorOf(index), "leaves its finest level in its source: cannot open");
}

TEST_F(IndexedSourceTest, VoxelsThatChangedInSecretAreNamed) {
  std::vector<std::uint16_t> values = waves<std::uint16_t>();
  const std::string path = write("a.raw", bytesOfValues(values));
  const std::string index = build(path, rawLayout("u16"), "a.isb", true);
  const auto written = fs::last_write_time(path);
  const Pyramid open(index);
  (void)open.samples(0, Index3(0));
  const Index3 at(12, 13, 14);
  values[static_cast<std::size_t>(linearIndex(at, kIndexedVoxels))] ^= 1;
  {
    std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
    file << bytesOfValues(values);
  }
  fs::last_write_time(path, written);
  const std::string message = errorOf([&] { (void)open.samples(0, Index3(1)); });
  EXPECT_CONTAINS(message, "its voxels in '" + path + "' are not what they were when");
  EXPECT_CONTAINS(message, "level 0");
  EXPECT_NO_THROW((void)open.samples(0, Index3(3, 3, 3)));  // bricks without it stay
}

TEST_F(IndexedSourceTest, PackedVolumesAreRefused) {
  const std::string path = writeWaves("a.nii.gz");
  const auto source = openVolume(path);
  const std::string message = errorOf([&] { sourceRecord(*source, {}, pathOf("a.isb")); });
  EXPECT_CONTAINS(message, "one by one");
  EXPECT_CONTAINS(message, "build a pyramid of it in place of the index");
}

TEST_F(IndexedSourceTest, AProgramThatReadsNoVolumesSaysSo) {
  const std::string path = write("a.raw", bytesOfValues(waves<std::uint16_t>()));
  const std::string index = build(path, rawLayout("u16"), "a.isb", true);
  setSourceOpener(nullptr);
  const Pyramid pyramid(index);
  (void)pyramid.samples(1, Index3(0));
  EXPECT_CONTAINS(errorOf([&] { (void)pyramid.samples(0, Index3(1)); }),
                  "this program does not read volumes");
}

TEST_F(IndexedSourceTest, ABudgetOfAFewBricksServesManyThreads) {
  const std::string path = write("a.raw", bytesOfValues(waves<std::int16_t>()));
  build(path, rawLayout("i16"), "a.isb", true);
  build(path, rawLayout("i16"), "whole.isb", false);
  const Pyramid small(pathOf("a.isb"), 40000), whole(pathOf("whole.isb"));
  std::vector<std::jthread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      forEachIndex({Index3(0), whole.layout().bricks(0)}, [&](const Index3& brick) {
        const BrickSamples a = whole.samples(0, brick), b = small.samples(0, brick);
        EXPECT_EQ(
            std::memcmp(a.part.data(), b.part.data(), static_cast<std::size_t>(a.box.size()) * 2),
            0);
      });
    });
  threads.clear();
  EXPECT_GT(small.parts().counters().parts_released, 0u);
}

TEST_F(IndexedSourceTest, TooLittleMemoryForChunksIsRefused) {
  build(writeWaves("a.ome.zarr"), {}, "a.isb", true);
  const Pyramid small(pathOf("a.isb"), 40000);
  const std::string message = errorOf([&] { (void)small.samples(0, Index3(1)); });
  EXPECT_CONTAINS(message, "takes more memory than the half of what is allowed");
  EXPECT_CONTAINS(message, "a.ome.zarr");
}

TEST_F(IndexedSourceTest, AnyRecordIsSafe) {
  const std::string path = write("a.raw", bytesOfValues(waves<std::uint16_t>()));
  const auto open = volumeSourceOpener();
  SourceRequest request;
  request.pyramid = pathOf("a.isb");
  request.memory_bytes = 1 << 20;
  request.spec.voxels = kIndexedVoxels;
  for (const std::string record :
       {"", "{}", "[]", R"({"level0": 7})", R"({"level0": {"path": ""}})",
        R"({"level0": {"path": 3}})", R"({"level0": {"path": "a.raw"}})",
        R"({"level0": {"path": "a.raw", "files": 1, "open": {"raw": {"voxels": [1, "2", {}]}}}})",
        R"({"level0": {"path": "b.raw", "open": {"spacing": [1, 2, "3"], "component": -1}}})"}) {
    request.provenance = record;
    EXPECT_FALSE(errorOf([&] { (void)open(request); }).empty()) << record;
  }
  request.pyramid = "https://example.org/a.isb";
  request.provenance = R"({"level0": {"path": ")" + path + R"("}})";
  EXPECT_CONTAINS(errorOf([&] { (void)open(request); }), "another machine");
}

}  // namespace
}  // namespace isobrick::test
