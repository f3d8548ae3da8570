// NRRD and MetaImage: axes that are not of space, the places of voxels, numbers in several files
// and as text.
#include <bzlib.h>
#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

class TextHeaderTest : public VolumeFilesTest {
 protected:
  // Volume v of 4 x 3 x 2 voxels has 100 v + i at voxel i.
  static std::vector<std::int16_t> volume(int v) {
    std::vector<std::int16_t> values(24);
    for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<std::int16_t>(100 * v + int(i));
    return values;
  }
  // An array of 24 x `values`, of which the axis of values is behind so many numbers of a volume.
  static std::string arrayWith(int values, std::size_t before) {
    std::vector<std::int16_t> numbers;
    for (std::size_t i = 0; i < 24; i += before)
      for (int v = 0; v < values; ++v) {
        const auto of_one = volume(v);
        numbers.insert(numbers.end(), of_one.begin() + static_cast<std::ptrdiff_t>(i),
                       of_one.begin() + static_cast<std::ptrdiff_t>(i + before));
      }
    return bytesOfValues(numbers);
  }
  std::string writeNrrd(const std::string& fields, const std::string& bytes) const {
    return write("scan.nrrd", "NRRD0004\ntype: short\nendian: little\n" + fields + "\n" + bytes);
  }
  static void expectVolume(const std::string& path, const OpenOptions& options, int v) {
    const auto source = openVolume(path, options);
    EXPECT_EQ(source->info().voxels, Index3(4, 3, 2));
    for (const std::int64_t slab : {1, 2})
      EXPECT_EQ(readVoxels<std::int16_t>(*openVolume(path, options), slab), volume(v));
    std::vector<std::int16_t> row(4);
    source->readRows(4, 1, row.data());
    EXPECT_EQ(row[2], 100 * v + 18);
  }
  static OpenOptions component(std::int64_t index) {
    OpenOptions options;
    options.component = ComponentChoice{.index = index};
    return options;
  }
};

TEST_F(TextHeaderTest, NrrdTakesValuesOnAnyAxis) {
  struct {
    const char *sizes, *directions;
    std::size_t before;
  } const cases[] = {{"3 4 3 2", "none (1,0,0) (0,1,0) (0,0,2)", 1},
                     {"4 3 3 2", "(1,0,0) none (0,1,0) (0,0,2)", 4},
                     {"4 3 3 2", "(1,0,0) (0,1,0) none (0,0,2)", 12},
                     {"4 3 2 3", "(1,0,0) (0,1,0) (0,0,2) none", 24},
                     {"3 4 3 2", "(nan,nan,nan) (1,0,0) (0,1,0) (0,0,2)", 1}};
  for (const auto& [sizes, directions, before] : cases)
    for (const bool packed : {false, true}) {
      const std::string bytes = arrayWith(3, before);
      const std::string path = writeNrrd(std::string("dimension: 4\nspace: LPS\nsizes: ") + sizes +
                                             "\nspace directions: " + directions +
                                             "\nencoding: " + (packed ? "gzip" : "raw") + "\n",
                                         packed ? deflated(bytes, true) : bytes);
      EXPECT_CONTAINS(errorOf([&] { openVolume(path); }), "3 values per voxel");
      EXPECT_CONTAINS(errorOf([&] { openVolume(path, component(3)); }), "0 to 2");
      for (const int v : {0, 2}) {
        expectVolume(path, component(v), v);
        OpenOptions of_channel, of_time;  // no kind says what it is
        of_channel.channel = v;
        of_time.time = v;
        expectVolume(path, of_channel, v);
        expectVolume(path, of_time, v);
      }
      OpenOptions magnitude;
      magnitude.component = ComponentChoice{.magnitude = true};
      const auto source = openVolume(path, magnitude);
      EXPECT_EQ(readVoxels<float>(*source)[0], std::sqrt(100.0f * 100 + 200 * 200)) << directions;
    }
}

TEST_F(TextHeaderTest, NrrdIsReadFromBzip2) {
  const auto bzipped = [](std::string bytes) {
    std::string packed(2 * bytes.size() + 700, '\0');
    auto size = static_cast<unsigned>(packed.size());
    EXPECT_EQ(BZ2_bzBuffToBuffCompress(packed.data(), &size, bytes.data(),
                                       static_cast<unsigned>(bytes.size()), 1, 0, 0),
              BZ_OK);
    return packed.substr(0, size);
  };
  const std::string header = "dimension: 3\nsizes: 4 3 2\nencoding: bzip2\n";
  const std::string bytes = arrayWith(1, 24);
  const std::string packed = bzipped(bytes);
  expectVolume(writeNrrd(header, packed), {}, 0);
  const auto errorOfVoxels = [&](const std::string& data) {
    return errorOf([&] { readVoxels<std::int16_t>(*openVolume(writeNrrd(header, data))); });
  };
  for (std::size_t size = 0; size < packed.size(); ++size)
    EXPECT_NE(errorOfVoxels(packed.substr(0, size)), "") << size;
  EXPECT_CONTAINS(errorOfVoxels(packed.substr(0, packed.size() / 2)), "cut short");
  std::string damaged = packed;
  damaged[12] ^= 0x10;  // of the checksum of its block
  EXPECT_CONTAINS(errorOfVoxels(damaged), "damaged");
  EXPECT_CONTAINS(errorOfVoxels(bzipped(bytes.substr(0, 40))), "ends after 40 bytes");
}

