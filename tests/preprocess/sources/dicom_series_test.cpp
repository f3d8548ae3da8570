// DICOM series made byte by byte: which voxel type they get, what opening them reads, and files
// that lack the preamble.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/file_bytes.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;

// One slice of a CT, and what a test may want to be different.
struct Slice {
  int number = 1;
  int columns = 4, rows = 3;
  int bits_stored = 16;
  bool is_signed = true;
  std::string slope = "1", intercept = "-1024";  // empty: not there
  std::optional<int> smallest, largest, padding;
  std::vector<int> pixels;  // all rows; missing ones are 0
  std::string syntax = "1.2.840.10008.1.2.1";
  std::string packed;  // what stands for the pixels of a packed syntax
  std::string series_uid = "1.2.3.4", series_number, description, time;  // empty: not there
  std::optional<int> height;                                             // otherwise the number
  bool has_position = true;
  std::string photometric = "MONOCHROME2";
  std::string position;                        // otherwise 0\\0\\height
  std::string spacing = "1\\1";                // of pixels
  std::map<std::uint32_t, const char*> types;  // of elements, other than the standard's
  std::string private_element;                 // before group 20
  std::optional<int> high_bit;                 // otherwise that below bits_stored
};

class DicomBytes {
 public:
  explicit DicomBytes(bool is_explicit) : is_explicit_(is_explicit) {}

  void add(std::uint32_t tag, const char* type, std::string value) {
    if (const auto other = types.find(tag); other != types.end()) type = other->second;
    if (value.size() % 2 != 0) value += type[0] == 'U' && type[1] == 'I' ? '\0' : ' ';
    addTag(tag);
    static const std::set<std::string> kLong = {"OW", "OB", "SQ", "UN", "UT"};
    const bool is_long = kLong.contains(type);
    if (is_explicit_) bytes += type;
    if (is_explicit_ && is_long) add16(0);
    if (is_explicit_ && !is_long)
      add16(static_cast<std::uint32_t>(value.size()));
    else
      add32(static_cast<std::uint32_t>(value.size()));
    bytes += value;
  }
  void addNumber(std::uint32_t tag, int value) {
    const auto bits = static_cast<std::uint32_t>(value);
    add(tag, "US", {static_cast<char>(bits & 255), static_cast<char>(bits >> 8 & 255)});
  }
  void addTag(std::uint32_t tag) {
    add16(tag >> 16);
    add16(tag & 0xffff);
  }
  void add16(std::uint32_t v) {
    bytes += static_cast<char>(v & 255);
    bytes += static_cast<char>(v >> 8 & 255);
  }
  void add32(std::uint32_t v) {
    add16(v & 0xffff);
    add16(v >> 16);
  }

  std::string bytes;
  std::map<std::uint32_t, const char*> types;

 private:
  bool is_explicit_;
};

const char* const kCtStorage = "1.2.840.10008.5.1.4.1.1.2";
const char* const kImplicit = "1.2.840.10008.1.2";

