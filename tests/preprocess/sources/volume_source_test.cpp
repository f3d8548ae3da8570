// Reading and writing volumes: raw files, what ITK reads, and files that must be refused.
#include "isobrick/preprocess/volume_source.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <thread>

#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

class VolumeSourceTest : public VolumeFilesTest {};

// ---- raw ----------------------------------------------------------------------------------------

template <typename T>
std::vector<T> sampleValues(std::size_t count) {
  std::vector<T> values(count);
  for (std::size_t i = 0; i < count; ++i)
    values[i] = static_cast<T>(static_cast<double>(std::numeric_limits<T>::lowest()) / 2 +
                               static_cast<double>(i) * 37.5);
  values[0] = std::numeric_limits<T>::lowest();
  values[1] = std::numeric_limits<T>::max();
  return values;
}

template <typename In, typename Out>
void checkRawRoundTrip(const std::string& path, const std::string& type, VoxelType delivered) {
  const Index3 voxels(5, 3, 4);
  const auto values = sampleValues<In>(60);
  for (const bool big_endian : {false, true})
    for (const std::uint64_t offset : {std::uint64_t{0}, std::uint64_t{7}}) {
      std::ofstream(path, std::ios::binary)
          << std::string(offset, '#') << bytesOfValues(values, big_endian);
      const auto source = openRawSource(path, {voxels, type, big_endian, offset});
      EXPECT_EQ(source->info().voxel_type, delivered) << type;
      EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(1));
      EXPECT_TRUE(source->info().notes.empty()) << type;
      const auto read = readVoxels<Out>(*source);
      for (std::size_t i = 0; i < values.size(); ++i)
        ASSERT_EQ(read[i], static_cast<Out>(values[i])) << type << " " << i;
    }
}

TEST_F(VolumeSourceTest, RawReadsAllTypesInBothByteOrdersAtAnyOffset) {
  const std::string path = pathOf("volume.raw");
  checkRawRoundTrip<std::uint8_t, std::uint8_t>(path, "u8", VoxelType::kUint8);
  checkRawRoundTrip<std::int8_t, std::int8_t>(path, "int8", VoxelType::kInt8);
  checkRawRoundTrip<std::uint16_t, std::uint16_t>(path, "uint16", VoxelType::kUint16);
  checkRawRoundTrip<std::int16_t, std::int16_t>(path, "i16", VoxelType::kInt16);
  checkRawRoundTrip<float, float>(path, "float", VoxelType::kFloat32);
  checkRawRoundTrip<std::uint32_t, std::uint32_t>(path, "u32", VoxelType::kUint32);
  checkRawRoundTrip<std::int32_t, std::int32_t>(path, "int32", VoxelType::kInt32);
  checkRawRoundTrip<double, double>(path, "f64", VoxelType::kFloat64);
}

// Packed files can only be read in order, so they are opened again.
TEST_F(VolumeSourceTest, NumbersThatNoPyramidHoldsBecomeVoxels) {
  const std::vector<double> values = {101325.001, 101325.002, 101325.003, 101325.004,
                                      101325.005, 101325.006, 101325.007, 101325.008};
  OpenOptions options;
  options.raw = RawLayout{Index3(2), "double", true};
  const auto raw = openVolume(write("volume.raw", bytesOfValues(values, true)), options);
  const auto packed =
      openVolume(write("packed.nrrd",
                       "NRRD0004\ntype: double\ndimension: 3\nsizes: 2 2 2\nendian: "
                       "little\nencoding: gzip\n\n" +
                           deflated(bytesOfValues(values), true)));
  for (VolumeSource* const source : {raw.get(), packed.get()}) {
    source->chooseVoxels(nullptr, {});
    const VolumeInfo& info = source->info();
    ASSERT_EQ(info.voxel_type, VoxelType::kFloat32);
    EXPECT_EQ(info.numbers, VoxelType::kFloat64);
    EXPECT_CONTAINS(info.notes.back(), "float64 voxels became float32 around 101325");
    const auto read = readVoxels<float>(*source);
    for (std::size_t i = 0; i < values.size(); ++i)
      EXPECT_NEAR(info.values.real(static_cast<double>(read[i])), values[i], 1e-8);
  }
}

