// What arrays of Zarr may be packed with, and which volume of a group is meant.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

// 0, 1000, ..., 23000 as uint16, little-endian, packed by numcodecs 0.16.
const char* const kLz4 =
    "30000000f0210000e803d007b80ba00f88137017581b401f28231027f82ae02ec832b036983a803e6842"
    "5046384a204e0852f055d859";
const char* const kBz2 =
    "425a6831314159265359ff2a870e0000007fffc8c8c888c8d11151511152600040400040400040400040"
    "40004040404040404020002300000000680c993f54f50c00346868c232683469a030cc05689f2941fb37"
    "1855717c01c0d4291c28c5d103840f02428bef48bf177245385090ff2a870e";
const char* const kXz =
    "fd377a585a000004e6d6b4460200210116000000742fe5a301002f0000e803d007b80ba00f8813701758"
    "1b401f28231027f82ae02ec832b036983a803e68425046384a204e0852f055d85900dbcc535534aaaa3d"
    "000148308a40ff3e1fb6f37d010000000004595a";
const char* const kLzma =
    "5d00008000ffffffffffffffff0000639e784f74520616ccc5e038f5c6367f52e68c35af1e18294819d7"
    "bd64399a5ad42fbc09ce946a4b29d1c8971f843fdd8275a45f47d60ffffbeea000";
// The same, each 20 times.
const char* const kBloscLz =
    "02010102c0030000c003000018010000140000007e0000002300000000e0070300e8e00a0000d0e00a00"
    "00b8e00a0000a0e00a000088e00a000070e00a000058e00a000040e00a000028e00a000010e00a0000f8"
    "e00a0000e0e00a0000c8e00a0000b0e00a000098e00a000080e00a000068e00a000050e00a000038e00a"
    "000020e00a000008e00a0000f0e00a0000d8e0080001d8d87e0000002300000000e007030003e00a0000"
    "07e00a00000be00a00000fe00a000013e00a000017e00a00001be00a00001fe00a000023e00a000027e0"
    "0a00002ae00a00002ee00a000032e00a000036e00a00003ae00a00003ee00a000042e00a000046e00a00"
    "004ae00a00004ee00a000052e00a000055e00a000059e00800015959";

std::string bytesOfHex(const std::string& hex) {
  std::string bytes;
  for (std::size_t i = 0; i < hex.size(); i += 2)
    bytes += static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16));
  return bytes;
}

class ZarrVolumesTest : public VolumeFilesTest {
 protected:
  // An array of one chunk, in version 2.
  void writeArray(const std::string& name, const std::string& chunk, const std::string& compressor,
                  const std::string& filters = "null", const std::string& shape = "[2, 3, 4]",
                  const std::string& type = "<u2") const {
    fs::create_directories(pathOf(name));
    write(name + "/.zarray", R"({"zarr_format": 2, "shape": )" + shape + R"(, "chunks": )" + shape +
                                 R"(, "dtype": ")" + type +
                                 R"(", "fill_value": 0, "order": "C", "filters": )" + filters +
                                 R"(, "compressor": )" + compressor + "}");
    std::string key = "0";
    for (const char c : shape)
      if (c == ',') key += ".0";
    write(name + "/" + key, chunk);
  }
  void writeGroup(const std::string& name, const std::string& attributes) const {
    fs::create_directories(pathOf(name));
    write(name + "/.zgroup", R"({"zarr_format": 2})");
    write(name + "/.zattrs", attributes);
  }
  // One voxel in all of a volume of 2 x 3 x 4.
  static std::string voxels(std::uint16_t value) {
    return bytesOfValues(std::vector<std::uint16_t>(24, value));
  }
  static std::string imageAttributes(const std::string& axes) {
    return R"({"multiscales": [{"version": "0.4", "axes": )" + axes +
           R"(, "datasets": [{"path": "0"}]}]})";
  }
  void writeImage(const std::string& name, std::uint16_t value) const {
    writeGroup(name, imageAttributes(R"([{"name": "z"}, {"name": "y"}, {"name": "x"}])"));
    writeArray(name + "/0", voxels(value), "null");
  }
  std::vector<std::uint16_t> valuesOf(const std::string& name,
                                      const OpenOptions& options = {}) const {
    return readVoxels<std::uint16_t>(*openVolume(pathOf(name), options));
  }
  std::string messageOf(const std::string& name, const OpenOptions& options = {}) const {
    return errorOf([&] { readAll(*openVolume(pathOf(name), options)); });
  }
};

