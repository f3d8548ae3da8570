// HDF5 as programs write it: axes, several volumes in a file, filters, places.
#include <gtest/gtest.h>
#include <lz4.h>
#include <zstd.h>

#include <functional>
#include <numeric>
#include <thread>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/volume_source.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

constexpr Index3 kHdf5Voxels(7, 5, 4);
const std::vector<std::uint64_t> kZyx = {4, 5, 7};

// A number for each voxel, which tells where it is.
std::uint16_t numberAt(std::int64_t x, std::int64_t y, std::int64_t z, std::int64_t further = 0) {
  return static_cast<std::uint16_t>(1 + x + 10 * y + 100 * z + 1000 * further);
}

std::vector<std::uint16_t> zyxNumbers(std::int64_t further = 0) {
  std::vector<std::uint16_t> values;
  for (std::int64_t z = 0; z < 4; ++z)
    for (std::int64_t y = 0; y < 5; ++y)
      for (std::int64_t x = 0; x < 7; ++x) values.push_back(numberAt(x, y, z, further));
  return values;
}
const std::string kZyxBytes = bytesOfValues(zyxNumbers());

std::string vigraTags(const std::string& keys) {
  std::string axes;
  for (const char key : keys)
    axes += (axes.empty() ? "" : ", ") + std::string(R"({"key": ")") + key +
            R"(", "typeFlags": 2, "resolution": 0, "description": ""})";
  return R"({"axes": [)" + axes + "]}";
}

class Hdf5SourceTest : public VolumeFilesTest {
 protected:
  std::string make(const std::function<void(Hdf5TestFile&)>& fill,
                   const std::string& name = "a.h5") const {
    Hdf5TestFile file(pathOf(name));
    fill(file);
    return pathOf(name);
  }

  static std::unique_ptr<VolumeSource> expectNumbers(const std::string& path,
                                                     const OpenOptions& options = {},
                                                     std::int64_t further = 0) {
    auto source = openHdf5Source(path, options);
    EXPECT_EQ(source->info().voxels, kHdf5Voxels) << path;
    EXPECT_EQ(readVoxels<std::uint16_t>(*source), zyxNumbers(further)) << path;
    const IndexBox box{Index3(2, 1, 1), Index3(3, 2, 2)};
    std::vector<std::uint16_t> part(12);
    source->readBox(box, part.data());
    EXPECT_EQ(part.front(), numberAt(2, 1, 1, further)) << path;
    EXPECT_EQ(part[1], numberAt(3, 1, 1, further)) << path;
    EXPECT_EQ(part.back(), numberAt(4, 2, 2, further)) << path;
    return source;
  }

  static std::string refusal(const std::string& path, const OpenOptions& options = {}) {
    const std::string text = errorOf([&] { readAll(*openHdf5Source(path, options)); });
    EXPECT_EQ(text.find("damaged"), std::string::npos) << text;
    return text;
  }
};

// In the order of the axes' letters; times and channels tell themselves apart by a thousand each.
std::string inOrder(const std::string& keys, std::vector<std::uint64_t>& dims) {
  const auto countOf = [](char key) -> std::int64_t {
    return key == 'x' ? 7 : key == 'y' ? 5 : key == 'z' ? 4 : key == 't' ? 3 : 2;
  };
  std::vector<std::uint16_t> values;
  std::vector<std::int64_t> at(128, 0);
  const std::function<void(std::size_t)> fill = [&](std::size_t axis) {
    if (axis == keys.size()) {
      values.push_back(numberAt(at['x'], at['y'], at['z'], at['t'] + 3 * at['c']));
      return;
    }
    auto& index = at[static_cast<std::size_t>(keys[axis])];
    for (index = 0; index < countOf(keys[axis]); ++index) fill(axis + 1);
  };
  fill(0);
  dims.clear();
  for (const char key : keys) dims.push_back(static_cast<std::uint64_t>(countOf(key)));
  return bytesOfValues(values);
}