TEST_F(VolumeSourceTest, RawRefusesFilesOfAnotherSizeAndNamesBothSizes) {
  for (const std::size_t have : {0u, 23u, 25u, 48u}) {
    const std::string path = write("volume.raw", std::string(have, 'x'));
    const std::string message = errorOf([&] {
      openRawSource(path, {Index3(2, 3, 4), "u8", false});
    });
    EXPECT_CONTAINS(message, std::to_string(have) + " bytes");
    EXPECT_CONTAINS(message, "24");
    EXPECT_CONTAINS(message, path);
  }
}

TEST_F(VolumeSourceTest, RawRefusesDimensionsThatAreNoVolume) {
  const std::string path = write("volume.raw", std::string(24, 'x'));
  EXPECT_CONTAINS(errorOf([&] {
                    openRawSource(path, {Index3(1, 4, 6), "u8"});
                  }),
                  "at least 2 voxels per axis");
  EXPECT_CONTAINS(errorOf([&] {
                    openRawSource(path, {Index3(-2, 4, -3), "u8"});
                  }),
                  "at least 2 voxels per axis");
  EXPECT_CONTAINS(errorOf([&] { openRawSource(path, {Index3(0), "u8"}); }), "at least 2");
  EXPECT_CONTAINS(errorOf([&] {
                    openRawSource(path, {Index3(kMaxVoxelsPerAxis + 1, 2, 2), "u8"});
                  }),
                  "at most");
  // Products that overflow 64 bits, alone and with the offset.
  EXPECT_CONTAINS(errorOf([&] {
                    openRawSource(path, {Index3(std::int64_t{1} << 62, 8, 8), "f64"});
                  }),
                  "at most");
  RawLayout layout{Index3(kMaxVoxelsPerAxis), "f64"};
  layout.offset_bytes = ~std::uint64_t{0};
  EXPECT_CONTAINS(errorOf([&] { openRawSource(path, layout); }), "24 bytes");
  layout.voxels = Index3(2, 3, 4);
  layout.type = "u8";
  layout.offset_bytes = ~std::uint64_t{0} - 23;  // 24 more would be 0
  EXPECT_CONTAINS(errorOf([&] { openRawSource(path, layout); }), "24 bytes");
}

TEST_F(VolumeSourceTest, RawRefusesUnknownTypesMissingFilesAndBadSpacing) {
  const std::string path = write("volume.raw", std::string(8, 'x'));
  EXPECT_CONTAINS(errorOf([&] { openRawSource(path, {Index3(2), "u12"}); }), "'u12'");
  EXPECT_CONTAINS(errorOf([&] { openRawSource(pathOf("no.raw"), {Index3(2), "u8"}); }), "no.raw");
  EXPECT_CONTAINS(errorOf([&] {
                    openRawSource(folder_.string(), {Index3(2), "u8"});
                  }),
                  "not a regular file");
  OpenOptions options;
  options.raw = RawLayout{Index3(2), "u8"};
  options.spacing = {1, 0, 1};
  EXPECT_CONTAINS(errorOf([&] { openVolume(path, options); }), "spacings above 0");
}

TEST_F(VolumeSourceTest, RawFileThatShrinksMeanwhileIsAnErrorThatNamesTheSlice) {
  const std::string path = write("volume.raw", std::string(4 * 4 * 8, 'x'));
  const auto source = openRawSource(path, {Index3(4, 4, 8), "u8"});
  std::vector<char> slices(16 * 8);
  source->readRows(0, 2 * 4, slices.data());
  fs::resize_file(path, 16 * 5 + 3);
  EXPECT_CONTAINS(errorOf([&] { source->readRows(2 * 4, 6 * 4, slices.data()); }), "slice 5");
}

// ---- written and read back ----------------------------------------------------------------------

GridGeometry tiltedGeometry() {
  GridGeometry geometry;
  geometry.spacing = {0.5, 0.7, 1.0 / 3};
  geometry.origin = {-10.25, 1e-7, 333.125};
  const double c = std::cos(0.3), s = std::sin(0.3);
  // A rotation about z, with the third axis flipped: determinant -1.
  geometry.direction = glm::dmat3(glm::dvec3(c, s, 0), glm::dvec3(-s, c, 0), glm::dvec3(0, 0, -1));
  return geometry;
}