// From group 8 on.
std::string dataSetOf(const Slice& slice) {
  DicomBytes d(slice.syntax != kImplicit);
  d.types = slice.types;
  const std::string uid = "1.2.3." + std::to_string(slice.number);
  d.add(0x00080016, "UI", kCtStorage);
  d.add(0x00080018, "UI", uid);
  d.add(0x00080060, "CS", "CT");
  if (!slice.description.empty()) d.add(0x0008103e, "LO", slice.description);
  d.add(0x00180050, "DS", "1");
  d.bytes += slice.private_element;
  d.add(0x0020000d, "UI", "1.2.3");
  d.add(0x0020000e, "UI", slice.series_uid);
  if (!slice.series_number.empty()) d.add(0x00200011, "IS", slice.series_number);
  d.add(0x00200013, "IS", std::to_string(slice.number));
  if (slice.has_position)
    d.add(0x00200032, "DS",
          slice.position.empty() ? "0\\0\\" + std::to_string(slice.height.value_or(slice.number))
                                 : slice.position);
  d.add(0x00200037, "DS", "1\\0\\0\\0\\1\\0");
  if (!slice.time.empty()) d.add(0x00200100, "IS", slice.time);
  d.addNumber(0x00280002, 1);
  d.add(0x00280004, "CS", slice.photometric);
  d.addNumber(0x00280010, slice.rows);
  d.addNumber(0x00280011, slice.columns);
  d.add(0x00280030, "DS", slice.spacing);
  d.addNumber(0x00280100, 16);
  d.addNumber(0x00280101, slice.bits_stored);
  d.addNumber(0x00280102, slice.high_bit.value_or(slice.bits_stored - 1));
  d.addNumber(0x00280103, slice.is_signed ? 1 : 0);
  if (slice.smallest) d.addNumber(0x00280106, *slice.smallest);
  if (slice.largest) d.addNumber(0x00280107, *slice.largest);
  if (slice.padding) d.addNumber(0x00280120, *slice.padding);
  if (!slice.intercept.empty()) d.add(0x00281052, "DS", slice.intercept);
  if (!slice.slope.empty()) d.add(0x00281053, "DS", slice.slope);
  if (!slice.packed.empty()) {
    d.addTag(0x7fe00010);
    d.bytes += "OB";
    d.add16(0);
    d.add32(0xffffffff);
    d.addTag(0xfffee000);  // an empty table of offsets
    d.add32(0);
    d.addTag(0xfffee000);
    d.add32(static_cast<std::uint32_t>(slice.packed.size()));
    d.bytes += slice.packed;
    d.addTag(0xfffee0dd);
    d.add32(0);
    return d.bytes;
  }
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(slice.columns * slice.rows));
  for (std::size_t i = 0; i < slice.pixels.size(); ++i)
    pixels[i] = static_cast<std::uint16_t>(slice.pixels[i]);
  d.add(0x7fe00010, "OW", bytesOfValues(pixels));
  return d.bytes;
}

std::string metaOf(const Slice& slice) {
  DicomBytes group(true);
  group.add(0x00020001, "OB", std::string("\0\1", 2));
  group.add(0x00020002, "UI", kCtStorage);
  group.add(0x00020003, "UI", "1.2.3." + std::to_string(slice.number));
  group.add(0x00020010, "UI", slice.syntax);
  DicomBytes d(true);
  d.addTag(0x00020000);
  d.bytes += "UL";
  d.add16(4);
  d.add32(static_cast<std::uint32_t>(group.bytes.size()));
  return d.bytes + group.bytes;
}

std::string fileOf(const Slice& slice) {
  return std::string(128, '\0') + "DICM" + metaOf(slice) + dataSetOf(slice);
}

class DicomSeriesTest : public VolumeFilesTest {
 protected:
  // `count` slices like `slice`; changed by `edit`.
  void writeSeries(const Slice& slice, int count, const std::function<void(Slice&)>& edit = {}) {
    for (int k = 1; k <= count; ++k) {
      Slice one = slice;
      one.number = k;
      if (edit) edit(one);
      write(std::to_string(k) + ".dcm", fileOf(one));
    }
  }
  std::unique_ptr<VolumeSource> open(const OpenOptions& options = {}) {
    return openItkSource(folder_.string(), options);
  }
};

// ---- which type -----------------------------------------------------------------------------

TEST_F(DicomSeriesTest, OpeningDecodesNoPixels) {
  Slice slice;
  slice.syntax = "1.2.840.10008.1.2.5";  // RLE
  slice.packed = std::string(100, '\x7f');
  writeSeries(slice, 3);
  const auto source = open();
  EXPECT_EQ(source->info().voxels, Index3(4, 3, 3));
  EXPECT_EQ(source->info().voxel_type, VoxelType::kInt16);
  EXPECT_CONTAINS(errorOf([&] { readAll(*source); }), "1.dcm");
}

TEST_F(DicomSeriesTest, EveryHeaderIsReadOnce) {
  writeSeries({}, 5);
  write("notes.txt", "no slice");
  const std::uint64_t before = dicomHeadersRead();
  const auto source = open();
  readAll(*source);
  EXPECT_EQ(dicomHeadersRead() - before, 6u);
}

TEST_F(DicomSeriesTest, AHeadCtKeepsInt16) {
  Slice slice;  // 16 bits are stored, and the intercept makes more values of them than int16 has
  slice.pixels = {0, 1024, 4095, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  writeSeries(slice, 2);
  const auto source = open();
  ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16);
  EXPECT_EQ(source->info().notes.size(), 1u);  // of slope and intercept
  const auto values = readVoxels<std::int16_t>(*source);
  EXPECT_EQ(values[0], -1024);
  EXPECT_EQ(values[2], 4095 - 1024);
}

