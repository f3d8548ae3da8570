// Reading and writing volumes: raw files, what ITK reads, and files that must be refused.
#include "preprocess/volume_source.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "preprocess/export/volume_writer.h"
#include "preprocess/sources/itk_source.h"
#include "preprocess/sources/raw_source.h"
#include "storage/atomic_file.h"
#include "storage/error.h"
#include "tests/support/volume_files.h"

#ifdef __SANITIZE_ADDRESS__
// ITK forgets a buffer where a TIFF file ends early.
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() {
  return "leak:itk::TIFFImageIO::ReadGenericImage\n";
}
#endif

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
      const auto source =
          openRawSource(path, {voxels, type, big_endian, glm::dvec3(1, 2, 3), offset});
      EXPECT_EQ(source->info().voxel_type, delivered) << type;
      EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(1, 2, 3));
      EXPECT_EQ(source->info().notes.empty(), (std::is_same_v<In, Out>)) << type;
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
  checkRawRoundTrip<std::uint32_t, float>(path, "u32", VoxelType::kFloat32);
  checkRawRoundTrip<std::int32_t, float>(path, "int32", VoxelType::kFloat32);
}

TEST_F(VolumeSourceTest, RawConvertsDoubles) {
  const std::vector<double> values = {0.1,  -1e30, 1e300, std::numeric_limits<double>::infinity(),
                                      1e-3, 2,     3,     4};
  const std::string path = write("volume.raw", bytesOfValues(values, true));
  const auto source = openRawSource(path, {Index3(2), "double", true});
  ASSERT_EQ(source->info().notes.size(), 1u);
  const auto read = readVoxels<float>(*source);
  EXPECT_EQ(read[0], 0.1f);
  EXPECT_EQ(read[1], -1e30f);
  EXPECT_EQ(read[3], std::numeric_limits<float>::infinity());
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
  RawLayout layout{Index3(2), "u8"};
  layout.spacing.y = 0;
  EXPECT_CONTAINS(errorOf([&] { openRawSource(path, layout); }), "spacing");
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

GridGeometry obliqueGeometry() {
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
    info_.geometry = obliqueGeometry();
  }
  const VolumeInfo& info() const override { return info_; }
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
  options.slab_bytes = 1;  // a slice at a time
  writeVolume(original, path, options);
  EXPECT_EQ(fractions.size(), 4u);
  EXPECT_EQ(fractions.back(), 1.0);

  const auto source = openItkSource(path);
  const VolumeInfo& info = source->info();
  EXPECT_EQ(info.voxels, voxels);
  EXPECT_EQ(info.voxel_type, type);
  EXPECT_TRUE(info.notes.empty());
  const GridGeometry expected = obliqueGeometry();
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
  EXPECT_EQ(readFile(pathOf("volume.raw")), bytes);
  EXPECT_CONTAINS(errorOf([&] { writeVolume(source, pathOf("volume.jpg")); }), ".nrrd");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(VolumeSourceTest, FailedOrCancelledWritesLeaveNothing) {
  for (const char* name : {"volume.nrrd", "volume.mhd", "volume.raw"}) {
    BytesSource source(Index3(2, 3, 4), VoxelType::kUint8, std::string(24, 'x'));
    VolumeWriteOptions options;
    options.slab_bytes = 6;
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
    EXPECT_EQ(readFile(path), "old");
    file.commit();
  }
  EXPECT_EQ(readFile(path), "0123ab6789XYtail");
  EXPECT_EQ(filesLeft(), 1u);
  {
    AtomicFile abandoned(path);
    abandoned.write("new", 3);
    EXPECT_EQ(filesLeft(), 2u);
  }
  EXPECT_EQ(readFile(path), "0123ab6789XYtail");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(VolumeSourceTest, AtomicFileTakesOverLeftoversButNotLivingFiles) {
  write("file.partial", "a leftover that is longer than what is written");
  AtomicFile file(pathOf("file"));
  EXPECT_CONTAINS(errorOf([&] { AtomicFile second(pathOf("file")); }), "another process");
  file.write("new", 3);
  file.commit();
  EXPECT_EQ(readFile(pathOf("file")), "new");
  AtomicFile third(pathOf("file"));  // the lock went with the commit
}

TEST_F(VolumeSourceTest, AtomicFileRefusesPlacesThatCannotBeWritten) {
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(pathOf("no/such/file")); }),
                  "No such file or directory; create the folder");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(folder_.string()); }), "folder");
  EXPECT_CONTAINS(errorOf([&] { AtomicFile file(""); }), "-o");
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
    const auto source = openItkSource(path);
    EXPECT_EQ(source->info().voxels, Index3(4, 3, 2)) << path;
    ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16) << path;
    EXPECT_EQ(readVoxels<std::int16_t>(*source, 1), values) << path;
  }
}