// A source in memory.
class BytesSource final : public VolumeSource {
 public:
  BytesSource(const Index3& voxels, VoxelType type, std::string bytes) : bytes_(std::move(bytes)) {
    info_.voxels = voxels;
    info_.voxel_type = type;
    info_.geometry = tiltedGeometry();
  }
  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return bytes_; }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    if (fails_at >= first && fails_at < first + count) throw Error("row is damaged; test");
    const auto row = static_cast<std::size_t>(info_.voxels.x) * voxelBytes(info_.voxel_type);
    std::memcpy(out, bytes_.data() + static_cast<std::size_t>(first) * row,
                static_cast<std::size_t>(count) * row);
  }
  std::int64_t fails_at = -1;  // a row

 private:
  VolumeInfo info_;
  std::string bytes_;
};

template <typename T>
void checkFileRoundTrip(const std::string& path, VoxelType type) {
  const Index3 voxels(5, 3, 4);
  const auto values = sampleValues<T>(60);
  BytesSource original(voxels, type, bytesOfValues(values));
  VolumeWriteOptions options;
  std::vector<double> fractions;
  options.progress = [&](double fraction) { fractions.push_back(fraction); };
  options.memory_bytes = 15 * sizeof(T);  // a slice at a time
  writeVolume(original, path, options);
  EXPECT_EQ(fractions.size(), 4u);
  EXPECT_EQ(fractions.back(), 1.0);

  const auto source = openVolume(path);
  const VolumeInfo& info = source->info();
  EXPECT_EQ(info.voxels, voxels);
  EXPECT_EQ(info.voxel_type, type);
  EXPECT_TRUE(info.notes.empty());
  const GridGeometry expected = tiltedGeometry();
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(info.geometry.spacing[axis], expected.spacing[axis], 1e-12) << path;
    EXPECT_NEAR(info.geometry.origin[axis], expected.origin[axis], 1e-12) << path;
    for (int row = 0; row < 3; ++row)
      EXPECT_NEAR(info.geometry.direction[axis][row], expected.direction[axis][row], 1e-12) << path;
  }
  for (const std::int64_t slab : {1, 3, 4}) EXPECT_EQ(readVoxels<T>(*source, slab), values) << path;
}

TEST_F(VolumeSourceTest, WrittenFilesReadBackTheSame) {
  for (const char* name : {"volume.nrrd", "volume.mhd"}) {
    checkFileRoundTrip<std::uint8_t>(pathOf(name), VoxelType::kUint8);
    checkFileRoundTrip<std::int8_t>(pathOf(name), VoxelType::kInt8);
    checkFileRoundTrip<std::uint16_t>(pathOf(name), VoxelType::kUint16);
    checkFileRoundTrip<std::int16_t>(pathOf(name), VoxelType::kInt16);
    checkFileRoundTrip<float>(pathOf(name), VoxelType::kFloat32);
  }
  EXPECT_EQ(filesLeft(), 3u);  // .nrrd, .mhd, .raw
}