std::vector<std::uint16_t> thousands(int repeats = 1) {
  std::vector<std::uint16_t> values;
  for (int i = 0; i < 24 * repeats; ++i)
    values.push_back(static_cast<std::uint16_t>(i / repeats * 1000));
  return values;
}

struct Packed {
  const char *id, *hex;
};
const Packed kPackedChunks[] = {{"lz4", kLz4}, {"bz2", kBz2}, {"lzma", kXz}, {"lzma", kLzma}};

TEST_F(ZarrVolumesTest, ChunksArePackedByAnyLibraryOfNumcodecs) {
  for (const auto& [id, hex] : kPackedChunks) {
    writeArray("a.zarr", bytesOfHex(hex), R"({"id": ")" + std::string(id) + R"("})");
    EXPECT_EQ(valuesOf("a.zarr"), thousands()) << id;
  }
  writeArray("b.zarr", bytesOfHex(kBloscLz), R"({"id": "blosc"})", "null", "[2, 3, 80]");
  EXPECT_EQ(valuesOf("b.zarr"), thousands(20));
}

TEST_F(ZarrVolumesTest, EveryPrefixAndEveryByteOfAPackedChunkIsBoundedByItsArray) {
  const auto tryAll = [&](const char* id, const std::string& whole, const char* shape) {
    const std::string compressor = R"({"id": ")" + std::string(id) + R"("})";
    for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
      writeArray("a.zarr", whole.substr(0, bytes), compressor, "null", shape);
      EXPECT_NE(messageOf("a.zarr"), "") << id << bytes;
    }
    for (std::size_t at = 0; at < whole.size(); ++at)
      for (const char byte : {'\0', '\x7f', '\xff', static_cast<char>(whole[at] + 1)}) {
        std::string changed = whole;
        changed[at] = byte;
        writeArray("a.zarr", changed, compressor, "null", shape);
        try {
          readAll(*openVolume(pathOf("a.zarr")));
        } catch (const Error&) {
        }
      }
  };
  for (const auto& [id, hex] : kPackedChunks) tryAll(id, bytesOfHex(hex), "[2, 3, 4]");
  tryAll("blosc", bytesOfHex(kBloscLz), "[2, 3, 80]");
}

// c-blosc issue 405: a run whose length is more than an int holds writes anywhere.
TEST_F(ZarrVolumesTest, ARunOfBloscLzThatOverflowsIsDamage) {
  constexpr std::uint32_t kBytes = 64 << 20, kOnes = 9 << 20;
  std::string packed = {2, 1, 0x10, 1};
  const auto add = [&](std::uint32_t number) {
    packed += bytesOfValues(std::vector<std::uint32_t>{number});
  };
  add(kBytes);
  add(kBytes);
  add(16 + 4 + 4 + kOnes + 20);
  add(20);  // where the block begins
  add(kOnes + 24 - 4);
  packed += std::string("\0\x07\xff\xe0", 4) + std::string(kOnes, '\xff') + std::string(16, '\1');
  writeArray("a.zarr", packed, R"({"id": "blosc"})", "null", "[64, 1024, 1024]", "|u1");
  EXPECT_CONTAINS(messageOf("a.zarr"), "damaged");
}

