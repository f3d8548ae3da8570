// TIFF pictures of all forms have the numbers that were written.
#include <gtest/gtest.h>
#include <tiffio.h>

#include <array>
#include <cmath>
#include <cstring>
#include <optional>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/index_loop.h"
#include "tests/extract/random_case.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

struct NumberKind {
  std::uint32_t kind, bytes;
  VoxelType delivered;
};
constexpr NumberKind kKinds[] = {
    {1, 1, VoxelType::kUint8}, {2, 1, VoxelType::kInt8},    {1, 2, VoxelType::kUint16},
    {2, 2, VoxelType::kInt16}, {3, 2, VoxelType::kFloat32}, {1, 4, VoxelType::kUint32},
    {2, 4, VoxelType::kInt32}, {3, 4, VoxelType::kFloat32}, {1, 8, VoxelType::kUint64},
    {2, 8, VoxelType::kInt64}, {3, 8, VoxelType::kFloat64}};

template <typename T>
std::string bytesOf(T value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}
template <typename T>
T numberIn(const std::string& bytes) {
  T value;
  std::memcpy(&value, bytes.data(), sizeof(value));
  return value;
}

// The float that the bytes of one of a kind stand for.
float floatOf(const NumberKind& number, const std::string& bytes) {
  switch (number.bytes) {
    case 4:
      return numberIn<float>(bytes);
    default: {  // a half, by its definition
      const auto half = numberIn<std::uint16_t>(bytes);
      const int exponent = half >> 10 & 31;
      const double fraction = (half & 1023) / 1024.0;
      const double size =
          exponent == 0 ? std::ldexp(fraction, -14) : std::ldexp(1 + fraction, exponent - 15);
      return static_cast<float>(half >> 15 != 0 ? -size : size);
    }
  }
}

// Numbers of any value; floating ones are finite.
std::string randomNumbers(RandomCase& random, const NumberKind& number, std::int64_t count) {
  std::string bytes;
  for (std::int64_t i = 0; i < count; ++i) {
    const double value = random.uniform(-1000000, 1000000) / 256.0;
    if (number.kind == 3 && number.bytes == 2)
      bytes += bytesOf(
          static_cast<std::uint16_t>(random.uniform(0, 1) << 15 | random.uniform(0, 0x7bff)));
    else if (number.kind == 3)
      bytes += number.bytes == 4 ? bytesOf(static_cast<float>(value)) : bytesOf(value);
    else
      for (std::uint32_t byte = 0; byte < number.bytes; ++byte)
        bytes += static_cast<char>(random.uniform(0, 255));
  }
  return bytes;
}

// The voxels of the pictures as they are delivered.
std::string expectedVoxels(const NumberKind& number, const std::vector<TiffPixels>& pages,
                           std::uint32_t component) {
  std::string voxels;
  for (const TiffPixels& page : pages)
    for (std::size_t pixel = 0; pixel < std::size_t{page.width} * page.height; ++pixel) {
      const std::string bytes =
          page.numbers.substr((pixel * page.samples + component) * page.bytes, page.bytes);
      voxels += number.delivered == VoxelType::kFloat32 ? bytesOf(floatOf(number, bytes)) : bytes;
    }
  return voxels;
}

std::string allVoxels(VolumeSource& source) {
  const Index3& voxels = source.info().voxels;
  std::string bytes(
      static_cast<std::size_t>(elementCount(voxels)) * voxelBytes(source.info().voxel_type), '\0');
  source.readRows(0, voxels.y * voxels.z, bytes.data());
  return bytes;
}