TEST_F(Hdf5SourceTest, AxesAreThoseThatTheFileNames) {
  for (const std::string keys : {"zyx", "xyz", "yzx", "zyxc", "czyx", "tzyx", "tzyxc", "xyzct"}) {
    std::vector<std::uint64_t> dims;
    const std::string bytes = inOrder(keys, dims);
    const std::string path = make([&](Hdf5TestFile& file) {
      file.dataset("exported_data", dims, "u2", bytes,
                   {.chunk = std::vector<std::uint64_t>(dims.size(), 2)});
      file.text("exported_data", "axistags", vigraTags(keys));
    });
    const bool has_time = keys.find('t') != std::string::npos;
    const bool has_channel = keys.find('c') != std::string::npos;
    OpenOptions options;
    if (has_time) options.time = 2;
    if (has_channel) options.channel = 1;
    const auto source = expectNumbers(path, options, (has_time ? 2 : 0) + (has_channel ? 3 : 0));
    if (has_time || has_channel) {
      EXPECT_FALSE(source->info().encoding.empty()) << keys;
    }
    // One further axis is told apart by either word.
    if (has_time != has_channel) {
      std::swap(options.time, options.channel);
      expectNumbers(path, options, has_time ? 2 : 3);
      EXPECT_CONTAINS(refusal(path), has_time ? "the times 0 to 2" : "the channels 0 to 1");
    }
    if (!has_time && !has_channel) {
      options.channel = 1;
      EXPECT_CONTAINS(refusal(path, options), "no channel to choose");
    }
  }
}

TEST_F(Hdf5SourceTest, PicturesOverTimeAreNoVolume) {
  const std::string path = make([](Hdf5TestFile& file) {
    file.dataset("exported_data", kZyx, "u2", kZyxBytes);
    file.text("exported_data", "axistags", vigraTags("tyx"));
  });
  EXPECT_CONTAINS(refusal(path), "'t' 4, 'y' 5, 'x' 7");
}

TEST_F(Hdf5SourceTest, AChoiceOfWhatIsNotThereIsRefused) {
  const std::string path =
      make([](Hdf5TestFile& file) { file.dataset("a", kZyx, "u2", kZyxBytes); });
  OpenOptions options;
  options.channel = 1;
  EXPECT_CONTAINS(refusal(path, options), "no channel to choose: its axes are 4 x 5 x 7");
  options.channel.reset();
  options.time = 1;
  EXPECT_CONTAINS(refusal(path, options), "no time to choose");
  const std::string thin = make([](Hdf5TestFile& file) {
    file.dataset("a", {1, 4, 5, 7}, "u2", kZyxBytes);
  });
  EXPECT_CONTAINS(refusal(thin, options), "one time, number 0");
  options.time = 0;
  expectNumbers(thin, options);
}

TEST_F(Hdf5SourceTest, ScalesOfDimensionsNameAndPlaceTheAxes) {
  const auto fill = [](Hdf5TestFile& file, const std::vector<double>& z) {
    file.dataset("x", {7}, "f8", bytesOfValues(std::vector<double>{0, 2, 4, 6, 8, 10, 12}));
    file.dataset("y", {5}, "f8", bytesOfValues(std::vector<double>{4, 3, 2, 1, 0}));
    file.dataset("z", {4}, "f8", bytesOfValues(z));
    for (const char* name : {"x", "y", "z"}) file.text(name, "units", "m");
    file.dataset("density", kZyx, "u2", kZyxBytes);
    file.scales("density", {"z", "y", "x"});
  };
  const std::string path = make(
      [&](Hdf5TestFile& file) {
        fill(file, {10, 10.5, 11, 11.5});
      },
      "a.nc");
  const auto source = expectNumbers(path);
  const GridGeometry& geometry = source->info().geometry;
  EXPECT_EQ(geometry.spacing, glm::dvec3(2000, 1000, 500));
  EXPECT_EQ(geometry.origin, glm::dvec3(0, 4000, 10000));
  EXPECT_EQ(geometry.direction[1], glm::dvec3(0, -1, 0));
  EXPECT_EQ(geometry.unit, LengthUnit::kMillimetre);
  const std::string uneven = make(
      [&](Hdf5TestFile& file) {
        fill(file, {10, 10.4, 11, 11.5});
      },
      "b.nc");
  EXPECT_CONTAINS(refusal(uneven), "axis 'z' are uneven, up to 0.2 voxels");
  OpenOptions options;
  options.spacing = glm::dvec3(1);
  expectNumbers(uneven, options);
  // Time over two axes of space.
  const std::string flat = make(
      [](Hdf5TestFile& file) {
        for (const auto& [name, count] :
             std::vector<std::pair<std::string, std::size_t>>{{"time", 4}, {"lat", 5}, {"lon", 7}})
          file.dataset(name, {count}, "f8", bytesOfValues(std::vector<double>(count, 1)));
        file.dataset("density", kZyx, "u2", kZyxBytes);
        file.scales("density", {"time", "lat", "lon"});
      },
      "c.nc");
  EXPECT_CONTAINS(refusal(flat), "'time' 4, 'lat' 5, 'lon' 7");
}

