// OpenEXR slices as other programs write them: tiles, several parts and channels.
#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTiledOutputPart.h>
#include <gtest/gtest.h>

#include "isobrick/preprocess/sources/format_sources.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

constexpr Index3 kSliceVoxels(37, 21, 3);

// One channel of one part.
struct ExrPart {
  std::string name;
  std::string channel = "Y";
  bool is_tiled = false;
  float offset = 0;  // of its values
};

// Whole numbers that halves hold too.
float valueAt(const Index3& p, float offset) {
  return offset + static_cast<float>(p.x + 40 * p.y + 300 * p.z);
}

class ExrSourceTest : public VolumeFilesTest {
 protected:
  // The data window begins anywhere, and lines come from the last to the first in tiled parts.
  void writeSlice(std::int64_t z, const std::vector<ExrPart>& parts) const {
    const Imath::Box2i window({-5, 11}, {-5 + 36, 11 + 20});
    std::vector<Imf::Header> headers;
    for (const ExrPart& part : parts) {
      Imf::Header header(window, window);
      header.setName(part.name);
      header.setType(part.is_tiled ? Imf::TILEDIMAGE : Imf::SCANLINEIMAGE);
      header.compression() = part.is_tiled ? Imf::PIZ_COMPRESSION : Imf::ZIPS_COMPRESSION;
      if (part.is_tiled) {
        header.setTileDescription(Imf::TileDescription(16, 8, Imf::MIPMAP_LEVELS));
        header.lineOrder() = Imf::DECREASING_Y;
      }
      header.channels().insert(part.channel, Imf::Channel(Imf::FLOAT));
      headers.push_back(header);
    }
    fs::create_directories(pathOf("exr"));
    Imf::MultiPartOutputFile file(pathOf("exr/" + std::to_string(z) + ".exr").c_str(),
                                  headers.data(), static_cast<int>(headers.size()));
    for (std::size_t i = 0; i < parts.size(); ++i)
      writePart(file, static_cast<int>(i), z, parts[i]);
  }

  void expectChannel(const std::string& wanted, float offset) const {
    OpenOptions options;
    options.grid = wanted;
    const auto source = openExrSlices(pathOf("exr"), options);
    ASSERT_EQ(source->info().voxels, kSliceVoxels);
    const auto found = readVoxels<float>(*source, 1);
    std::size_t at = 0;
    for (std::int64_t z = 0; z < kSliceVoxels.z; ++z)
      for (std::int64_t y = 0; y < kSliceVoxels.y; ++y)
        for (std::int64_t x = 0; x < kSliceVoxels.x; ++x)
          ASSERT_EQ(found[at++], valueAt({x, y, z}, offset)) << wanted << x << " " << y << " " << z;
  }

 private:
  static void writePart(Imf::MultiPartOutputFile& file, int number, std::int64_t z,
                        const ExrPart& part) {
    std::vector<float> pixels;
    for (std::int64_t y = 0; y < kSliceVoxels.y; ++y)
      for (std::int64_t x = 0; x < kSliceVoxels.x; ++x)
        pixels.push_back(valueAt({x, y, z}, part.offset));
    Imf::FrameBuffer buffer;
    buffer.insert(part.channel,
                  Imf::Slice::Make(Imf::FLOAT, pixels.data(), file.header(number).dataWindow(),
                                   sizeof(float), kSliceVoxels.x * sizeof(float)));
    if (!part.is_tiled) {
      Imf::OutputPart out(file, number);
      out.setFrameBuffer(buffer);
      out.writePixels(static_cast<int>(kSliceVoxels.y));
      return;
    }
    Imf::TiledOutputPart out(file, number);
    out.setFrameBuffer(buffer);
    // Coarser levels, of which the same pixels are a part, must not be mistaken for the finest.
    for (int level = 0; level < out.numLevels(); ++level)
      out.writeTiles(0, out.numXTiles(level) - 1, 0, out.numYTiles(level) - 1, level);
  }
};

TEST_F(ExrSourceTest, TilesOfSeveralLevelsAreReadAsLinesAre) {
  for (std::int64_t z = 0; z < kSliceVoxels.z; ++z)
    writeSlice(z, {{.name = "a", .is_tiled = true}});
  expectChannel("", 0);
}

TEST_F(ExrSourceTest, AChannelIsFoundInWhicheverPartHasIt) {
  const std::vector<ExrPart> parts = {{.name = "first", .channel = "depth", .offset = 1000},
                                      {.name = "second", .is_tiled = true, .offset = 2000},
                                      {.name = "third", .channel = "mask", .offset = 3000}};
  for (std::int64_t z = 0; z < kSliceVoxels.z; ++z) writeSlice(z, parts);
  expectChannel("", 2000);  // Y before others
  expectChannel("depth", 1000);
  expectChannel("mask", 3000);
  const auto source = openExrSlices(pathOf("exr"), {});
  EXPECT_CONTAINS(source->info().notes.front(), "'depth', 'Y', 'mask'");
  // A slice whose channel is in another part is the same; one without it is refused.
  writeSlice(1, {{.name = "mask", .channel = "mask", .offset = 3000}});
  expectChannel("mask", 3000);
  OpenOptions depth;
  depth.grid = "depth";
  EXPECT_CONTAINS(errorOf([&] { readAll(*openExrSlices(pathOf("exr"), depth)); }), "exr/1.exr");
}

}  // namespace
}  // namespace isobrick::test