TEST_F(ZarrVolumesTest, FiltersAreUndone) {
  std::vector<std::uint16_t> steps(24, 1000);
  steps[0] = 0;
  writeArray("a.zarr", bytesOfValues(steps), "null", R"([{"id": "delta", "dtype": "<u2"}])");
  EXPECT_EQ(valuesOf("a.zarr"), thousands());
  writeArray("a.zarr", bytesOfValues(std::vector<std::int16_t>(steps.begin(), steps.end()), true),
             "null", R"([{"id": "delta", "dtype": "<u2", "astype": ">i2"}])");
  EXPECT_EQ(valuesOf("a.zarr"), thousands());
  writeArray("a.zarr", std::string(24, '\xff'), "null",
             R"([{"id": "delta", "dtype": "<u2", "astype": "|i1"}])");
  EXPECT_EQ(valuesOf("a.zarr")[23], 65536 - 24);
  std::string shuffled;
  for (const int byte : {0, 8})
    for (const std::uint16_t value : thousands())
      shuffled += static_cast<char>(value >> byte & 255);
  writeArray("a.zarr", shuffled, "null", R"([{"id": "shuffle", "elementsize": 2}])");
  EXPECT_EQ(valuesOf("a.zarr"), thousands());
  writeArray("a.zarr", shuffled, R"({"id": "shuffle", "elementsize": 2})",
             R"([{"id": "bitround", "keepbits": 5}])");
  EXPECT_EQ(valuesOf("a.zarr"), thousands());
  writeArray("a.zarr", shuffled, "null", R"([{"id": "categorize"}])");
  EXPECT_CONTAINS(messageOf("a.zarr"), "delta, shuffle and bitround are");
  EXPECT_EQ(messageOf("a.zarr").find("damaged"), std::string::npos);
}

TEST_F(ZarrVolumesTest, ShardsMayHoldShards) {
  fs::create_directories(pathOf("s.zarr/c/0/0"));
  const std::string bytes = R"({"name": "bytes", "configuration": {"endian": "little"}})";
  const auto shards = [&](const std::string& chunk, const std::string& codecs) {
    return R"({"name": "sharding_indexed", "configuration": {"chunk_shape": )" + chunk +
           R"(, "codecs": [)" + codecs + R"(], "index_codecs": [)" + bytes +
           R"(], "index_location": "end"}})";
  };
  write("s.zarr/zarr.json",
        R"({"zarr_format": 3, "node_type": "array", "shape": [2, 3, 4], "data_type": "uint16",
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 3, 4]}},
            "chunk_key_encoding": {"name": "default"}, "fill_value": 7, "codecs": [)" +
            shards("[1, 3, 4]", shards("[1, 3, 2]", bytes)) + "]}");
  // Of the first slice both halves, of the second the second half.
  const std::vector<std::uint16_t> all = thousands();
  const auto half = [&](std::size_t slice, std::size_t which) {
    std::vector<std::uint16_t> values;
    for (std::size_t y = 0; y < 3; ++y)
      for (std::size_t x = 0; x < 2; ++x) values.push_back(all[12 * slice + 4 * y + 2 * which + x]);
    return bytesOfValues(values);
  };
  const auto table = [](const std::vector<std::uint64_t>& numbers) {
    return bytesOfValues(numbers);
  };
  constexpr std::uint64_t kNone = ~std::uint64_t{0};
  const std::string first = half(0, 0) + half(0, 1) + table({0, 12, 12, 12});
  const std::string second = half(1, 1) + table({kNone, kNone, 0, 12});
  write("s.zarr/c/0/0/0", first + second + table({0, first.size(), first.size(), second.size()}));
  std::vector<std::uint16_t> expected = all;
  for (std::size_t y = 0; y < 3; ++y) expected[12 + 4 * y] = expected[13 + 4 * y] = 7;
  EXPECT_EQ(valuesOf("s.zarr"), expected);
  // An inner table that leads out of its own shard.
  write("s.zarr/c/0/0/0", half(0, 0) + half(0, 1) + table({0, 12, 60, 12}) + second +
                              table({0, first.size(), first.size(), second.size()}));
  EXPECT_CONTAINS(messageOf("s.zarr"), "behind its end");
}

// ---- which volume ---------------------------------------------------------------------------