TEST_F(Hdf5SourceTest, PackedNumbersOfNetCdfAreUnpacked) {
  const std::string path = make([](Hdf5TestFile& file) {
    file.dataset("a", kZyx, "u2", kZyxBytes);
    file.numbers("a", "scale_factor", {0.5});
    file.numbers("a", "add_offset", {-3});
  });
  const auto source = openHdf5Source(path);
  const auto voxels = readVoxels<float>(*source);
  EXPECT_EQ(voxels[0], 0.5F * 1 - 3);
  EXPECT_EQ(voxels[139], 0.5F * numberAt(6, 4, 3) - 3);
}

TEST_F(Hdf5SourceTest, OlderFormatsOfTheSameEndingAreNamed) {
  EXPECT_CONTAINS(refusal(write("a.nc", "CDF\x01 and so on, for some bytes")), "NetCDF 3");
  EXPECT_CONTAINS(refusal(write("a.mat", "MATLAB 5.0 MAT-file, Platform: x")), "MATLAB");
  EXPECT_CONTAINS(refusal(write("a.hdf", "\x0e\x03\x13\x01 and so on")), "HDF4");
  EXPECT_CONTAINS(refusal(write("a.h5", "nothing")), "no HDF5 file");
}

TEST_F(Hdf5SourceTest, ElementSizesHaveAnyShape) {
  const auto spacingWith = [&](const std::vector<double>& sizes,
                               const std::vector<std::uint64_t>& shape,
                               const std::vector<std::uint64_t>& dims = kZyx) {
    const std::string path = make([&](Hdf5TestFile& file) {
      file.dataset("a", dims, "u2", kZyxBytes);
      file.numbers("a", "element_size_um", sizes, shape);
    });
    return expectNumbers(path)->info().geometry.spacing;
  };
  const glm::dvec3 spacing(0.0008, 0.0009, 0.002);
  EXPECT_EQ(spacingWith({2, 0.9, 0.8}, {3}), spacing);
  EXPECT_EQ(spacingWith({2, 0.9, 0.8}, {1, 3}), spacing);
  EXPECT_EQ(spacingWith({1, 2, 0.9, 0.8, 1}, {5}), spacing);
  EXPECT_EQ(spacingWith({2, 0.9, 0.8}, {3}, {1, 1, 4, 5, 7}), spacing);
  EXPECT_EQ(spacingWith({2, 0.9, 0.8}, {3}, {4, 1, 5, 7}), spacing);
  EXPECT_EQ(spacingWith({2, 5, 0.9, 0.8}, {4}, {4, 1, 5, 7}), spacing);
}

// ---- several volumes in a file
// -------------------------------------------------------------------