TEST_F(DicomSeriesTest, ValuesThatLeaveTheTypeAreRefusedOrFloats) {
  writeSeries({}, 4, [](Slice& slice) {
    slice.pixels = {0, 0, slice.number == 3 ? -32768 : -31744};
  });
  {
    const auto source = open();
    ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16);
    const std::string message = errorOf([&] { readAll(*source); });
    for (const char* part : {"slice 2", "3.dcm", "-33792", "int16", "<dicom float>"})
      EXPECT_CONTAINS(message, part);
  }
  OpenOptions options;
  options.dicom_float32 = true;
  const auto source = open(options);
  ASSERT_EQ(source->info().voxel_type, VoxelType::kFloat32);
  EXPECT_EQ(source->info().notes.size(), 2u);
  const auto values = readVoxels<float>(*source);
  EXPECT_EQ(values[2], -32768);
  EXPECT_EQ(values[2 * 12 + 2], -33792);
}

TEST_F(DicomSeriesTest, APaddingValueThatLeavesTheTypeMakesFloats) {
  Slice slice;
  slice.padding = -32768;
  slice.pixels = {-32768, 10};
  writeSeries(slice, 2);
  const auto source = open();
  ASSERT_EQ(source->info().voxel_type, VoxelType::kFloat32);
  EXPECT_CONTAINS(source->info().notes.front(), "-33792 to 31743");
  EXPECT_EQ(readVoxels<float>(*source)[0], -33792);
}

TEST_F(DicomSeriesTest, SlopesOfTheirOwnAreAllTakenIntoAccount) {
  const auto typeOf = [&](const std::vector<const char*>& slopes) {
    Slice slice;
    slice.bits_stored = 12;
    slice.is_signed = false;
    slice.intercept = "0";
    slice.pixels = {0, 7, 4095};
    writeSeries(slice, static_cast<int>(slopes.size()),
                [&](Slice& s) { s.slope = slopes[static_cast<std::size_t>(s.number) - 1]; });
    return open();
  };
  EXPECT_EQ(typeOf({"1", "8"})->info().voxel_type, VoxelType::kInt16);  // 0 .. 32760
  const auto unsigned_values = typeOf({"1", "16"});                     // 0 .. 65520
  ASSERT_EQ(unsigned_values->info().voxel_type, VoxelType::kUint16);
  EXPECT_EQ(readVoxels<std::uint16_t>(*unsigned_values)[12 + 2], 65520);
  EXPECT_EQ(typeOf({"1", "17"})->info().voxel_type, VoxelType::kFloat32);
  const auto fractions = typeOf({"0.5", "0.25"});
  ASSERT_EQ(fractions->info().voxel_type, VoxelType::kFloat32);
  EXPECT_CONTAINS(fractions->info().notes.front(), "no whole number");
  const auto values = readVoxels<float>(*fractions);
  EXPECT_EQ(values[1], 3.5f);
  EXPECT_EQ(values[12 + 1], 1.75f);
}

TEST_F(DicomSeriesTest, BitsThatAreNotStoredDoNotWrapAround) {
  Slice slice;
  slice.bits_stored = 12;
  slice.is_signed = false;
  slice.pixels = {0xf000 + 100, 100};  // the upper bits held an overlay once
  writeSeries(slice, 2);
  const auto source = open();
  ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16);
  const auto values = readVoxels<std::int16_t>(*source);
  EXPECT_EQ(values[0], 100 - 1024);
  EXPECT_EQ(values[1], 100 - 1024);
}