TEST_F(VolumeSourceTest, WideIntegersBecomeFloatsWithANote) {
  const std::vector<std::int64_t> values = {-5, 0, 7, 1 << 20, 3, 4, 5, 6};
  const auto source =
      openItkSource(write("wide.nrrd",
                          "NRRD0004\ntype: int64\ndimension: 3\nsizes: 2 2 2\nendian: little\n"
                          "encoding: raw\n\n" +
                              bytesOfValues(values)));
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
  EXPECT_CONTAINS(nrrd("dimension: 4\nsizes: 4 4 4 3\n"), "3 time steps");
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
  EXPECT_CONTAINS(errorOf([&] { openItkSource(pathOf("none.nrrd")); }), "No such file");
  fs::create_directory(folder_ / "nothing");
  EXPECT_CONTAINS(errorOf([&] { openItkSource(pathOf("nothing")); }), "neither DICOM");
}

// A minimal grey little-endian TIFF.
std::string tiffBytes(std::uint32_t width, std::uint32_t height, std::uint16_t bits,
                      const std::string& pixels) {
  std::string bytes = "II*";
  const auto add16 = [&](std::uint32_t v) {
    bytes += static_cast<char>(v & 255);
    bytes += static_cast<char>(v >> 8 & 255);
  };
  const auto add32 = [&](std::uint32_t v) {
    add16(v & 0xffff);
    add16(v >> 16);
  };
  bytes += '\0';
  add32(8);
  const std::vector<std::array<std::uint32_t, 2>> entries = {
      {256, width}, {257, height}, {258, bits},
      {259, 1},     {262, 1},      {273, 8 + 2 + 9 * 12 + 4},
      {277, 1},     {278, height}, {279, width * height * bits / 8}};
  add16(static_cast<std::uint32_t>(entries.size()));
  for (const auto& [tag, value] : entries) {
    add16(tag);
    add16(4);  // LONG
    add32(1);
    add32(value);
  }
  add32(0);
  return bytes + pixels;
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
    const auto source = openItkSource(folder_.string());
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
  EXPECT_CONTAINS(errorOf([&] { openItkSource(pathOf("s3.tif")); }), "2-D");
}

// ---- real volumes -------------------------------------------------------------------------------

TEST_F(VolumeSourceTest, HeadCtIsTheSameAsNrrdAndAsDicom) {
  const fs::path folder = kSharedData / "vhf_head_ct";
  SKIP_WITHOUT(folder);
  const auto nrrd = openItkSource((folder / "vhf_head.nrrd").string());
  const auto dicom = openItkSource((folder / "dicom").string());
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

// Three consecutive slices of the real series, to be spoiled.
class DicomFolderTest : public VolumeSourceTest {
 protected:
  fs::path slice(int number) const {
    return kSharedData / "vhf_head_ct" / "dicom" / ("vhf." + std::to_string(number) + ".dcm");
  }
  void copySlices(std::initializer_list<int> numbers) const {
    // Names against the order of the positions: it is the positions that count.
    for (const int n : numbers) write(std::to_string(9999 - n), readFile(slice(n)));
  }
};

TEST_F(DicomFolderTest, SlicesAreSortedByPosition) {
  SKIP_WITHOUT(slice(1600));
  copySlices({1602, 1600, 1601});
  const auto source = openItkSource(folder_.string());
  EXPECT_EQ(source->info().voxels, Index3(512, 512, 3));
  EXPECT_EQ(source->info().geometry.origin.z, 1599);
  const auto values = readVoxels<std::int16_t>(*source, 1);
  std::int16_t stored = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string bytes = readFile(slice(1600 + static_cast<int>(k)));
    // Uncompressed pixels end the file; voxel (200, 300).
    const std::size_t pixel = 300 * 512 + 200;
    std::memcpy(&stored, bytes.data() + bytes.size() - 512 * 512 * 2 + 2 * pixel, 2);
    EXPECT_EQ(values[k * 512 * 512 + pixel], stored - 1024);
  }
}