TEST_F(VolumeSourceTest, WriterWritesPlainRawAndRefusesOtherEndings) {
  const std::string bytes = bytesOfValues(sampleValues<std::int16_t>(24));
  BytesSource source(Index3(2, 3, 4), VoxelType::kInt16, bytes);
  writeVolume(source, pathOf("volume.raw"));
  EXPECT_EQ(readBytes(pathOf("volume.raw")), bytes);
  EXPECT_CONTAINS(errorOf([&] { writeVolume(source, pathOf("volume.jpg")); }), ".nrrd");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(VolumeSourceTest, FailedOrCancelledWritesLeaveNothing) {
  for (const char* name : {"volume.nrrd", "volume.mhd", "volume.raw"}) {
    BytesSource source(Index3(2, 3, 4), VoxelType::kUint8, std::string(24, 'x'));
    VolumeWriteOptions options;
    options.memory_bytes = 6;
    CancelFlag cancel;
    options.cancel = &cancel;
    options.progress = [&](double) { cancel.request(); };
    EXPECT_THROW(writeVolume(source, pathOf(name), options), Cancelled);
    EXPECT_EQ(filesLeft(), 0u);
    source.fails_at = 2 * 3;
    EXPECT_CONTAINS(errorOf([&] { writeVolume(source, pathOf(name)); }), "damaged");
    EXPECT_EQ(filesLeft(), 0u);
  }
}

// ---- AtomicFile ---------------------------------------------------------------------------------

TEST_F(VolumeSourceTest, AtomicFileAppearsWithCommitAndReplacesTheOldOne) {
  const std::string path = write("file", "old");
  {
    AtomicFile file(path);
    file.write("0123456789", 10);
    file.pwrite("ab", 2, 4);
    file.pwrite("tail", 4, 12);
    EXPECT_EQ(file.position(), 10u);
    file.write("XY", 2);
    EXPECT_EQ(readBytes(path), "old");
    file.commit();
  }
  EXPECT_EQ(readBytes(path), "0123ab6789XYtail");
  EXPECT_EQ(filesLeft(), 1u);
  {
    AtomicFile abandoned(path);
    abandoned.write("new", 3);
    EXPECT_EQ(filesLeft(), 2u);
  }
  EXPECT_EQ(readBytes(path), "0123ab6789XYtail");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(VolumeSourceTest, AtomicFileTakesOverLeftoversButNotLivingFiles) {
  write("file.isobrick.partial", "a leftover that is longer than what is written");
  AtomicFile file(pathOf("file"));
  EXPECT_CONTAINS(errorOf([&] { AtomicFile second(pathOf("file")); }), "another process");
  file.write("new", 3);
  file.commit();
  EXPECT_EQ(readBytes(pathOf("file")), "new");
  AtomicFile third(pathOf("file"));  // the lock went with the commit
}

TEST_F(VolumeSourceTest, AtomicFileRefusesPlacesThatCannotBeWritten) {
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(pathOf("no/such/file")); }),
                  "No such file or directory; create the folder");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(folder_.string()); }), "folder");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(""); }), "name a file");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file("/dev/full"); }), "not a regular file");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(pathOf(std::string(300, 'n'))); }), "shorter");
}

TEST_F(VolumeSourceTest, AtomicFileReportsAFullDisk) {
  // The limit on file sizes fails a write half-way just as a full disk does.
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto previous_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit limited = before;
  limited.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limited), 0);
  const std::string message = errorOf([&] {
    AtomicFile file(pathOf("file"));
    const std::string block(600, 'x');
    file.write(block.data(), block.size());
    file.write(block.data(), block.size());
    file.commit();
  });
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, previous_handler);
  EXPECT_CONTAINS(message, "cannot write '" + pathOf("file") + "': File too large");
  EXPECT_EQ(filesLeft(), 0u);
}

// ---- what ITK reads -----------------------------------------------------------------------------

const std::string kNrrdStart = "NRRD0004\ntype: uint8\nencoding: raw\n";

TEST_F(VolumeSourceTest, UnusualButValidHeadersAreRead) {
  std::vector<std::int16_t> values(4 * 3 * 2);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<std::int16_t>(300 * static_cast<int>(i) - 2000);
  const std::string little = bytesOfValues(values), big = bytesOfValues(values, true);
  write("data.bin", "skipped" + big + "trailing bytes");
  const std::string meta =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 4 3 2\nElementType = "
      "MET_SHORT\n";
  std::vector<std::string> paths = {
      write("detached.nhdr",
            "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nendian: big\nencoding: raw\n"
            "byte skip: 7\ndata file: data.bin\n"),
      write("crlf.nrrd",
            "NRRD0004\r\ntype: short\r\ndimension: 3\r\nsizes: 4 3 2\r\nendian: little\r\n"
            "encoding: raw\r\n\r\n" +
                little),
      write("text.nrrd",
            [&] {
              std::string text =
                  "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 3 2\nencoding: ascii\n\n";
              for (const int v : values) text += std::to_string(v) + "\n";
              return text;
            }()),
      write(
          "four_axes.nrrd",
          "NRRD0004\ntype: short\ndimension: 4\nsizes: 4 3 2 1\nendian: little\nencoding: raw\n\n" +
              little),
      write("skipped.mhd", meta + "BinaryDataByteOrderMSB = True\nHeaderSize = 7\n"
                                  "ElementDataFile = data.bin\n"),
      write("local.mha", meta + "ElementByteOrderMSB = True\nElementDataFile = LOCAL\n" + big),
      write("list.mhd", meta + "ElementDataFile = LIST 2D\nslice0.bin\nslice1.bin\n"),
  };
  write("slice0.bin", little.substr(0, 24));
  write("slice1.bin", little.substr(24));
  for (const std::string& path : paths) {
    const auto source = openVolume(path);
    EXPECT_EQ(source->info().voxels, Index3(4, 3, 2)) << path;
    ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16) << path;
    EXPECT_EQ(readVoxels<std::int16_t>(*source, 1), values) << path;
  }
}