TEST(DicomVoxelTypeTest, FollowsItsRules) {
  const auto map = [](bool is_signed, int bits, double slope, double intercept) {
    DicomValueMap m;
    m.is_signed = is_signed;
    m.bits_stored = bits;
    m.bits_allocated = bits > 16 ? 32 : 16;
    m.slope = slope;
    m.intercept = intercept;
    return m;
  };
  const auto type = [](std::vector<DicomValueMap> maps) { return dicomVoxelType(maps).type; };
  // By the bits.
  EXPECT_EQ(type({map(true, 16, 1, 0)}), VoxelType::kInt16);
  EXPECT_EQ(type({map(false, 16, 1, 0)}), VoxelType::kUint16);
  EXPECT_EQ(type({map(false, 15, 1, 0)}), VoxelType::kInt16);
  EXPECT_EQ(type({map(true, 16, -1, -1)}), VoxelType::kInt16);
  EXPECT_EQ(type({map(true, 16, 1, 32768)}), VoxelType::kUint16);
  EXPECT_EQ(type({map(false, 12, 1, -1024), map(false, 12, 2, 60000)}), VoxelType::kFloat32);
  EXPECT_EQ(type({map(false, 12, 1.5, 0)}), VoxelType::kFloat32);
  EXPECT_EQ(type({map(false, 12, 1, 0.5)}), VoxelType::kFloat32);
  EXPECT_EQ(type({map(false, 32, 1, 0)}), VoxelType::kFloat32);
  EXPECT_EQ(type({map(false, 12, 1e300, 1e300)}), VoxelType::kFloat32);
  // A shift only.
  EXPECT_EQ(type({map(false, 16, 1, -1024)}), VoxelType::kInt16);
  EXPECT_EQ(type({map(false, 16, 1, 5)}), VoxelType::kUint16);
  EXPECT_EQ(type({map(false, 16, 2, 0)}), VoxelType::kFloat32);
  // By what the headers claim, if all do.
  DicomValueMap claims = map(false, 16, 2, 0);
  claims.smallest = 0;
  claims.largest = 16383;
  EXPECT_EQ(type({claims, claims}), VoxelType::kInt16);
  EXPECT_EQ(type({claims, map(false, 16, 2, 0)}), VoxelType::kFloat32);
  claims.padding = 65535;
  EXPECT_EQ(type({claims}), VoxelType::kFloat32);
  claims = map(false, 16, 1, -1024);
  claims.smallest = 0;
  claims.largest = 65535;
  EXPECT_EQ(type({claims}), VoxelType::kFloat32);
  EXPECT_NE(dicomVoxelType({claims}).note, "");
  std::swap(claims.smallest, claims.largest);  // nonsense is no claim
  EXPECT_EQ(type({claims}), VoxelType::kInt16);
}

TEST_F(DicomSeriesTest, TheHighBitSaysWhereTheStoredBitsAre) {
  Slice slice;
  slice.bits_stored = 12;
  slice.high_bit = 15;
  slice.intercept = "0";
  slice.pixels = {100 << 4, (4000 << 4) + 7, 0xfff0};
  slice.is_signed = false;
  writeSeries(slice, 2);
  const auto values = readVoxels<std::int16_t>(*open());
  EXPECT_EQ(std::vector<std::int16_t>(values.begin(), values.begin() + 3),
            std::vector<std::int16_t>({100, 4000, 4095}));
  slice.is_signed = true;
  writeSeries(slice, 2);
  EXPECT_EQ(readVoxels<std::int16_t>(*open())[2], -1);
}

// ---- one grid -------------------------------------------------------------------------------

TEST_F(DicomSeriesTest, SlicesBesideTheLineAreRefused) {
  const auto messageOf = [&](const std::function<std::string(int)>& positionOf) {
    writeSeries({}, 12, [&](Slice& slice) { slice.position = positionOf(slice.number); });
    return errorOf([&] { open(); });
  };
  const auto at = [](double x, double y, double z) {
    std::ostringstream text;
    text << x << '\\' << y << '\\' << z;
    return text.str();
  };
  // One slice, half of them, every second; far, and by a pixel.
  EXPECT_CONTAINS(messageOf([&](int k) { return at(-8.4, k == 5 ? 24.5 : -6, 2.5 * k); }),
                  "5.dcm' is 30.5 mm (30.5 voxels) beside the line");
  EXPECT_CONTAINS(messageOf([&](int k) { return at(k > 6 ? 1 : 0, 0, k); }), "beside the line");
  EXPECT_CONTAINS(messageOf([&](int k) { return at(0, k % 2 * 9.1, 2.5 * k); }), "beside the line");
  EXPECT_CONTAINS(messageOf([&](int k) { return at(0, 0.01 * k, 2.5 * k); }), "tilted gantry");
  EXPECT_CONTAINS(messageOf([&](int k) { return at(0, 0, k + (k == 7 ? 0.03 : 0)); }), "mm apart");
}

TEST_F(DicomSeriesTest, PositionsThatAreRoundedAreEven) {
  for (const double gap : {0.97, 6.37}) {
    writeSeries({}, 22, [&](Slice& slice) {
      const auto rounded = [](double v) {
        std::ostringstream text;
        text << std::round(10 * v) / 10;
        return text.str();
      };
      slice.position = rounded(-7.9) + '\\' + rounded(0) + '\\' + rounded(gap * slice.number);
    });
    const VolumeInfo info = open()->info();
    EXPECT_NEAR(info.geometry.spacing.z, gap, 0.1 / 21);
    EXPECT_EQ(info.geometry.direction[2], glm::dvec3(0, 0, 1));
  }
}

