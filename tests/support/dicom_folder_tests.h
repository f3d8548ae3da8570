// Tests of any folder of DICOM slices: each test takes a few slices of
// a series and spoils them. Instantiated for slices of our own and for those of a real scanner.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <ostream>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/format_sources.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {

// Consecutive slices, each with the number of its place: uncompressed 16-bit pixels that end the
// file, the value being what is stored - 1024.
struct DicomSlices {
  const char* name;
  int first;       // the number of the first slice; at least five follow
  Index3 voxels;   // z is 1
  double first_z;  // its position in mm, the slices being 1 mm apart
  std::string series_uid;
  std::function<std::string(int number)> file;  // the bytes of a slice

  std::size_t pixelBytes() const { return 2 * static_cast<std::size_t>(elementCount(voxels)); }
};
inline void PrintTo(const DicomSlices& slices, std::ostream* out) { *out << slices.name; }

class DicomFolder : public VolumeFilesTest, public testing::WithParamInterface<DicomSlices> {
 protected:
  int number(int i) const { return GetParam().first + i; }
  std::string slice(int i) const { return GetParam().file(number(i)); }
  std::string name(int i) const { return std::to_string(9999 - number(i)); }
  void copySlices(std::initializer_list<int> which) const {
    // Names against the order of the positions: it is the positions that count.
    for (const int i : which) write(name(i), slice(i));
  }
};

TEST_P(DicomFolder, SlicesAreSortedByPosition) {
  copySlices({2, 0, 1});
  const auto source = openItkSource(folder_.string());
  const Index3 voxels = GetParam().voxels;
  EXPECT_EQ(source->info().voxels, Index3(voxels.x, voxels.y, 3));
  EXPECT_EQ(source->info().geometry.origin.z, GetParam().first_z);
  const auto values = readVoxels<std::int16_t>(*source, 1);
  const std::size_t count = GetParam().pixelBytes() / 2;
  std::vector<std::int16_t> stored(count);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string bytes = slice(static_cast<int>(k));
    std::memcpy(stored.data(), bytes.data() + bytes.size() - 2 * count, 2 * count);
    for (std::size_t pixel = 0; pixel < count; ++pixel)
      ASSERT_EQ(values[k * count + pixel], stored[pixel] - 1024) << pixel;
  }
}

TEST_P(DicomFolder, MissingAndDoubledSlicesAreRefused) {
  copySlices({0, 1, 3, 4});
  EXPECT_CONTAINS(errorOf([&] { openItkSource(folder_.string()); }), "mm apart");
  copySlices({2});
  EXPECT_EQ(openItkSource(folder_.string())->info().voxels.z, 5);
  write("copy", slice(1));
  EXPECT_CONTAINS(errorOf([&] { openItkSource(folder_.string()); }), "same position");
}

TEST_P(DicomFolder, SeveralSeriesAreListed) {
  copySlices({0, 1});
  std::string other = slice(2);
  const std::string& uid = GetParam().series_uid;
  std::string other_uid = uid;
  other_uid.back() = uid.back() == '4' ? '5' : '4';
  // The element's tag and length stand before it: other UIDs of the file may begin in the same way.
  const std::string length(1, static_cast<char>(uid.size() + uid.size() % 2));
  const std::string element = std::string("\x20\0\x0e\0UI", 6) + length + '\0';
  const std::size_t at = other.find(element);
  ASSERT_NE(at, std::string::npos);
  ASSERT_EQ(other.substr(at + element.size(), uid.size()), uid);
  other.replace(at + element.size(), uid.size(), other_uid);
  write("other", other);
  const std::string message = errorOf([&] { openItkSource(folder_.string()); });
  EXPECT_CONTAINS(message, "(2 slices of");
  EXPECT_CONTAINS(message, "UID " + uid + ")");
  EXPECT_CONTAINS(message, "(1 slice of");
  EXPECT_CONTAINS(message, "UID " + other_uid + ")");
}

TEST_P(DicomFolder, DamagedSlicesAreErrorsThatNameTheFile) {
  copySlices({0, 1, 2});
  const std::string damaged = pathOf(name(1));
  const std::size_t pixels = GetParam().pixelBytes(), header = slice(1).size() - pixels;
  // Inside the pixels, and just behind where they begin.
  for (const std::size_t bytes : {header + pixels * 3 / 4, header + 100}) {
    fs::resize_file(damaged, bytes);
    testing::internal::CaptureStderr();
    const std::string message = errorOf([&] { openAndRead(folder_.string()); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
    EXPECT_CONTAINS(message, damaged);
  }
}

TEST_P(DicomFolder, EveryPrefixOfTheHeaderIsAnErrorAndNeverACrash) {
  const std::string whole = slice(0);
  for (std::size_t bytes = 0; bytes < whole.size() - GetParam().pixelBytes() + 20; bytes += 3) {
    const std::string path = write("prefix.dcm", whole.substr(0, bytes));
    EXPECT_THROW(openItkSource(path), Error) << bytes;
  }
}

TEST_P(DicomFolder, IsReadByAnyRowsAndSkippedSlicesAreNotDecoded) {
  for (int i = 0; i < 4; ++i) write(std::to_string(number(i)), slice(i));
  const auto values = readVoxels<std::int16_t>(*openItkSource(folder_.string()), 1);
  const auto source = openItkSource(folder_.string());
  ASSERT_EQ(source->files().size(), 4u);
  EXPECT_EQ(fs::path(source->files()[3]).filename(), std::to_string(number(3)));
  EXPECT_EQ(source->bufferBytes(), GetParam().pixelBytes());  // a slice, not the volume
  fs::remove(pathOf(std::to_string(number(2))));              // its rows are skipped
  const std::int64_t row = GetParam().voxels.x, slice_rows = GetParam().voxels.y;
  std::vector<std::int16_t> rows(static_cast<std::size_t>(2 * row * slice_rows));
  const auto check = [&](std::int64_t first, std::int64_t count) {
    source->readRows(first, count, rows.data());
    EXPECT_TRUE(std::equal(rows.begin(), rows.begin() + count * row, values.begin() + first * row))
        << first;
  };
  check(3, 1);
  check(4, slice_rows / 4 + 1);
  check(slice_rows * 3 / 5, slice_rows * 4 / 3);
  check(3 * slice_rows + slice_rows / 2, 1);
  check(4 * slice_rows - 1, 1);
}

}  // namespace isobrick::test