TEST_F(TextHeaderTest, NrrdTakesTimeByItsKindOrItsSpace) {
  for (const char* fields :
       {"space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,2) none\nkinds: domain domain domain "
        "time\n",
        "space: left-posterior-superior-time\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,2,0) "
        "(0,0,0,1)\nspace origin: (1,2,3,0)\n",
        "kinds: space space space time\n"}) {
    const std::string path = writeNrrd(
        std::string("dimension: 4\nsizes: 4 3 2 2\nencoding: raw\n") + fields, arrayWith(2, 24));
    expectVolume(path, {}, 0);
    EXPECT_CONTAINS(openVolume(path)->info().notes.back(), "time step 0 of 2");
    OpenOptions options;
    options.time = 1;
    expectVolume(path, options, 1);
    options.time = 2;
    EXPECT_CONTAINS(errorOf([&] { openVolume(path, options); }), "none is number 2");
  }
  OpenOptions options;
  options.time = 1;
  const std::string plain =
      writeNrrd("dimension: 3\nsizes: 4 3 2\nencoding: raw\n", arrayWith(1, 24));
  EXPECT_CONTAINS(errorOf([&] { openVolume(plain, options); }), "no time steps");
}

// ITK 5.2 turned left-anterior-superior by 180 degrees.
TEST_F(TextHeaderTest, NrrdSpacesAreTurnedToLps) {
  struct {
    const char* space;
    glm::dvec3 to_lps;
  } const cases[] = {{"left-posterior-superior", {1, 1, 1}},
                     {"RAS", {-1, -1, 1}},
                     {"left-anterior-superior", {1, -1, 1}},
                     {"LAS", {1, -1, 1}},
                     {"scanner-xyz", {1, 1, 1}},
                     {"3D-left-handed", {1, 1, 1}}};
  for (const auto& [space, to_lps] : cases) {
    const auto source = openVolume(
        writeNrrd(std::string("dimension: 3\nsizes: 4 3 2\nencoding: raw\nspace: ") + space +
                      "\nspace directions: (0,0.5,0) (0,0,-0.7) (-2,0,0)\nspace origin: (1,2,3)\n",
                  arrayWith(1, 24)));
    const GridGeometry& geometry = source->info().geometry;
    const glm::dmat3 steps = geometry.indexToWorldMatrix();
    EXPECT_LT(glm::length(steps[0] - to_lps * glm::dvec3(0, 0.5, 0)), 1e-12) << space;
    EXPECT_LT(glm::length(steps[1] - to_lps * glm::dvec3(0, 0, -0.7)), 1e-12) << space;
    EXPECT_LT(glm::length(steps[2] - to_lps * glm::dvec3(-2, 0, 0)), 1e-12) << space;
    EXPECT_LT(glm::length(geometry.origin - to_lps * glm::dvec3(1, 2, 3)), 1e-12) << space;
  }
}

TEST_F(TextHeaderTest, NrrdWithoutASpaceIsPlacedByItsAxes) {
  const auto geometry = [&](const std::string& fields) {
    return openVolume(
               writeNrrd("dimension: 3\nsizes: 4 3 2\nencoding: raw\n" + fields, arrayWith(1, 24)))
        ->info()
        .geometry;
  };
  EXPECT_EQ(geometry("spacings: NaN 0.5 2\n").spacing, glm::dvec3(1, 0.5, 2));
  const std::string least = "axis mins: -10 20 -30\n";
  EXPECT_EQ(geometry("spacings: 0.5 1 2\ncenters: cell cell cell\n" + least).origin,
            glm::dvec3(-9.75, 20.5, -29));
  EXPECT_EQ(geometry("spacings: 0.5 1 2\ncenters: node node node\n" + least).origin,
            glm::dvec3(-10, 20, -30));
  EXPECT_EQ(geometry("axis maxs: -7 24 -28\ncenters: node node node\n" + least).spacing,
            glm::dvec3(1, 2, 2));
}

TEST_F(TextHeaderTest, NrrdSaysWhatIsNotRead) {
  const auto error = [&](const std::string& fields) {
    const std::string path = write("scan.nrrd", "NRRD0004\n" + fields + "\n" + arrayWith(1, 24));
    const std::string text = errorOf([&] { openVolume(path); });
    EXPECT_EQ(text.find("damaged"), std::string::npos) << text;
    return text;
  };
  const std::string sizes = "dimension: 3\nsizes: 4 3 2\nendian: little\n";
  EXPECT_CONTAINS(error("type: block\nblock size: 2\nencoding: raw\n" + sizes), "type: block");
  EXPECT_CONTAINS(error("type: short\nencoding: raw\nspace: 2D-right\n" + sizes), "its space");
  EXPECT_CONTAINS(
      error("type: short\nencoding: raw\nspace: LPS\nspace directions: (1,0,0) (0,1)\n" + sizes),
      "one vector for each axis");
}

