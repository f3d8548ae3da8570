// Zarr stores in zip files, whole and damaged.
#include <gtest/gtest.h>
#include <zlib.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/file_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

struct ZipOptions {
  bool deflated = false, is_64 = false;
  std::string comment;
};

// The numbers of a zip file, little-endian.
std::string u16(std::uint64_t n) {
  return bytesOfValues(std::vector{static_cast<std::uint16_t>(n)});
}
std::string u32(std::uint64_t n) {
  return bytesOfValues(std::vector{static_cast<std::uint32_t>(n)});
}
std::string u64(std::uint64_t n) { return bytesOfValues(std::vector{n}); }

std::string deflated(const std::string& bytes) {
  std::string packed(bytes.size() + 100, '\0');
  z_stream stream = {};
  deflateInit2(&stream, 9, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

// All files below a folder, by their paths from there.
std::string zipOf(const std::string& folder, const ZipOptions& options = {}) {
  std::string members, table;
  std::size_t count = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    const std::string bytes = readBytes(entry.path().string());
    const std::string name = fs::relative(entry.path(), folder).string();
    const std::string packed = options.deflated ? deflated(bytes) : bytes;
    const std::string method = u16(options.deflated ? 8 : 0);
    const std::string sum = u32(
        crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
    const std::string extra = options.is_64 ? u16(1) + u16(24) + u64(bytes.size()) +
                                                  u64(packed.size()) + u64(members.size())
                                            : "";
    const auto narrow = [&](std::size_t n) { return u32(options.is_64 ? 0xffffffff : n); };
    const std::string common = u16(20) + u16(0) + method + u32(0) + sum + narrow(packed.size()) +
                               narrow(bytes.size()) + u16(name.size());
    table += u32(0x02014b50) + u16(20) + common + u16(extra.size()) + u16(0) + u16(0) + u16(0) +
             u32(0) + narrow(members.size()) + name + extra;
    members += u32(0x04034b50) + common + u16(4) + name + u16(0x7777) + u16(0) + packed;
    ++count;
  }
  std::string end;
  if (options.is_64)
    end = u32(0x06064b50) + u64(44) + u16(45) + u16(45) + u32(0) + u32(0) + u64(count) +
          u64(count) + u64(table.size()) + u64(members.size()) + u32(0x07064b50) + u32(0) +
          u64(members.size() + table.size()) + u32(1);
  const std::string counts = u16(options.is_64 ? 0xffff : count);
  end += u32(0x06054b50) + u16(0) + u16(0) + counts + counts +
         u32(options.is_64 ? 0xffffffff : table.size()) +
         u32(options.is_64 ? 0xffffffff : members.size()) + u16(options.comment.size()) +
         options.comment;
  return members + table + end;
}

class ZippedZarrTest : public VolumeFilesTest {
 protected:
  ZippedZarrTest() { writeImage("store", 0); }

  // An image of two chunks, of the values first, first + 1, ...
  void writeImage(const std::string& name, int first) const {
    fs::create_directories(pathOf(name + "/0"));
    write(name + "/.zgroup", R"({"zarr_format": 2})");
    write(name + "/.zattrs",
          R"({"multiscales": [{"version": "0.4", "axes": [{"name": "z"}, {"name": "y"},
             {"name": "x"}], "datasets": [{"path": "0", "coordinateTransformations":
             [{"type": "scale", "scale": [1, 2, 3]}]}]}]})");
    write(name + "/0/.zarray",
          R"({"zarr_format": 2, "shape": [4, 3, 4], "chunks": [2, 3, 4], "dtype": "<u2",
             "fill_value": 0, "order": "C", "filters": null, "compressor": null})");
    for (int chunk = 0; chunk < 2; ++chunk) {
      std::vector<std::uint16_t> values;
      for (int i = 0; i < 24; ++i)
        values.push_back(static_cast<std::uint16_t>(first + 24 * chunk + i));
      write(name + "/0/" + std::to_string(chunk) + ".0.0", bytesOfValues(values));
    }
  }
  std::vector<std::uint16_t> valuesOf(const std::string& name) const {
    return readVoxels<std::uint16_t>(*openVolume(pathOf(name)));
  }
  std::string messageOf(const std::string& name) const {
    return errorOf([&] { readAll(*openVolume(pathOf(name))); });
  }
};