void fillBdv(Hdf5TestFile& file, int times, int setups) {
  for (int setup = 0; setup < setups; ++setup) {
    const std::string s = "s0" + std::to_string(setup);
    file.dataset(s + "/resolutions", {2, 3}, "f8",
                 bytesOfValues(std::vector<double>{1, 1, 1, 2, 2, 1}));
    for (int time = 0; time < times; ++time) {
      const std::string at = "t0000" + std::to_string(time) + "/" + s;
      // Its numbers are unsigned, and their type is not.
      std::vector<std::uint16_t> values = zyxNumbers(time + 3 * setup);
      for (std::uint16_t& value : values) value = static_cast<std::uint16_t>(value + 40000);
      file.dataset(at + "/0/cells", kZyx, "i2", bytesOfValues(values));
      file.dataset(at + "/1/cells", {4, 3, 4}, "i2", std::string(96, '\1'));
    }
  }
}

constexpr const char* kBdvXml =
    R"(<SpimData version="0.2"><BasePath type="relative">.</BasePath><SequenceDescription>
<ImageLoader format="bdv.hdf5"><hdf5 type="relative">a.h5</hdf5></ImageLoader><ViewSetups>
<ViewSetup><id>0</id><voxelSize><unit>um</unit><size>0.8 0.9 2.0</size></voxelSize></ViewSetup>
<ViewSetup><id>1</id><voxelSize><unit>um</unit><size>1 1 1</size></voxelSize></ViewSetup>
</ViewSetups></SequenceDescription><ViewRegistrations>PLACES</ViewRegistrations></SpimData>)";

std::string bdvXml(const std::string& places) {
  std::string xml = kBdvXml;
  return xml.replace(xml.find("PLACES"), 6, places);
}

std::string bdvPlace(const std::string& affines) {
  return R"(<ViewRegistration timepoint="0" setup="0">)" + affines + "</ViewRegistration>";
}
std::string bdvAffine(const std::string& numbers) {
  return R"(<ViewTransform type="affine"><affine>)" + numbers + "</affine></ViewTransform>";
}

TEST_F(Hdf5SourceTest, BigDataViewerHasUnsignedNumbersOfTimesAndSetups) {
  const auto firstOf = [&](const std::string& path, const OpenOptions& options = {}) {
    return readVoxels<std::uint16_t>(*openHdf5Source(path, options)).front();
  };
  const std::string one = make([](Hdf5TestFile& file) { fillBdv(file, 1, 1); });
  EXPECT_EQ(firstOf(one), 40001);
  EXPECT_EQ(firstOf(one + ":/t00000/s00/0/cells"), 40001);
  const GridGeometry coarser = openHdf5Source(one + ":/t00000/s00/1/cells")->info().geometry;
  EXPECT_EQ(coarser.spacing, glm::dvec3(2, 2, 1));
  EXPECT_EQ(coarser.origin, glm::dvec3(0.5, 0.5, 0));
  const std::string many = make([](Hdf5TestFile& file) { fillBdv(file, 2, 2); });
  EXPECT_CONTAINS(refusal(many), "the times 0, 1");
  OpenOptions options;
  options.time = 1;
  EXPECT_CONTAINS(refusal(many, options), "the setups 0, 1");
  options.channel = 1;
  EXPECT_EQ(firstOf(many, options), 44001);
  EXPECT_EQ(openHdf5Source(many, options)->info().encoding, "time 1, channel 1");
  options.channel = 2;
  EXPECT_CONTAINS(refusal(many, options), "and not 2");
}