void expectBoxes(RandomCase& random, const VolumeSource& source, const std::string& all) {
  const Index3& voxels = source.info().voxels;
  const std::size_t size = voxelBytes(source.info().voxel_type);
  for (int i = 0; i < 10; ++i) {
    IndexBox box;
    for (int axis = 0; axis < 3; ++axis) {
      const auto most = static_cast<int>(voxels[axis]);
      box.first[axis] = random.uniform(0, most - 1);
      box.count[axis] = random.uniform(1, most - static_cast<int>(box.first[axis]));
    }
    if (random.chance(0.3)) box.first.x = 0, box.count.x = voxels.x;
    std::string read(static_cast<std::size_t>(box.size()) * size, '\0'), expected;
    source.readBox(box, read.data());
    forEachIndex({box.first, {1, box.count.y, box.count.z}}, [&](const Index3& row) {
      expected += all.substr(static_cast<std::size_t>(linearIndex(row, voxels)) * size,
                             static_cast<std::size_t>(box.count.x) * size);
    });
    ASSERT_TRUE(read == expected);
  }
}

void expectNumbersOfARandomVolume(std::uint32_t seed) {
  RandomCase random(seed);
  const TemporaryFolder folder;
  const NumberKind number = kKinds[seed % std::size(kKinds)];
  TiffForm form;
  form.is_big_tiff = random.chance(0.3);
  form.is_packed = random.chance(0.5);
  form.rows_per_strip = static_cast<std::uint32_t>(random.uniform(1, 45));
  form.tile = random.chance(0.4) ? 16 : 0;
  const bool is_one_file = random.chance(0.6);
  TiffPixels pixels;
  pixels.width = static_cast<std::uint32_t>(random.uniform(2, 40));
  pixels.height = static_cast<std::uint32_t>(random.uniform(2, 40));
  pixels.bytes = number.bytes;
  pixels.kind = number.kind;
  pixels.samples =
      is_one_file && random.chance(0.5) ? static_cast<std::uint32_t>(random.uniform(2, 4)) : 1;
  form.is_separate = pixels.samples > 1 && random.chance(0.5);
  std::vector<TiffPixels> pages;
  for (int z = random.uniform(2, 9); z > 0; --z) {
    pixels.numbers =
        randomNumbers(random, number, std::int64_t{pixels.width} * pixels.height * pixels.samples);
    pages.push_back(pixels);
  }
  const std::string path = folder.file(is_one_file ? "scan.tif" : "slices");
  form.big_endian = random.chance(0.5);
  if (is_one_file) {
    TiffBuilder tiff(form);
    for (const TiffPixels& page : pages) tiff.addPage(page);
    writeBytes(path, tiff.bytes());
  } else {
    std::filesystem::create_directory(path);
    for (std::size_t z = 0; z < pages.size(); ++z) {
      form.big_endian = random.chance(0.5);
      TiffBuilder tiff(form);
      tiff.addPage(pages[z]);
      writeBytes(path + "/" + std::to_string(z) + ".tif", tiff.bytes());
    }
  }
  OpenOptions options;
  std::uint32_t component = 0;
  if (pixels.samples > 1) {
    component = static_cast<std::uint32_t>(random.uniform(0, static_cast<int>(pixels.samples) - 1));
    options.component = ComponentChoice{false, component};
  }
  const auto source = openItkSource(path, options);
  EXPECT_EQ(source->info().voxels, Index3(pixels.width, pixels.height, std::ssize(pages)));
  EXPECT_EQ(source->info().voxel_type, number.delivered);
  EXPECT_EQ(source->files().size(), is_one_file ? 1 : pages.size());
  EXPECT_EQ(source->readsBoxes(), !form.is_packed && form.tile == 0 && !form.is_separate);
  const std::string all = allVoxels(*source);
  ASSERT_TRUE(all == expectedVoxels(number, pages, component));
  if (source->readsBoxes()) expectBoxes(random, *source, all);
}

TEST(TiffSourceTest, HasTheNumbersOfAnyForm) {
  for (std::uint32_t seed = 0; seed < 330; ++seed) {
    SCOPED_TRACE(seed);
    ASSERT_NO_FATAL_FAILURE(expectNumbersOfARandomVolume(seed));
  }
}