TEST_F(ZarrVolumesTest, AGroupOfOneImageIsThatImage) {
  writeGroup("a.zarr", R"({"bioformats2raw.layout": 3})");
  writeImage("a.zarr/0", 5);
  EXPECT_EQ(valuesOf("a.zarr")[0], 5);
  writeGroup("b.zarr", "{}");
  writeArray("b.zarr/density", voxels(6), "null");
  writeArray("b.zarr/time", std::string(4, '\1'), "null", "null", "[2]");  // no volume
  EXPECT_EQ(valuesOf("b.zarr")[0], 6);
  writeGroup("w.zarr", R"({"well": {"images": [{"path": "0"}]}})");
  writeImage("w.zarr/0", 7);
  EXPECT_EQ(valuesOf("w.zarr")[0], 7);
}

TEST_F(ZarrVolumesTest, OneOfSeveralImagesIsChosen) {
  writeGroup("a.zarr", R"({"bioformats2raw.layout": 3})");
  writeGroup("a.zarr/OME", R"({"series": ["10", "9"]})");
  writeImage("a.zarr/9", 9);
  writeImage("a.zarr/10", 10);
  EXPECT_CONTAINS(messageOf("a.zarr"),
                  "2 images or arrays: '10', '9'; name one, as in '" + pathOf("a.zarr") + "/10'");
  OpenOptions options;
  options.image = 1;
  EXPECT_EQ(valuesOf("a.zarr", options)[0], 9);
  EXPECT_EQ(openVolume(pathOf("a.zarr"), options)->info().encoding, "image 1");
  options.image = 2;
  EXPECT_CONTAINS(messageOf("a.zarr", options), "no image 2");
  options.image = 0;
  EXPECT_CONTAINS(messageOf("a.zarr/9/0", options), "no images to choose from");
  writeGroup("p.zarr", R"({"plate": {"wells": [{"path": "A/1"}, {"path": "../x"}]}})");
  writeGroup("p.zarr/A/1", R"({"well": {"images": [{"path": "0"}, {"path": "1"}]}})");
  writeImage("p.zarr/A/1/0", 1);
  writeImage("p.zarr/A/1/1", 2);
  EXPECT_CONTAINS(messageOf("p.zarr"), "'A/1/0', 'A/1/1'");
  writeGroup("e.zarr", "{}");
  EXPECT_CONTAINS(messageOf("e.zarr"), "neither an image nor an array");
}

TEST_F(ZarrVolumesTest, AChoiceOfWhatThereIsNotIsRefused) {
  writeArray("a.zarr", voxels(1), "null");
  OpenOptions options;
  options.time = 3;
  EXPECT_CONTAINS(messageOf("a.zarr", options), "no axis of time steps");
  options = {};
  options.channel = 1;
  EXPECT_CONTAINS(messageOf("a.zarr", options), "no axis of channels");
}

TEST_F(ZarrVolumesTest, AxesAreFoundByNameOrByTheirOrder) {
  const auto shapeOf = [&](const std::string& axes) {
    writeGroup("a.zarr", imageAttributes(axes));
    writeArray("a.zarr/0", voxels(1), "null");
    return openVolume(pathOf("a.zarr"))->info().voxels;
  };
  EXPECT_EQ(shapeOf(R"(["X", "Y", "Z"])"), Index3(2, 3, 4));
  EXPECT_EQ(shapeOf(R"([{"name": "depth", "type": "space"}, {"name": "height", "type": "space"},
                        {"name": "width", "type": "space"}])"),
            Index3(4, 3, 2));
  // 2-D over time is no volume.
  EXPECT_CONTAINS(errorOf([&] { shapeOf(R"(["Time", "y", "x"])"); }), "'t', 'y', 'x'");
  writeArray("b.zarr", voxels(1), "null");
  write("b.zarr/.zattrs", R"({"_ARRAY_DIMENSIONS": ["time", "lat", "lon"]})");
  EXPECT_CONTAINS(messageOf("b.zarr"), "three axes of space");
  write("b.zarr/.zattrs", R"({"_ARRAY_DIMENSIONS": ["x", "y", "z"]})");
  EXPECT_EQ(openVolume(pathOf("b.zarr"))->info().voxels, Index3(2, 3, 4));
}

}  // namespace
}  // namespace isobrick