TEST_F(DicomSeriesTest, TwoPixelSpacingsAreNoGrid) {
  writeSeries({}, 4, [](Slice& slice) { slice.spacing = slice.number > 2 ? "1\\1.01" : "1\\1"; });
  EXPECT_CONTAINS(errorOf([&] { open(); }), "its pixel spacing differs");
}

// ---- which files ----------------------------------------------------------------------------

TEST_F(DicomSeriesTest, FilesWithoutPreambleAreRead) {
  for (const std::string syntax : {"1.2.840.10008.1.2.1", kImplicit})
    for (const bool with_meta : {false, true}) {
      std::vector<std::int16_t> expected;
      for (int k = 1; k <= 3; ++k) {
        Slice slice;
        slice.number = k;
        slice.syntax = syntax;
        for (int i = 0; i < 12; ++i) slice.pixels.push_back(100 * k + i);
        for (const int pixel : slice.pixels)
          expected.push_back(static_cast<std::int16_t>(pixel - 1024));
        write(std::to_string(k), (with_meta ? metaOf(slice) : "") + dataSetOf(slice));
      }
      testing::internal::CaptureStderr();
      const auto source = open();
      EXPECT_EQ(source->info().format, "DICOM series");
      ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16) << syntax;
      EXPECT_EQ(readVoxels<std::int16_t>(*source), expected) << syntax << with_meta;
      EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
      // One that was cut in its pixels is no other file, but a damaged one.
      const std::string whole = readBytes(pathOf("2"));
      write("2", whole.substr(0, whole.size() - 5));
      EXPECT_CONTAINS(errorOf([&] { open(); }), pathOf("2"));
    }
}

TEST_F(DicomSeriesTest, ElementsOfOtherTypesAreRead) {
  const std::pair<std::uint32_t, const char*> kTypes[] = {
      {0x00280030, "UT"}, {0x00280030, "LO"}, {0x00280030, "UN"}, {0x00281053, "UN"},
      {0x00281052, "LO"}, {0x00281052, "UT"}, {0x00200032, "UN"}, {0x00200037, "ST"},
      {0x00280010, "SS"}, {0x00280011, "UN"}, {0x00280101, "UN"}, {0x00280103, "SS"},
      {0x00280004, "LO"}, {0x7fe00010, "UN"}, {0x7fe00010, "OB"}, {0x0020000e, "UN"}};
  for (const auto& [tag, type] : kTypes) {
    Slice slice;
    slice.pixels = {1, 2, 3, 1024};
    slice.spacing = "0.6\\0.7";
    slice.types = {{tag, type}};
    writeSeries(slice, 3);
    const auto source = open();
    EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(0.7, 0.6, 1)) << tag << type;
    EXPECT_EQ(readVoxels<std::int16_t>(*source)[3], 0) << tag << type;
  }
}

// Private elements: two bytes of a length behind what is no type, four, or no type at all.
TEST_F(DicomSeriesTest, ElementsOfUnknownTypesArePassedOver) {
  const std::string tag("\x19\0\x01\x10", 4);
  for (const std::string& head :
       {std::string("  \4\0", 4), std::string("??\4\0", 4), std::string("\0\0\4\0", 4),
        std::string("\6\0\4\0", 4), std::string("ZZ\0\0\4\0\0\0", 8), std::string("\4\0\0\0", 4)}) {
    Slice slice;
    slice.private_element = tag + head + "abcd";
    slice.pixels = {1025};
    writeSeries(slice, 2);
    EXPECT_EQ(readVoxels<std::int16_t>(*open())[0], 1) << head;
  }
}

TEST_F(DicomSeriesTest, FilesInFoldersBelowAreFound) {
  for (const char* below : {"ST0/SE0/", "ST0/SE1/"}) {
    fs::create_directories(pathOf(below));
    for (int k = 1; k <= 3; ++k) {
      Slice slice;
      slice.number = k;
      slice.series_uid = std::string("1.2.") + below[6];
      write(below + std::to_string(k), fileOf(slice));
    }
  }
  DicomBytes d(true);
  d.add(0x00041130, "CS", "MEDIUM");
  write("DICOMDIR", std::string(128, '\0') + "DICM" + metaOf({}) + d.bytes);
  write("LOGO.PNG", "a picture of the medium");
  EXPECT_CONTAINS(errorOf([&] { open(); }), "2 DICOM series");
  fs::remove_all(pathOf("ST0/SE1"));
  EXPECT_EQ(open()->info().voxels, Index3(4, 3, 3));
  EXPECT_EQ(openVolume(pathOf("DICOMDIR"))->info().voxels, Index3(4, 3, 3));
  fs::remove(pathOf("DICOMDIR"));
  fs::remove(pathOf("LOGO.PNG"));
  EXPECT_EQ(open()->info().voxels, Index3(4, 3, 3));
}