TEST_F(Hdf5SourceTest, TheXmlOfBigDataViewerPlacesTheVoxels) {
  make([](Hdf5TestFile& file) { fillBdv(file, 1, 2); });
  OpenOptions options;
  options.channel = 0;
  const auto geometryWith = [&](const std::string& places) {
    const auto source = openHdf5Source(write("a.xml", bdvXml(places)), options);
    EXPECT_EQ(source->files(), (std::vector<std::string>{pathOf("a.xml"), pathOf("a.h5")}));
    EXPECT_EQ(source->info().geometry.unit, LengthUnit::kMillimetre);
    return source->info().geometry;
  };
  const glm::dvec3 spacing(0.0008, 0.0009, 0.002);
  EXPECT_EQ(geometryWith("").spacing, spacing);
  const std::string calibration = bdvAffine("0.8 0 0 0 0 0.9 0 0 0 0 2 0");
  const GridGeometry moved =
      geometryWith(bdvPlace(bdvAffine("1 0 0 10 0 1 0 20 0 0 1 30") + calibration));
  EXPECT_LT(glm::length(moved.spacing - spacing), 1e-12);
  EXPECT_LT(glm::length(moved.origin - glm::dvec3(0.01, 0.02, 0.03)), 1e-12);
  // BigStitcher counts in voxels of the least size.
  const GridGeometry counted = geometryWith(bdvPlace(bdvAffine("1 0 0 10 0 1.125 0 0 0 0 2.5 0")));
  EXPECT_LT(glm::length(counted.spacing - spacing), 1e-12);
  EXPECT_LT(glm::length(counted.origin - glm::dvec3(0.008, 0, 0)), 1e-12);
  const auto refuses = [&](const std::string& xml, const std::string& why) {
    EXPECT_CONTAINS(refusal(write("a.xml", xml), options), why);
  };
  refuses(bdvXml(bdvPlace(bdvAffine("1 0 0 0 0 1 0 0 0 0 1 0"))), "other proportions");
  refuses(bdvXml(bdvPlace(bdvAffine("1 0 0"))), "twelve numbers");
  refuses("<OME/>", "XML of 'OME'");
  refuses("<SpimData>", "not well-formed at line 1");
  refuses("<!DOCTYPE x><SpimData/>", "not well-formed");
  refuses(
      "<SpimData><SequenceDescription><ImageLoader format='bdv.n5'/></SequenceDescription>"
      "</SpimData>",
      "'bdv.n5'");
  options.channel.reset();
  refuses(bdvXml(""), "the setups 0, 1");
}

TEST_F(Hdf5SourceTest, ImarisHasExtentsAndFillsItsChunks) {
  const auto fill = [](Hdf5TestFile& file, int channels) {
    std::vector<std::uint64_t> dims = {8, 8, 8};
    for (int channel = 0; channel < channels; ++channel) {
      std::vector<std::uint16_t> values;
      for (std::int64_t z = 0; z < 8; ++z)
        for (std::int64_t y = 0; y < 8; ++y)
          for (std::int64_t x = 0; x < 8; ++x) values.push_back(numberAt(x, y, z, channel));
      const std::string group =
          "DataSet/ResolutionLevel 0/TimePoint 0/Channel " + std::to_string(channel);
      file.dataset(group + "/Data", dims, "u2", bytesOfValues(values), {.chunk = {4, 4, 4}});
      file.letters(group, "ImageSizeX", "7");
      file.letters(group, "ImageSizeY", "5");
      file.letters(group, "ImageSizeZ", "4");
    }
    file.group("DataSetInfo/Image");
    const char* const texts[][2] = {{"ExtMin0", "1"},   {"ExtMin1", "0"}, {"ExtMin2", "0"},
                                    {"ExtMax0", "6.6"}, {"ExtMax1", "5"}, {"ExtMax2", "8"},
                                    {"Unit", "um"}};
    for (const auto& [name, value] : texts) file.letters("DataSetInfo/Image", name, value);
  };
  const std::string path = make([&](Hdf5TestFile& file) { fill(file, 1); }, "a.ims");
  for (const std::string part : {"", ":/DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data"}) {
    const GridGeometry geometry = expectNumbers(path + part)->info().geometry;
    EXPECT_LT(glm::length(geometry.spacing - glm::dvec3(0.0008, 0.001, 0.002)), 1e-12);
    EXPECT_LT(glm::length(geometry.origin - glm::dvec3(0.0014, 0.0005, 0.001)), 1e-12);
  }
  const std::string two = make([&](Hdf5TestFile& file) { fill(file, 2); }, "a.ims");
  EXPECT_CONTAINS(refusal(two), "the channels 0, 1");
  OpenOptions options;
  options.channel = 1;
  expectNumbers(two, options, 1);
}