// One packed picture among plain ones is unpacked; one of another type is no slice of them.
TEST(TiffSourceTest, SlicesOfAStackMayDifferInHowTheyAreStored) {
  const TemporaryFolder folder;
  const auto slice = [&](int z, const TiffForm& form, std::uint32_t kind = 1) {
    TiffBuilder tiff(form);
    tiff.addPage({6, 5, 2, kind, 1, std::string(60, static_cast<char>(z))});
    writeBytes(folder.file(std::to_string(z) + ".tif"), tiff.bytes());
  };
  for (int z = 0; z < 4; ++z) slice(z, {});
  const auto plain = openItkSource(folder.path());
  EXPECT_TRUE(plain->readsBoxes());
  const std::string all = allVoxels(*plain);
  TiffForm packed;
  packed.is_packed = true;
  slice(2, packed);
  const auto source = openItkSource(folder.path());
  EXPECT_FALSE(source->readsBoxes());
  EXPECT_TRUE(allVoxels(*source) == all);
  slice(2, {}, 2);
  EXPECT_CONTAINS(errorOf([&] { openItkSource(folder.path()); }), "2.tif': the size or the type");
}

// Pictures of one byte a pixel, a page for each of `values`.
std::string pagesOf(const std::string& values, const std::string& description, TiffForm form = {}) {
  TiffBuilder tiff(form);
  for (const char& value : values) {
    const bool is_first = &value == values.data();
    tiff.addPage({.width = 3,
                  .height = 2,
                  .numbers = std::string(6, value),
                  .description = is_first ? description : ""});
  }
  return tiff.bytes();
}

class TiffAxesTest : public testing::Test {
 protected:
  std::string path(const std::string& name = "scan.tif") const { return folder_.file(name); }
  // The value of each slice, or the error.
  std::string slices(const OpenOptions& options = {}) const {
    try {
      const auto source = openItkSource(path(), options);
      notes_ = joined(source->info().notes);
      encoding_ = source->info().encoding;
      std::string values;
      const std::string all = allVoxels(*source);
      for (std::size_t at = 0; at < all.size(); at += 6) values += all[at];
      return values;
    } catch (const Error& error) {
      return error.what();
    }
  }
  static std::string joined(const std::vector<std::string>& lines) {
    std::string text;
    for (const std::string& line : lines) text += line + "\n";
    return text;
  }
  static OpenOptions chosen(std::optional<std::int64_t> channel, std::optional<std::int64_t> time,
                            std::optional<std::int64_t> image = {}) {
    OpenOptions options;
    options.channel = channel;
    options.time = time;
    options.image = image;
    return options;
  }
  TemporaryFolder folder_;
  mutable std::string notes_, encoding_;
};

TEST_F(TiffAxesTest, HyperstacksOfImageJAreChannelsSlicesAndFrames) {
  const std::string said = "ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\n";
  writeBytes(path(), pagesOf("aAbBcCdDeEfF", said));
  EXPECT_EQ(slices(), "abc");
  EXPECT_CONTAINS(notes_, "of 2 channels, the first was taken");
  EXPECT_CONTAINS(notes_, "of 2 time steps, the first was taken");
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  EXPECT_EQ(slices(chosen(1, 1)), "DEF");
  EXPECT_EQ(encoding_, "time step 1; channel 1");
  EXPECT_CONTAINS(slices(chosen(2, {})), "has the channels 0 to 1, and not 2");
  EXPECT_CONTAINS(slices(chosen({}, 2)), "has the time steps 0 to 1, and not 2");
  writeBytes(path(), pagesOf("abcABCdefDEF", said + "order=zct\n"));
  EXPECT_EQ(slices(chosen(1, 1)), "DEF");
  // Planes behind a single page, as in files above 4 GB.
  TiffForm form;
  form.rows_per_strip = 2;
  form.planes = 12;
  form.big_endian = true;
  TiffBuilder one(form);
  std::string pixels;
  for (const char value : std::string("aAbBcCdDeEfF")) pixels += std::string(6, value);
  one.addPage({.width = 3, .height = 24, .numbers = pixels, .description = said});
  writeBytes(path(), one.bytes());
  EXPECT_EQ(slices(chosen(1, 1)), "DEF");
  writeBytes(path(), pagesOf("aAbBcCdDeE", said));
  EXPECT_CONTAINS(slices(), "says 2 x 3 x 2 planes, and it has 10");
  writeBytes(path(), pagesOf("abc", "ImageJ=1.53t\nimages=3\nframes=3\n"));
  EXPECT_CONTAINS(slices(), "x 3 times) are no slices");
  // Other programs copy the description of a stack of which they take a part.
  writeBytes(path(), pagesOf("ab", "ImageJ=1.53t\nimages=3\nslices=3\n"));
  EXPECT_EQ(slices(), "ab");
}