TEST_F(DicomFolderTest, MissingAndDoubledSlicesAreRefused) {
  SKIP_WITHOUT(slice(1600));
  copySlices({1600, 1601, 1603, 1604});
  EXPECT_CONTAINS(errorOf([&] { openItkSource(folder_.string()); }), "mm apart");
  copySlices({1602});
  EXPECT_EQ(openItkSource(folder_.string())->info().voxels.z, 5);
  write("copy", readFile(slice(1601)));
  EXPECT_CONTAINS(errorOf([&] { openItkSource(folder_.string()); }), "same position");
}

TEST_F(DicomFolderTest, SeveralSeriesAreListed) {
  SKIP_WITHOUT(slice(1600));
  copySlices({1600, 1601});
  std::string other = readFile(slice(1602));
  const std::string uid = "1.2.826.0.1.3680043.2.1125.1.75064541463040.2005072610384286453";
  const std::string other_uid = "1.2.826.0.1.3680043.2.1125.1.75064541463040.2005072610384286454";
  const std::size_t at = other.find(uid);
  ASSERT_NE(at, std::string::npos);
  other.replace(at, uid.size(), other_uid);
  write("other", other);
  const std::string message = errorOf([&] { openItkSource(folder_.string()); });
  EXPECT_CONTAINS(message, uid + " (2 images)");
  EXPECT_CONTAINS(message, other_uid + " (1 image)");
}

TEST_F(DicomFolderTest, DamagedSlicesAreErrorsThatNameTheFile) {
  SKIP_WITHOUT(slice(1600));
  copySlices({1600, 1601, 1602});
  const std::string damaged = pathOf(std::to_string(9999 - 1601));
  for (const std::uintmax_t bytes : {400'000u, 1500u}) {
    fs::resize_file(damaged, bytes);
    testing::internal::CaptureStderr();
    const std::string message = errorOf([&] { openAndRead(folder_.string()); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    EXPECT_CONTAINS(message, damaged);
  }
}

TEST_F(DicomFolderTest, EveryPrefixOfTheHeaderIsAnErrorAndNeverACrash) {
  SKIP_WITHOUT(slice(1600));
  const std::string whole = readFile(slice(1600));
  for (std::size_t bytes = 0; bytes < 1400; bytes += 3) {
    const std::string path = write("prefix.dcm", whole.substr(0, bytes));
    EXPECT_THROW(openItkSource(path), Error) << bytes;
  }
}

TEST_F(VolumeSourceTest, ToothIsBigEndian) {
  const fs::path path = kSharedData / "tooth_u16be" / "tooth.nhdr";
  SKIP_WITHOUT(path);
  const auto source = openItkSource(path.string());
  EXPECT_EQ(source->info().voxels, Index3(103, 94, 161));
  ASSERT_EQ(source->info().voxel_type, VoxelType::kUint16);
  const auto values = readVoxels<std::uint16_t>(*source, 10);
  EXPECT_EQ(*std::max_element(values.begin(), values.end()), 1300);
  const auto raw = openRawSource((kSharedData / "tooth_u16be" / "tooth.raw").string(),
                                 {Index3(103, 94, 161), "u16", true});
  EXPECT_EQ(readVoxels<std::uint16_t>(*raw, 7), values);
}

TEST_F(VolumeSourceTest, HeadsqHasItsSpacing) {
  const fs::path path = kSharedData / "headsq_quarter" / "headsq_quarter.mhd";
  SKIP_WITHOUT(path);
  const auto source = openItkSource(path.string());
  EXPECT_EQ(source->info().voxels, Index3(64, 64, 93));
  EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(3.2, 3.2, 1.5));
  ASSERT_EQ(source->info().voxel_type, VoxelType::kUint16);
  EXPECT_EQ(bytesOfValues(readVoxels<std::uint16_t>(*source)),
            readFile(path.parent_path() / "headsq_quarter_64x64x93_uint16_le.raw"));
}

TEST_F(VolumeSourceTest, NiftiSlopeIsAppliedAndTruncationIsFound) {
  const fs::path path = kSharedData / "mr_nifti" / "MR.nii.gz";
  SKIP_WITHOUT(path);
  const auto source = openItkSource(path.string());
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
  const std::string bytes = readFile(path);
  EXPECT_CONTAINS(
      errorOf([&] { openAndRead(write("cut.nii.gz", bytes.substr(0, bytes.size() / 2))); }),
      "cut short");
  std::string flipped = bytes;
  flipped[bytes.size() / 2] = static_cast<char>(flipped[bytes.size() / 2] ^ 0x10);
  EXPECT_CONTAINS(errorOf([&] { openAndRead(write("flipped.nii.gz", flipped)); }), "damaged");
}

}  // namespace
}  // namespace isobrick