TEST_F(Hdf5SourceTest, DatasetsBehindLinksAreListed) {
  make([](Hdf5TestFile& file) { file.dataset("d", kZyx, "u2", kZyxBytes); }, "linked.h5");
  const std::string path =
      make([](Hdf5TestFile& file) { file.externalLink("data/one", "linked.h5", "/d"); });
  expectNumbers(path);
  const std::string two = make([](Hdf5TestFile& file) {
    file.externalLink("data/one", "linked.h5", "/d");
    file.externalLink("data/two", "linked.h5", "/d");
  });
  EXPECT_CONTAINS(refusal(two), "'/data/one', '/data/two'");
}

// ---- filters and other files
// ---------------------------------------------------------------------

// The first bits of all numbers, then the second ones, and so on.
std::string bitshuffled(const std::string& bytes, std::size_t number_bytes) {
  const std::size_t numbers = bytes.size() / number_bytes;
  std::string out(bytes.size(), '\0');
  for (std::size_t i = 0; i < numbers; ++i)
    for (std::size_t bit = 0; bit < 8 * number_bytes; ++bit) {
      const int value = bytes[i * number_bytes + bit / 8] >> (bit % 8) & 1;
      char& to = out[bit * (numbers / 8) + i / 8];
      to = static_cast<char>(to | value << (i % 8));
    }
  return out;
}

std::string packedBy(const std::string& how, const std::string& bytes) {
  if (how == "none") return bytes;
  std::string packed(
      how == "zstd" ? ZSTD_compressBound(bytes.size())
                    : static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(bytes.size()))),
      '\0');
  packed.resize(how == "zstd"
                    ? ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(), 1)
                    : static_cast<std::size_t>(LZ4_compress_default(
                          bytes.data(), packed.data(), static_cast<int>(bytes.size()),
                          static_cast<int>(packed.size()))));
  return packed;
}

std::string bitshuffleChunk(const std::string& bytes, std::size_t number_bytes, std::size_t block,
                            const std::string& how) {
  const bool is_packed = how != "none";
  std::string chunk;
  if (is_packed)
    chunk = bytesOfValues(std::vector<std::uint64_t>{bytes.size()}, true) +
            bytesOfValues(std::vector{static_cast<std::uint32_t>(block * number_bytes)}, true);
  const std::size_t whole = bytes.size() / number_bytes / 8 * 8;
  for (std::size_t at = 0; at < whole; at += block) {
    const std::string part = packedBy(
        how,
        bitshuffled(bytes.substr(at * number_bytes, std::min(block, whole - at) * number_bytes),
                    number_bytes));
    if (is_packed)
      chunk += bytesOfValues(std::vector{static_cast<std::uint32_t>(part.size())}, true);
    chunk += part;
  }
  return chunk + bytes.substr(whole * number_bytes);
}

TEST_F(Hdf5SourceTest, ChunksOfLzfBitshuffleAndZstandardAreUnpacked) {
  const auto with = [&](int filter, const std::vector<unsigned>& values, const std::string& bytes) {
    return make([&](Hdf5TestFile& file) {
      file.dataset("a", kZyx, "u2", bytes,
                   {.chunk = kZyx, .filter = filter, .filter_values = values});
    });
  };
  expectNumbers(with(32015, {3}, packedBy("zstd", kZyxBytes)));
  EXPECT_CONTAINS(errorOf([&] { expectNumbers(with(32015, {3}, kZyxBytes)); }), "get it again");
  // A literal run of up to 32 bytes has its length before it.
  std::string lzf;
  for (std::size_t at = 0; at < kZyxBytes.size(); at += 32) {
    const std::string run = kZyxBytes.substr(at, 32);
    lzf += static_cast<char>(run.size() - 1) + run;
  }
  expectNumbers(with(32000, {4, 261, 280}, lzf));
  const std::string cut = with(32000, {4, 261, 280}, lzf.substr(0, 100));
  EXPECT_CONTAINS(errorOf([&] { readAll(*openHdf5Source(cut)); }), "get it again");
  // 140 numbers: whole blocks of 32, a shorter one, and four that stay.
  for (const auto& [how, code] :
       std::vector<std::pair<std::string, unsigned>>{{"none", 0}, {"lz4", 2}, {"zstd", 3}}) {
    const std::string chunk = bitshuffleChunk(kZyxBytes, 2, 32, how);
    expectNumbers(with(32008, {0, 4, 2, 32, code}, chunk));
    if (how == "none") continue;
    // Every prefix, and sizes that are not true.
    std::vector<std::pair<std::vector<unsigned>, std::string>> wrong = {
        {{}, chunk}, {{0, 4, 0, 32, code}, chunk}, {{0, 4, 3, 32, code}, chunk}};
    for (std::size_t bytes = 1; bytes < chunk.size(); bytes += 7)
      wrong.push_back({{0, 4, 2, 32, code}, chunk.substr(0, bytes)});
    for (const auto& [values, content] : wrong) {
      const std::string path = with(32008, values, content);
      EXPECT_CONTAINS(errorOf([&] { readAll(*openHdf5Source(path)); }), "get it again");
    }
  }
}