TEST_F(DicomSeriesTest, OtherFilesAreNotMistakenForThem) {
  writeSeries({}, 3);
  const std::string set = dataSetOf({});
  const std::string begin = set.substr(0, set.size() / 2);
  write("begins_alike", begin);
  write("begins_alike_and_goes_on", begin + std::string(5000, '\x42'));
  write("two_bytes", std::string("\x08\x00", 2));
  write("zeros", std::string("\x08\x00", 2) + std::string(3000, '\0'));
  // Tags that do not ascend: no data set.
  write("backwards", set.substr(0, 8 + 26) + set);
  DicomBytes no_size(true);
  no_size.add(0x00080060, "CS", "CT");
  no_size.add(0x7fe00010, "OW", "pixels");
  write("without_size", no_size.bytes);
  EXPECT_EQ(open()->info().voxels.z, 3);
  EXPECT_EQ(readDicomHeader(pathOf("without_size")).state, DicomHeader::State::kNotDicom);
}

// ---- which volume ---------------------------------------------------------------------------

TEST_F(DicomSeriesTest, OneOfSeveralSeriesIsTakenByNumberOrUid) {
  for (int series = 1; series <= 3; ++series)
    for (int k = 1; k <= series + 1; ++k) {
      Slice slice;
      slice.number = k;
      slice.series_uid = "1.2.3." + std::to_string(series);
      slice.series_number = std::to_string(series < 3 ? 10 * series : 10);
      slice.description = "SCAN\n" + std::to_string(series);
      slice.pixels = {series};
      write(std::to_string(series) + "." + std::to_string(k), fileOf(slice));
    }
  const auto messageOf = [&](const std::string& series) {
    OpenOptions options;
    options.series = series;
    return errorOf([&] { open(options); });
  };
  EXPECT_CONTAINS(messageOf(""), "20 'SCAN 2' (3 slices of 4 x 3, UID 1.2.3.2)");
  EXPECT_CONTAINS(messageOf(""), "<series>");
  EXPECT_CONTAINS(messageOf("7"), "no series '7' among 3");
  EXPECT_CONTAINS(messageOf("10"), "several series '10'");
  for (const char* name : {"20", "1.2.3.2"}) {
    OpenOptions options;
    options.series = name;
    const auto source = open(options);
    EXPECT_EQ(source->info().voxels.z, 3);
    EXPECT_EQ(readVoxels<std::int16_t>(*source)[0], 2 - 1024);
  }
}

TEST_F(DicomSeriesTest, StrayFilesDoNotDecideWhatAFolderIs) {
  writeSeries({}, 4);
  const std::string picture = tiffBytes(4, 3, 8, std::string(12, '\7'));
  for (const char* name : {"thumbnail.tif", "README", "photo.jpg", "key.png", "stray.exr"})
    write(name, picture);
  const auto series = openVolume(folder_.string());
  EXPECT_EQ(series->info().format, "DICOM series");
  EXPECT_EQ(series->info().voxels.z, 4);
  EXPECT_CONTAINS(series->info().notes.front(), "1 TIFF slice in the folder was left out");
  for (int k = 0; k < 6; ++k) write("page" + std::to_string(k) + ".tif", picture);
  EXPECT_EQ(openVolume(folder_.string())->info().voxels.z, 6);  // the thumbnail is no page
  for (const char* name : {"1.dcm", "2.dcm", "3.dcm"}) fs::remove(pathOf(name));
  EXPECT_EQ(openVolume(folder_.string())->info().format, "TIFF stack");
  // As many of both: nobody can tell.
  for (int k = 0; k < 6; ++k) fs::remove(pathOf("page" + std::to_string(k) + ".tif"));
  EXPECT_CONTAINS(errorOf([&] { openVolume(folder_.string()); }), "1 DICOM slice and 1 TIFF slice");
}