TEST_F(VolumeSourceTest, WideIntegersBecomeFloatsWithANote) {
  const std::vector<std::int64_t> values = {-5, 0, 7, 1 << 20, 3, 4, 5, 6};
  const auto source =
      openVolume(write("wide.nrrd",
                       "NRRD0004\ntype: int64\ndimension: 3\nsizes: 2 2 2\nendian: little\n"
                       "encoding: raw\n\n" +
                           bytesOfValues(values)));
  source->chooseVoxels(nullptr, {});
  ASSERT_EQ(source->info().voxel_type, VoxelType::kFloat32);
  EXPECT_EQ(source->info().notes.size(), 1u);
  EXPECT_EQ(readVoxels<float>(*source), (std::vector<float>{-5, 0, 7, 1 << 20, 3, 4, 5, 6}));
}

TEST_F(VolumeSourceTest, ImagesThatAreNoScalarVolumeAreRefused) {
  const std::string data(4 * 4 * 4 * 3, 'x');
  const auto nrrd = [&](const std::string& fields) {
    return errorOf([&] { openAndRead(write("image.nrrd", kNrrdStart + fields + "\n" + data)); });
  };
  EXPECT_CONTAINS(nrrd("dimension: 4\nsizes: 3 4 4 4\nkinds: RGB-color domain domain domain\n"),
                  "3 values per voxel");
  EXPECT_CONTAINS(nrrd("dimension: 4\nsizes: 4 4 4 3\n"), "3 values per voxel");
  EXPECT_CONTAINS(nrrd("dimension: 2\nsizes: 4 4\n"), "2-D");
  EXPECT_CONTAINS(nrrd("dimension: 3\nsizes: 4 1 4\n"), "at least 2 voxels per axis");
  EXPECT_CONTAINS(nrrd("dimension: 3\nsizes: 2000000 2 2\n"), "at most");
  EXPECT_CONTAINS(nrrd("dimension: 3\nspace: left-posterior-superior\nsizes: 4 4 4\n"
                       "space directions: (1,0,0) (0.5,1,0) (0,0,1)\n"),
                  "right angles");
}