TEST_F(Hdf5SourceTest, AFilterThatIsMissingIsNamedWithItsPackage) {
  const auto fill = [](Hdf5TestFile& file, int filter) {
    file.dataset("a", kZyx, "u2", kZyxBytes, {.chunk = kZyx, .filter = filter});
  };
  EXPECT_CONTAINS(refusal(make([&](Hdf5TestFile& file) { fill(file, 32013); })),
                  "hdf5-filter-plugin-zfp-serial");
  EXPECT_CONTAINS(refusal(make([&](Hdf5TestFile& file) { fill(file, 40000); })), "filter 40000");
  // Also where a virtual dataset takes its voxels from, over two steps.
  make([&](Hdf5TestFile& file) { fill(file, 32013); }, "packed.h5");
  make([](Hdf5TestFile& file) { file.virtualDataset("b", kZyx, "u2", "packed.h5", "a"); },
       "between.h5");
  const std::string path =
      make([](Hdf5TestFile& file) { file.virtualDataset("c", kZyx, "u2", "between.h5", "b"); });
  const std::string message = refusal(path);
  EXPECT_CONTAINS(message, "packed.h5:a'");
  EXPECT_CONTAINS(message, "hdf5-filter-plugin-zfp-serial");
}

TEST_F(Hdf5SourceTest, AVirtualDatasetOverItselfIsRefused) {
  const std::string path =
      make([](Hdf5TestFile& file) { file.virtualDataset("a", kZyx, "u2", ".", "a"); });
  EXPECT_CONTAINS(refusal(path), "too many steps");
}

TEST_F(Hdf5SourceTest, RawFilesBesideAreFound) {
  write("voxels.raw", kZyxBytes);
  const std::string path = make(
      [](Hdf5TestFile& file) { file.dataset("a", kZyx, "u2", "", {.raw_file = "voxels.raw"}); });
  EXPECT_EQ(expectNumbers(path)->files(), (std::vector<std::string>{path, pathOf("voxels.raw")}));
  fs::remove(pathOf("voxels.raw"));
  EXPECT_CONTAINS(refusal(path), "voxels.raw");
}

// Each thread has a stack of errors of its own, which the library prints.
TEST_F(Hdf5SourceTest, NothingButTheErrorIsSaidInAnyThread) {
  const std::string path = make([](Hdf5TestFile& file) {
    file.dataset("a", kZyx, "u2", kZyxBytes, {.chunk = kZyx, .has_checksum = true});
  });
  std::string bytes = readBytes(path);
  const std::size_t at = bytes.find(kZyxBytes.substr(100, 30));
  ASSERT_NE(at, std::string::npos);
  bytes[at] = static_cast<char>(bytes[at] ^ 1);
  writeBytes(path, bytes);
  testing::internal::CaptureStderr();
  const auto source = openHdf5Source(path);
  // HDF5 1.10 names the filter, 1.14 says that one failed.
  std::string error;
  std::thread([&] { error = errorOf([&] { readAll(*source); }); }).join();
  EXPECT_TRUE(error.find("Fletcher32") != std::string::npos ||
              error.find("filter returned failure") != std::string::npos)
      << error;
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace isobrick