std::string omeText(const std::string& order, const std::string& sizes, const std::string& data) {
  return "<?xml version=\"1.0\"?><OME UUID=\"urn:uuid:1\"><Image Name=\"cells\"><Pixels "
         "DimensionOrder=\"" +
         order + "\" SizeX=\"3\" SizeY=\"2\" " + sizes +
         " PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"2\">" + data +
         "</Pixels></Image></OME>";
}

TEST_F(TiffAxesTest, OmeSaysWhereItsPlanesAre) {
  const std::string sizes = "SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\"";
  writeBytes(path(), pagesOf("aAbBcC", omeText("XYCZT", sizes, "<TiffData/>")));
  EXPECT_EQ(slices(), "abc");
  EXPECT_EQ(openItkSource(path())->info().geometry.spacing, glm::dvec3(0.0005, 0.0005, 0.002));
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  writeBytes(path(), pagesOf("abcABC", omeText("XYZCT", sizes, "")));
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  // One by one, and out of order.
  std::string data;
  const std::string places = "cCbBaA";
  for (int i = 0; i < 6; ++i)
    data += "<TiffData IFD=\"" + std::to_string(i) + "\" FirstC=\"" + std::to_string(i % 2) +
            "\" FirstZ=\"" + std::to_string(2 - i / 2) + "\"/>";
  writeBytes(path(), pagesOf(places, omeText("XYZCT", sizes, data)));
  EXPECT_EQ(slices(), "abc");
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  // Planes that are in no page.
  writeBytes(path(),
             pagesOf("ab", omeText("XYZCT", sizes, "<TiffData IFD=\"0\" PlaneCount=\"2\"/>")));
  EXPECT_CONTAINS(slices(), "slice 2 of this channel and time is in no page");
  // The second channel lies in another file.
  const std::string files =
      "<TiffData IFD=\"0\" PlaneCount=\"3\"><UUID FileName=\"old.tif\">urn:uuid:1</UUID></TiffData>"
      "<TiffData IFD=\"0\" FirstC=\"1\" PlaneCount=\"3\"><UUID FileName=\"other.tif\">urn:uuid:2"
      "</UUID></TiffData>";
  writeBytes(path(), pagesOf("abc", omeText("XYZCT", sizes, files)));
  EXPECT_EQ(slices(), "abc");
  EXPECT_CONTAINS(slices(chosen(1, {})), "is in 'other.tif', which is not beside it");
  writeBytes(path("other.tif"), pagesOf("ABC", ""));
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  EXPECT_EQ(openItkSource(path())->files().size(), 2u);
}