TEST_F(DicomSeriesTest, OneOfSeveralTimesIsTaken) {
  writeSeries({}, 6, [](Slice& slice) {
    slice.height = (slice.number + 1) / 2;
    slice.time = std::to_string(10 + slice.number % 2);
    slice.pixels = {slice.number};
  });
  EXPECT_CONTAINS(errorOf([&] { open(); }), "2 volumes, of time 0 to 1 <time>");
  OpenOptions options;
  options.time = 1;
  const auto source = open(options);
  EXPECT_EQ(source->info().encoding, "time 1");
  const auto values = readVoxels<std::int16_t>(*source);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_EQ(values[12 * k], static_cast<int>(2 * k) + 1 - 1024) << k;
  options.time = 2;
  EXPECT_CONTAINS(errorOf([&] { open(options); }), "no time 2");
}

TEST_F(DicomSeriesTest, WhatIsAssumedIsSaid) {
  Slice slice;
  slice.has_position = false;
  slice.photometric = "MONOCHROME1";
  writeSeries(slice, 3);
  const auto notesOf = [&](const OpenOptions& options) {
    const auto source = openVolume(folder_.string(), options);
    std::string all;
    for (const std::string& note : source->info().notes) all += note + "\n";
    return all;
  };
  EXPECT_CONTAINS(notesOf({}), "their distance, 1 mm, is an assumption");
  EXPECT_CONTAINS(notesOf({}), "MONOCHROME1");
  OpenOptions options;
  options.spacing = {1, 1, 2.5};
  EXPECT_EQ(notesOf(options).find("assumption"), std::string::npos);
  EXPECT_CONTAINS(notesOf(options), "the spacing 1,1,2.5 was given in place of 1,1,1");
  EXPECT_EQ(openVolume(folder_.string(), options)->info().geometry.spacing, glm::dvec3(1, 1, 2.5));
}

// ---- frames of enhanced files -----------------------------------------------------------------

// An item of a sequence, and a sequence of items, with their lengths or open.
std::string itemOf(const std::string& content, bool is_open) {
  DicomBytes d(true);
  d.addTag(0xfffee000);
  d.add32(is_open ? 0xffffffff : static_cast<std::uint32_t>(content.size()));
  d.bytes += content;
  if (is_open) {
    d.addTag(0xfffee00d);
    d.add32(0);
  }
  return d.bytes;
}
std::string sequenceOf(std::uint32_t tag, const std::string& items, bool is_open) {
  DicomBytes d(true);
  d.addTag(tag);
  d.bytes += "SQ";
  d.add16(0);
  d.add32(is_open ? 0xffffffff : static_cast<std::uint32_t>(items.size()));
  d.bytes += items;
  if (is_open) {
    d.addTag(0xfffee0dd);
    d.add32(0);
  }
  return d.bytes;
}

// Frame k has all its pixels 100, its place at heights[k] and the slope k + 1.
std::string enhancedFile(const std::vector<int>& heights, bool is_open) {
  Slice about;
  about.syntax = "1.2.840.10008.1.2.1";
  const auto sequence = [&](std::uint32_t tag, const std::function<void(DicomBytes&)>& fill) {
    DicomBytes d(true);
    fill(d);
    return sequenceOf(tag, itemOf(d.bytes, is_open), is_open);
  };
  DicomBytes d(true);
  d.add(0x00080016, "UI", kCtStorage);
  d.add(0x00080018, "UI", "1.2.3.1");
  d.addNumber(0x00280002, 1);
  d.add(0x00280004, "CS", "MONOCHROME2");
  d.add(0x00280008, "IS", std::to_string(heights.size()));
  d.addNumber(0x00280010, 3);
  d.addNumber(0x00280011, 2);
  d.addNumber(0x00280100, 16);
  d.addNumber(0x00280101, 8);
  d.addNumber(0x00280102, 7);
  d.addNumber(0x00280103, 0);
  d.bytes += sequenceOf(
      0x52009229,
      itemOf(sequence(0x00209116,
                      [](DicomBytes& in) { in.add(0x00200037, "DS", "1\\0\\0\\0\\1\\0"); }) +
                 sequence(0x00289110, [](DicomBytes& in) { in.add(0x00280030, "DS", "2\\3"); }),
             is_open),
      is_open);
  std::string frames;
  for (std::size_t k = 0; k < heights.size(); ++k)
    frames += itemOf(sequence(0x00209113,
                              [&](DicomBytes& in) {
                                in.add(0x00200032, "DS", "5\\6\\" + std::to_string(heights[k]));
                              }) +
                         sequence(0x00289145,
                                  [&](DicomBytes& in) {
                                    in.add(0x00281052, "DS", "0");
                                    in.add(0x00281053, "DS", std::to_string(k + 1));
                                  }),
                     is_open);
  d.bytes += sequenceOf(0x52009230, frames, is_open);
  d.add(0x7fe00010, "OW", bytesOfValues(std::vector<std::uint16_t>(6 * heights.size(), 100)));
  return std::string(128, '\0') + "DICM" + metaOf(about) + d.bytes;
}