TEST_F(ZippedZarrTest, IsReadAsItsFolder) {
  const std::vector<std::uint16_t> expected = valuesOf("store");
  ASSERT_EQ(expected.back(), 47);
  for (const bool is_deflated : {false, true})
    for (const bool is_64 : {false, true})
      for (const char* comment : {"", "PK\x05\x06 is how the end begins"}) {
        write("scan.zarr.zip", zipOf(pathOf("store"), {is_deflated, is_64, comment}));
        for (const char* path : {"scan.zarr.zip", "scan.zarr.zip/", "scan.zarr.zip/0"})
          EXPECT_EQ(valuesOf(path), expected) << path << is_deflated << is_64 << comment;
        const auto source = openVolume(pathOf("scan.zarr.zip"));
        EXPECT_EQ(source->info().format, "OME-Zarr");
        EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(3, 2, 1));
        EXPECT_EQ(source->files(), std::vector{pathOf("scan.zarr.zip")});
      }
}

// As `zip -r scan.zip store` makes it.
TEST_F(ZippedZarrTest, MayHoldTheFolderOfTheStoreAndSeveral) {
  fs::create_directories(pathOf("above"));
  fs::rename(pathOf("store"), pathOf("above/one"));
  write("scan.zip", zipOf(pathOf("above")));
  EXPECT_EQ(valuesOf("scan.zip").back(), 47);
  writeImage("above/two", 1000);
  write("scan.zip", zipOf(pathOf("above")));
  EXPECT_NE(messageOf("scan.zip").find("'one', 'two'"), std::string::npos) << messageOf("scan.zip");
  EXPECT_EQ(valuesOf("scan.zip/two").back(), 1047);
}

TEST_F(ZippedZarrTest, AChangedFileIsReadAnew) {
  write("scan.zip", zipOf(pathOf("store")));
  const auto before = openVolume(pathOf("scan.zip"));  // holds what it knows of the file
  writeImage("store", 500);
  write("scan.zip", zipOf(pathOf("store")));
  fs::last_write_time(pathOf("scan.zip"), fs::file_time_type::clock::now() + std::chrono::hours(1));
  EXPECT_EQ(valuesOf("scan.zip").back(), 547);
}

TEST_F(ZippedZarrTest, WhatCannotBeReadIsSaid) {
  const std::string whole = zipOf(pathOf("store"));
  const auto with = [&](std::size_t at, const std::string& bytes) {
    std::string changed = whole;
    changed.replace(at, bytes.size(), bytes);
    write("scan.zip", changed);
    return messageOf("scan.zip");
  };
  // Of a chunk, in the table.
  const std::size_t row = whole.rfind("0/1.0.0") - 46;
  ASSERT_EQ(whole.substr(row, 4), u32(0x02014b50));
  EXPECT_NE(with(row + 8, u16(1)).find("encrypted"), std::string::npos);
  EXPECT_NE(with(row + 10, u16(93)).find("method 93"), std::string::npos);
  const std::size_t voxels = whole.find(bytesOfValues(std::vector<std::uint16_t>{0, 1, 2, 3}));
  ASSERT_NE(voxels, std::string::npos);
  EXPECT_NE(with(voxels, "xx").find("fails its checksum"), std::string::npos);
  write("scan.zip", "no zip file, but long enough to be one");
  EXPECT_NE(messageOf("scan.zip").find("zip file is damaged"), std::string::npos);
}

// Every prefix, and every byte changed: an error or the right voxels, and never a crash.
TEST_F(ZippedZarrTest, DamageIsFoundOrHarmless) {
  const std::vector<std::uint16_t> expected = valuesOf("store");
  for (const bool is_deflated : {false, true})
    for (const bool is_64 : {false, true}) {
      const std::string whole = zipOf(pathOf("store"), {is_deflated, is_64, ""});
      for (std::size_t bytes = 0; bytes < whole.size(); bytes += 3) {
        write("scan.zip", whole.substr(0, bytes));
        EXPECT_NE(messageOf("scan.zip"), "") << bytes;
      }
      const std::size_t table = whole.find(u32(0x02014b50));
      for (std::size_t at = table; at < whole.size(); ++at)
        for (const char byte : {'\0', '\x7f', '\xff', static_cast<char>(whole[at] + 1)}) {
          std::string changed = whole;
          changed[at] = byte;
          write("scan.zip", changed);
          try {
            readAll(*openVolume(pathOf("scan.zip")));
          } catch (const Error&) {
          }
        }
    }
}

}  // namespace
}  // namespace isobrick