TEST_F(TiffAxesTest, SeveralImagesAreListedUntilOneIsChosen) {
  std::string text = omeText("XYZCT", "SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"",
                             "<TiffData IFD=\"0\" PlaneCount=\"2\"/>");
  const std::string second =
      "<Image Name=\"dishes\"><Pixels DimensionOrder=\"XYZCT\" SizeX=\"3\" SizeY=\"2\" SizeZ=\"3\" "
      "SizeC=\"1\" SizeT=\"1\"><TiffData IFD=\"2\" PlaneCount=\"3\"/></Pixels></Image></OME>";
  text.replace(text.size() - 6, 6, second);
  writeBytes(path(), pagesOf("abABC", text));
  EXPECT_CONTAINS(slices(), "0: 'cells' of 3 x 2 x 2; 1: 'dishes' of 3 x 2 x 3");
  EXPECT_EQ(slices(chosen({}, {}, 1)), "ABC");
  EXPECT_EQ(encoding_, "image 1");
  EXPECT_CONTAINS(slices(chosen({}, {}, 2)), "has no image 2");
  // A picture beside a volume is none.
  TiffBuilder tiff({});
  for (const char value : std::string("abc"))
    tiff.addPage({.width = 3, .height = 2, .numbers = std::string(6, value)});
  tiff.addPage({.width = 2, .height = 3, .numbers = std::string(6, 'x')});
  writeBytes(path(), tiff.bytes());
  EXPECT_EQ(slices(), "abc");
  EXPECT_CONTAINS(notes_, "number 0 was taken");
}

TEST_F(TiffAxesTest, SeriesOfTifffileHaveAShape) {
  writeBytes(path(), pagesOf("abcABC", R"({"shape": [2, 3, 2, 3], "axes": "CZYX"})"));
  EXPECT_EQ(slices(), "abc");
  EXPECT_EQ(slices(chosen(1, {})), "ABC");
  writeBytes(path(), pagesOf("abcABC", R"({"shape": [2, 3, 2, 3]})"));
  EXPECT_CONTAINS(slices(), "3 x 2 x 2 x 3) have a further axis");
  EXPECT_EQ(slices(chosen({}, 1)), "ABC");
  writeBytes(path(), pagesOf("abc", R"({"shape": [3, 2, 3], "axes": "TYX"})"));
  EXPECT_CONTAINS(slices(), "are no slices");
  TiffForm form;
  form.rows_per_strip = 2;
  form.planes = 3;
  TiffBuilder one(form);
  one.addPage({.width = 3,
               .height = 6,
               .numbers = "aaaaaabbbbbbcccccc",
               .description = R"({"shape": [3, 2, 3], "truncated": true})"});
  writeBytes(path(), one.bytes());
  EXPECT_EQ(slices(), "abc");
  TiffBuilder two({});
  for (const char value : std::string("abABC"))
    two.addPage({.width = 3,
                 .height = 2,
                 .numbers = std::string(6, value),
                 .description = value == 'a'   ? R"({"shape": [2, 2, 3]})"
                                : value == 'A' ? R"({"shape": [3, 2, 3]})"
                                               : ""});
  writeBytes(path(), two.bytes());
  EXPECT_EQ(slices(chosen({}, {}, 1)), "ABC");
}

// They were left out, as smaller pictures are.
TEST_F(TiffAxesTest, PagesThatCallThemselvesPagesAreRead) {
  TiffForm form;
  form.subfile = 2;
  writeBytes(path(), pagesOf("abc", "", form));
  EXPECT_EQ(slices(), "abc");
}

TEST_F(TiffAxesTest, TheFirstRowMayBeTheLowest) {
  for (const std::uint32_t corner : {1u, 2u, 3u, 4u}) {
    TiffForm form;
    form.corner = corner;
    TiffBuilder tiff(form);
    for (int z = 0; z < 2; ++z) tiff.addPage({.width = 3, .height = 2, .numbers = "abcdef"});
    writeBytes(path(), tiff.bytes());
    EXPECT_EQ(allVoxels(*openItkSource(path())).substr(0, 6),
              (std::vector<std::string>{"abcdef", "cbafed", "fedcba", "defabc"})[corner - 1]);
  }
}