class DicomFramesTest : public VolumeFilesTest {};

TEST_F(DicomFramesTest, AreSortedByPositionEachWithItsSlope) {
  for (const bool is_open : {false, true}) {
    const auto source = openItkSource(write("frames", enhancedFile({8, 4, 6, 2}, is_open)));
    const VolumeInfo& info = source->info();
    EXPECT_EQ(info.voxels, Index3(2, 3, 4));
    EXPECT_EQ(info.geometry.spacing, glm::dvec3(3, 2, 2));
    EXPECT_EQ(info.geometry.origin, glm::dvec3(5, 6, 2));
    ASSERT_EQ(info.voxel_type, VoxelType::kInt16);
    const auto values = readVoxels<std::int16_t>(*source, 1);
    for (std::size_t i = 0; i < values.size(); ++i)
      EXPECT_EQ(values[i], std::vector<int>({400, 200, 300, 100})[i / 6]) << i;
  }
}

TEST_F(DicomFramesTest, GapsAndDoublesAreRefused) {
  EXPECT_CONTAINS(errorOf([&] {
                    openItkSource(write("f", enhancedFile({1, 2, 3, 5}, true)));
                  }),
                  "frame 3 and frame 4 are 2");
  EXPECT_CONTAINS(errorOf([&] {
                    openItkSource(write("f", enhancedFile({1, 2, 2, 3}, true)));
                  }),
                  "at the same position");
}

TEST_F(DicomFramesTest, FramesBesideTheLineAreRefused) {
  std::string file = enhancedFile({1, 2, 3, 4}, true);
  const std::size_t at = file.find("5\\6\\3");
  file.replace(at, 5, "5\\7\\3");
  EXPECT_CONTAINS(errorOf([&] { openItkSource(write("f", file)); }),
                  "frame 3 is 1 mm (0.5 voxels) beside the line");
}

TEST_F(DicomFramesTest, EveryPrefixIsOneErrorAndNoByteCrashes) {
  for (const bool is_open : {false, true}) {
    const std::string whole = enhancedFile({1, 2, 3}, is_open);
    for (std::size_t bytes = 0; bytes < whole.size(); ++bytes)
      EXPECT_NE(errorOf([&] { openAndRead(write("prefix.dcm", whole.substr(0, bytes))); }), "");
    // What is hostile in the groups; in the rest it is GDCM's, and tested of single slices.
    for (std::size_t at = whole.find("MONOCHROME2"); at < whole.size(); ++at)
      for (const char byte : {'\0', '\x7f', '\xff', static_cast<char>(whole[at] + 1)}) {
        std::string changed = whole;
        changed[at] = byte;
        try {
          openAndRead(write("changed.dcm", changed));
        } catch (const Error&) {
        }
      }
  }
}

// ---- interruption ---------------------------------------------------------------------------

TEST_F(DicomSeriesTest, ARequestToStopEndsTheScan) {
  writeSeries({}, 40);
  CancelFlag cancel;
  OpenOptions options;
  options.cancel = &cancel;
  int calls = 0;
  options.progress = [&](std::string_view phase, double) {
    EXPECT_EQ(phase, "scanning slices");
    if (++calls == 10) cancel.request();
  };
  const std::uint64_t before = dicomHeadersRead();
  EXPECT_THROW(open(options), Cancelled);
  EXPECT_EQ(calls, 10);
  EXPECT_EQ(dicomHeadersRead() - before, 10u);
}

TEST_F(DicomSeriesTest, ARequestToStopEndsReading) {
  writeSeries({}, 4);
  CancelFlag cancel;
  OpenOptions options;
  options.cancel = &cancel;
  const auto source = open(options);
  std::vector<std::int16_t> rows(12);
  source->readRows(0, 3, rows.data());
  cancel.request();
  EXPECT_THROW(source->readRows(3, 3, rows.data()), Cancelled);
}

}  // namespace
}  // namespace isobrick