TEST_F(TextHeaderTest, NumbersAreReadFromSeveralFiles) {
  const std::string bytes = arrayWith(1, 24);
  for (const bool packed : {false, true}) {
    for (const int k : {0, 1}) {
      const std::string slice = "skip\nfour" + bytes.substr(static_cast<std::size_t>(24 * k), 24);
      write("s" + std::to_string(k) + ".raw",
            packed ? deflated(slice.substr(5), true) : slice + "behind");
    }
    const std::string start =
        std::string("NRRD0004\ntype: short\nendian: little\ndimension: 3\n") +
        "sizes: 4 3 2\nbyte skip: 4\nencoding: " + (packed ? "gzip\n" : "raw\nline skip: 1\n");
    for (const char* files : {"data file: LIST\ns0.raw\ns1.raw\n", "data file: s%01d.raw 0 1 1\n",
                              "data file: LIST 2\ns0.raw\ns1.raw\n"})
      expectVolume(write("scan.nhdr", start + files), {}, 0);
    EXPECT_CONTAINS(
        errorOf([&] { openVolume(write("scan.nhdr", start + "data file: LIST\ns0.raw\n")); }),
        "names 1 data files, and its sizes need 2");
    EXPECT_CONTAINS(errorOf([&] {
                      openVolume(write("scan.nhdr", start + "data file: LIST\ns0.raw\nno.raw\n"));
                    }),
                    "no.raw");
  }
  const std::string from_end =
      "NRRD0004\ntype: short\nendian: little\ndimension: 3\n"
      "sizes: 4 3 2\nbyte skip: -1\n";
  write("all.raw", "rubbish" + bytes);
  write("all.gz", deflated("rubbish" + bytes, true));
  expectVolume(write("a.nhdr", from_end + "encoding: raw\ndata file: all.raw\n"), {}, 0);
  expectVolume(write("b.nhdr", from_end + "encoding: gzip\ndata file: all.gz\n"), {}, 0);
}

TEST_F(TextHeaderTest, NumbersAreReadAsText) {
  const std::string sizes = "dimension: 3\nsizes: 2 2 2\n";
  const auto floats = openVolume(write("a.nrrd", "NRRD0004\ntype: float\nencoding: ascii\n" +
                                                     sizes + "\n1 2.5 +3\n-4e2,5 6 7\t8\n"));
  EXPECT_EQ(readVoxels<float>(*floats), (std::vector<float>{1, 2.5, 3, -400, 5, 6, 7, 8}));
  const auto hex =
      openVolume(write("b.nrrd", "NRRD0004\ntype: short\nendian: big\nencoding: hex\n" + sizes +
                                     "\n0001 0002 0003 0004\n00050006ffFF0008"));
  EXPECT_EQ(readVoxels<std::int16_t>(*hex), (std::vector<std::int16_t>{1, 2, 3, 4, 5, 6, -1, 8}));
  const std::string meta = "NDims = 3\nDimSize = 2 2 2\nBinaryData = False\n";
  const auto chars = openVolume(write(
      "c.mha", meta + "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n1 2 3 4 5 6 7 255\n"));
  EXPECT_EQ(readVoxels<std::uint8_t>(*chars)[7], 255);
  EXPECT_CONTAINS(errorOf([&] {
                    openAndRead(write("d.mha", meta + "ElementType = MET_UCHAR\nElementDataFile = "
                                                      "LOCAL\n1 2 3 4 5 6 7 256\n"));
                  }),
                  "'256'");
  EXPECT_CONTAINS(errorOf([&] {
                    openAndRead(write("e.mha", meta + "ElementType = MET_UCHAR\nElementDataFile = "
                                                      "LOCAL\n1 2 3\n"));
                  }),
                  "e.mha");
}

TEST_F(TextHeaderTest, MetaImageTakesChannelsAndTimes) {
  const std::string start =
      "NDims = 4\nDimSize = 4 3 2 2\nElementType = MET_SHORT\nElementSpacing = 0.5 0.6 -2 1\n"
      "Offset = 1 2 3 0\nTransformMatrix = 0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1\n";
  const std::string times =
      write("times.mha", start + "ElementDataFile = LOCAL\n" + arrayWith(2, 24));
  expectVolume(times, {}, 0);
  OpenOptions options;
  options.time = 1;
  expectVolume(times, options, 1);
  const glm::dmat3 steps = openVolume(times, options)->info().geometry.indexToWorldMatrix();
  EXPECT_EQ(steps, glm::dmat3({0, 0.5, 0}, {-0.6, 0, 0}, {0, 0, -2}));
  const std::string channels = write(
      "channels.mha",
      "NDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT_ARRAY\nElementNumberOfChannels = 3\n"
      "ElementDataFile = LOCAL\n" +
          arrayWith(3, 1));
  EXPECT_CONTAINS(errorOf([&] { openVolume(channels); }), "3 values per voxel");
  expectVolume(channels, component(2), 2);
}

}  // namespace
}  // namespace isobrick