TEST_F(VolumeSourceTest, DamagedAndUnknownFilesAreOneLineErrors) {
  const std::string meta =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 4 4 4\nElementType = "
      "MET_UCHAR\n";
  const std::vector<std::pair<std::string, std::string>> files = {
      {"empty.nrrd", ""},
      {"noise.bin", std::string(1000, '\x5a')},
      {"text.txt", "no volume"},
      {"short.nrrd", kNrrdStart + "dimension: 3\nsizes: 4 4 4\n\n" + std::string(63, 'x')},
      {"half_header.nrrd", "NRRD0004\ntype: uint8\ndimension: 3\n"},
      {"negative.nrrd", kNrrdStart + "dimension: 3\nsizes: -4 4 4\n\nxxx"},
      {"overflow.nrrd", kNrrdStart + "dimension: 3\nsizes: 99999999999999999999 4 4\n\nxxx"},
      {"memory.nrrd",
       "NRRD0004\ntype: uint8\nencoding: gzip\ndimension: 3\n"
       "sizes: 1000000 20 1000000\n\nxxx"},
      {"lost_data.nhdr", kNrrdStart + "dimension: 3\nsizes: 4 4 4\ndata file: none.raw\n"},
      {"short.mha", meta + "ElementDataFile = LOCAL\n" + std::string(63, 'x')},
      {"lost_data.mhd", meta + "ElementDataFile = none.raw\n"},
      {"lost_slice.mhd", meta + "ElementDataFile = LIST\na.raw\nb.raw\nc.raw\nd.raw\n"},
      {"packed.mha", meta +
                         "CompressedData = True\nCompressedDataSize = 40\n"
                         "ElementDataFile = LOCAL\n" +
                         std::string(40, 'x')},
      {"half_header.mhd", "ObjectType = Image\nNDims = 3\n"},
      {"negative.mhd",
       "ObjectType = Image\nNDims = 3\nDimSize = -4 4 4\n"
       "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"},
      {"empty.tif", ""},
      {"noise.dcm", std::string(3000, '\x11')},
  };
  for (const auto& [name, bytes] : files) {
    const std::string path = write(name, bytes);
    testing::internal::CaptureStderr();
    const std::string message = errorOf([&] { openAndRead(path); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << name;
    EXPECT_CONTAINS(message, folder_.string());
  }
  EXPECT_CONTAINS(errorOf([&] { openVolume(pathOf("none.nrrd")); }), "No such file");
  fs::create_directory(folder_ / "nothing");
  EXPECT_CONTAINS(errorOf([&] { openVolume(pathOf("nothing")); }), "neither DICOM");
}

TEST_F(VolumeSourceTest, TiffStackIsReadInNumericOrder) {
  const auto pixels = [](int k) {
    std::vector<std::uint16_t> values(5 * 4);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = static_cast<std::uint16_t>(1000 * k + static_cast<int>(i));
    return values;
  };
  std::vector<std::uint16_t> expected;
  for (int k = 1; k <= 12; ++k) {  // 1, 2, ..., 10, ...: not the order of the alphabet
    write(std::string("s").append(std::to_string(k)).append(".tif"),
          tiffBytes(5, 4, 16, bytesOfValues(pixels(k))));
    expected.insert(expected.end(), 20, 0);
    const auto slice = pixels(k);
    std::copy(slice.begin(), slice.end(), expected.end() - 20);
  }
  write("notes.txt", "not a slice");
  {
    const auto source = openVolume(folder_.string());
    EXPECT_EQ(source->info().voxels, Index3(5, 4, 12));
    EXPECT_EQ(source->info().format, "TIFF stack");
    ASSERT_EQ(source->info().voxel_type, VoxelType::kUint16);
    EXPECT_EQ(readVoxels<std::uint16_t>(*source, 5), expected);
  }
  write("s11.tif", tiffBytes(4, 4, 16, std::string(32, 'x')));
  EXPECT_CONTAINS(errorOf([&] { openAndRead(folder_.string()); }), "s11.tif");
  write("s11.tif", tiffBytes(5, 4, 16, std::string(20, 'x')));  // half the pixels
  testing::internal::CaptureStderr();
  EXPECT_CONTAINS(errorOf([&] { openAndRead(folder_.string()); }), "s11.tif");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_CONTAINS(errorOf([&] { openVolume(pathOf("s3.tif")); }), "2-D");
}

// ITK's output of an error is caught, and nothing else.
TEST_F(VolumeSourceTest, OtherThreadsPrintWhileAnImageIsOpened) {
  const std::string path =
      write("a.mha",
            "ObjectType = Image\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\n"
            "ElementDataFile = LOCAL\n" +
                std::string(8, '\1'));
  constexpr int kLines = 200;
  testing::internal::CaptureStderr();
  {
    const std::jthread other([] {
      for (int i = 0; i < kLines; ++i) std::cerr << "a line\n";
    });
    for (int i = 0; i < 50; ++i) openAndRead(path);
  }
  const std::string printed = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(printed.begin(), printed.end(), '\n'), kLines);
}

}  // namespace
}  // namespace isobrick