TEST_F(TiffAxesTest, NumbersOfOneToFifteenBitsAreWidened) {
  RandomCase random(3);
  for (std::uint32_t bits = 1; bits < 16; ++bits) {
    if (bits == 8) continue;
    std::string rows, expected;
    for (int row = 0; row < 4; ++row) {
      std::string row_bits;
      for (int x = 0; x < 5; ++x) {
        const auto value = static_cast<std::uint16_t>(random.uniform(0, (1 << bits) - 1));
        for (std::uint32_t bit = bits; bit-- > 0;) row_bits += (value >> bit & 1) != 0 ? '1' : '0';
        expected += bits < 8 ? bytesOf(static_cast<std::uint8_t>(value)) : bytesOf(value);
      }
      row_bits.resize((row_bits.size() + 7) / 8 * 8, '0');
      for (std::size_t at = 0; at < row_bits.size(); at += 8)
        rows += static_cast<char>(std::stoi(row_bits.substr(at, 8), nullptr, 2));
    }
    TiffForm form;
    form.is_packed = bits % 2 == 0;
    form.rows_per_strip = 3;
    TiffBuilder tiff(form);
    for (int z = 0; z < 2; ++z)
      tiff.addPage(
          {.width = 5,
           .height = 2,
           .numbers = rows.substr(rows.size() / 2 * static_cast<std::size_t>(z), rows.size() / 2),
           .bits = bits});
    writeBytes(path(), tiff.bytes());
    EXPECT_TRUE(allVoxels(*openItkSource(path())) == expected) << bits;
  }
}

// JPEG stores colours as brightness and two differences of half the resolution.
TEST_F(TiffAxesTest, ColoursOfJpegAreRedGreenAndBlue) {
  constexpr std::uint32_t kEdge = 32;
  TIFF* const file = TIFFOpen(path().c_str(), "w");
  ASSERT_NE(file, nullptr);
  std::string pixels;
  for (std::uint32_t i = 0; i < kEdge * kEdge; ++i) pixels += "\xC8\x32\x5A";
  for (int z = 0; z < 2; ++z) {
    TIFFSetField(file, TIFFTAG_IMAGEWIDTH, kEdge);
    TIFFSetField(file, TIFFTAG_IMAGELENGTH, kEdge);
    TIFFSetField(file, TIFFTAG_BITSPERSAMPLE, 8);
    TIFFSetField(file, TIFFTAG_SAMPLESPERPIXEL, 3);
    TIFFSetField(file, TIFFTAG_ROWSPERSTRIP, 16);
    TIFFSetField(file, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    TIFFSetField(file, TIFFTAG_COMPRESSION, COMPRESSION_JPEG);
    TIFFSetField(file, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_YCBCR);
    TIFFSetField(file, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    for (std::uint32_t strip = 0; strip < 2; ++strip)
      ASSERT_GE(TIFFWriteEncodedStrip(file, strip, pixels.data(), kEdge * 16 * 3), 0);
    TIFFWriteDirectory(file);
  }
  TIFFClose(file);
  EXPECT_CONTAINS(slices(), "3 values per voxel");
  for (const int component : {0, 1, 2}) {
    OpenOptions options;
    options.component = ComponentChoice{false, component};
    for (const char voxel : allVoxels(*openItkSource(path(), options)))
      ASSERT_NEAR(static_cast<unsigned char>(voxel), (std::array{0xC8, 0x32, 0x5A})[component], 4);
  }
}

// Sound files are not called damaged.
TEST_F(TiffAxesTest, WhatIsNotReadIsNamed) {
  const auto refusal = [&](const TiffForm& form, const TiffPixels& pixels) {
    TiffBuilder tiff(form);
    for (int z = 0; z < 2; ++z) tiff.addPage(pixels);
    writeBytes(path(), tiff.bytes());
    const std::string error = slices();
    EXPECT_EQ(error.find("damaged"), std::string::npos) << error;
    EXPECT_CONTAINS(error, "save it");
    return error;
  };
  const TiffPixels plain{.width = 4, .height = 4, .numbers = std::string(16, 'x')};
  TiffForm form;
  form.packing = 34712;
  EXPECT_CONTAINS(refusal(form, plain), "JPEG 2000");
  form.packing = 50002;
  EXPECT_CONTAINS(refusal(form, plain), "JPEG XL");
  form.packing = 54321;
  EXPECT_CONTAINS(refusal(form, plain), "number 54321");
  form = {};
  form.corner = 6;
  EXPECT_CONTAINS(refusal(form, plain), "orientation");
  TiffPixels other = plain;
  other.bits = 24;
  other.numbers = std::string(48, 'x');
  EXPECT_CONTAINS(refusal({}, other), "24 bits");
  other.bits = 12;
  other.kind = 2;
  EXPECT_CONTAINS(refusal({}, other), "12 bits");
  other = plain;
  other.bytes = 8;
  other.kind = 6;
  other.numbers = std::string(128, 'x');
  EXPECT_CONTAINS(refusal({}, other), "complex");
}

// The search for slices went round such a circle for ever, as previews are no slices.
TEST(TiffSourceTest, PagesInACircleAreRefused) {
  const TemporaryFolder folder;
  for (const bool is_preview : {false, true}) {
    TiffForm form;
    form.subfile = is_preview ? 1 : 0;
    TiffBuilder tiff(form);
    tiff.addPage({4, 4, 1, 1, 1, std::string(16, 'x')});
    std::string bytes = tiff.bytes();
    bytes.replace(bytes.size() - 4, 4, bytes, 4, 4);  // behind the page comes the page
    writeBytes(folder.file("scan.tif"), bytes);
    EXPECT_CONTAINS(errorOf([&] { openItkSource(folder.file("scan.tif")); }), "scan.tif");
  }
}

TEST(TiffSourceTest, AFileThatBecomesShorterIsNamed) {
  const TemporaryFolder folder;
  TiffBuilder tiff({});
  for (int z = 0; z < 3; ++z) tiff.addPage({50, 40, 1, 1, 1, std::string(2000, 'x')});
  writeBytes(folder.file("scan.tif"), tiff.bytes());
  const auto source = openItkSource(folder.file("scan.tif"));
  ASSERT_TRUE(source->readsBoxes());
  std::filesystem::resize_file(folder.file("scan.tif"), 3000);
  EXPECT_CONTAINS(errorOf([&] { allVoxels(*source); }), "scan.tif' at byte 3000: the file became");
}

// Tags that lie lead to one error, or to voxels of the file.
TEST(TiffSourceTest, ChangedBytesAreNotBelieved) {
  const TemporaryFolder folder;
  RandomCase random(7);
  int whole = 0, refused = 0;
  for (int i = 0; i < 4000; ++i) {
    TiffForm form;
    form.rows_per_strip = 4;
    form.is_packed = random.chance(0.5);
    form.tile = random.chance(0.3) ? 16 : 0;
    TiffBuilder tiff(form);
    for (int z = 0; z < 3; ++z)
      tiff.addPage({9, 8, 1, 1, 1, std::string(72, static_cast<char>('a' + z))});
    std::string bytes = tiff.bytes();
    const auto at = static_cast<std::size_t>(random.uniform(0, static_cast<int>(bytes.size()) - 1));
    bytes[at] = static_cast<char>(random.uniform(0, 255));
    if (random.chance(0.1)) bytes.resize(at);
    const std::string path = folder.file("scan.tif");
    writeBytes(path, bytes);
    try {
      const auto source = openTiffFile(path, {});
      if (source && elementCount(source->info().voxels) < 10'000'000) allVoxels(*source);
      ++whole;
    } catch (const Error& error) {
      EXPECT_CONTAINS(std::string(error.what()), "scan.tif");
      ++refused;
    }
  }
  EXPECT_GT(whole, 500);
  EXPECT_GT(refused, 300);
}

}  // namespace
}  // namespace isobrick::test
