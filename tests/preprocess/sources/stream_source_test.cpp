// Volumes by rows and by boxes: packed files are streamed, raw ones are read anywhere.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/index_loop.h"
#include "tests/support/array_source.h"
#include "tests/support/nifti_file.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/random_numbers.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

constexpr Index3 kStreamVoxels(7, 5, 6);
constexpr std::int64_t kRows = 30;

class StreamSourceTest : public VolumeFilesTest {};

std::vector<std::int16_t> sampleVoxels() {
  std::vector<std::int16_t> values(static_cast<std::size_t>(elementCount(kStreamVoxels)));
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<std::int16_t>(static_cast<int>(i * i * 131) % 60000 - 30000);
  return values;
}

const std::string kNrrd = "NRRD0004\ntype: short\ndimension: 3\nsizes: 7 5 6\nencoding: gzip\n";
const std::string kMeta =
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 7 5 6\nElementType = MET_SHORT\n"
    "CompressedData = True\n";

class PackedFilesTest : public VolumeFilesTest {
 protected:
  // Every format, in both byte orders, with the same voxels: the path of each.
  std::vector<std::string> writeFiles() const {
    std::vector<std::string> paths;
    for (const bool big : {false, true}) {
      const std::string bytes = bytesOfValues(sampleVoxels(), big), order = big ? "big" : "little";
      const std::string packed = deflated(bytes, true);
      const auto add = [&](const std::string& name, const std::string& content) {
        return write(order + name, content);
      };
      paths.push_back(add(".nrrd", kNrrd + "endian: " + order + "\n\n" + packed));
      add("data.gz", deflated("skipped" + bytes + "more", true));
      paths.push_back(add(".nhdr", kNrrd + "endian: " + order +
                                       "\nbyte skip: 7\ndata file: " + order + "data.gz\n"));
      // Two members, cut inside a voxel, with what is no third one behind them.
      paths.push_back(add("2.nrrd", kNrrd + "endian: " + order + "\n\n" +
                                        deflated(bytes.substr(0, 101), true) +
                                        deflated(bytes.substr(101), true) + "padding"));
      const std::string msb =
          std::string("BinaryDataByteOrderMSB = ") + (big ? "True\n" : "False\n");
      paths.push_back(
          add(".mha", kMeta + msb + "ElementDataFile = LOCAL\n" + deflated(bytes, false)));
      add("data.zraw", deflated(bytes, false));
      paths.push_back(add(".mhd", kMeta + msb + "ElementDataFile = " + order + "data.zraw\n"));
      const std::string nifti = niftiHeader(kStreamVoxels, {}, big) + bytes;
      paths.push_back(add(".nii.gz", deflated(nifti, true)));
      paths.push_back(add(".nii", nifti));
      NiftiFields pair;
      pair.magic = "ni1";
      pair.offset = 0;
      paths.push_back(add("pair.hdr", niftiHeader(kStreamVoxels, pair, big).substr(0, 348)));
      add("pair.img", bytes);
      add("packed.img.gz", packed);
      paths.push_back(add("packed.hdr", niftiHeader(kStreamVoxels, pair, big).substr(0, 348)));
    }
    return paths;
  }
};

TEST_F(PackedFilesTest, AreReadByAnyNumberOfRows) {
  const auto values = sampleVoxels();
  for (const std::string& path : writeFiles())
    for (const std::int64_t count : {1, 2, 3, 7, 29, 30}) {
      const auto source = openVolume(path);
      ASSERT_EQ(source->info().voxel_type, VoxelType::kInt16) << path;
      ASSERT_EQ(source->info().voxels, kStreamVoxels) << path;
      // The header counts too, if it is a file of its own.
      std::string header;
      for (const char* ending : {".nhdr", ".mhd", ".hdr"})
        if (path.ends_with(ending)) header = path;
      const std::vector<std::string> files = source->files();
      ASSERT_EQ(files.size(), header.empty() ? 1u : 2u) << path;
      ASSERT_EQ(files.front(), path);
      EXPECT_LE(source->bufferBytes(), 400u << 10) << path;
      std::vector<std::int16_t> read(values.size());
      for (std::int64_t row = 0; row < kRows; row += count)
        source->readRows(row, std::min(count, kRows - row), read.data() + row * 7);
      ASSERT_EQ(read, values) << path << " " << count;
    }
}

TEST_F(PackedFilesTest, SkipForwardAndRefuseToGoBack) {
  const auto values = sampleVoxels();
  for (const std::string& path : writeFiles()) {
    const auto source = openVolume(path);
    std::vector<std::int16_t> rows(7 * 4);
    for (const std::int64_t first : {3, 8, 19, 26}) {
      source->readRows(first, 4, rows.data());
      EXPECT_TRUE(std::equal(rows.begin(), rows.end(), values.begin() + first * 7)) << path;
    }
    if (!source->readsBoxes()) {
      EXPECT_THROW(source->readRows(2, 1, rows.data()), std::logic_error);
    }
  }
}

TEST_F(PackedFilesTest, EveryPrefixIsAnErrorThatNamesTheFile) {
  const std::string bytes = bytesOfValues(sampleVoxels());
  const std::vector<std::pair<std::string, std::string>> files = {
      {"cut.nrrd", kNrrd + "endian: little\n\n" + deflated(bytes, true)},
      {"cut.mha", kMeta + "ElementDataFile = LOCAL\n" + deflated(bytes, false)},
      {"cut.nii.gz", deflated(niftiHeader(kStreamVoxels, {}, false) + bytes, true)},
      {"cut.nii", niftiHeader(kStreamVoxels, {}, false) + bytes}};
  for (const auto& [name, whole] : files) {
    EXPECT_NO_THROW(openAndRead(write(name, whole)));
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const std::string path = write(name, whole.substr(0, size));
      const std::string message = errorOf([&] { openAndRead(path); });
      ASSERT_NE(message.find(path), std::string::npos) << size << ": " << message;
    }
  }
}

TEST_F(PackedFilesTest, DamageIsAnErrorAndNeverACrash) {
  const std::string bytes = bytesOfValues(sampleVoxels());
  const std::string start = kNrrd + "endian: little\n\n", packed = deflated(bytes, true);
  std::size_t silent = 0;
  for (std::size_t i = 0; i < packed.size(); ++i) {
    std::string damaged = packed;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x24);
    try {
      const auto source = openVolume(write("damaged.nrrd", start + damaged));
      EXPECT_NE(readVoxels<std::int16_t>(*source), std::vector<std::int16_t>());
      ++silent;
    } catch (const Error& error) {
      EXPECT_CONTAINS(std::string(error.what()), pathOf("damaged.nrrd"));
    }
  }
  EXPECT_LE(silent, 8u);  // time, system and flags of the gzip header mean nothing to the content
}

TEST_F(PackedFilesTest, SaysWhereTheContentEnds) {
  const std::string bytes = bytesOfValues(sampleVoxels());
  const auto message = [&](const std::string& packed) {
    return errorOf([&] { openAndRead(write("x.nrrd", kNrrd + "endian: little\n\n" + packed)); });
  };
  EXPECT_CONTAINS(message(deflated(bytes.substr(0, 100), true)),
                  "its content ends after 100 bytes and the header needs 420");
  const std::string two = deflated(bytes.substr(0, 100), true) + deflated(bytes, true);
  EXPECT_CONTAINS(message(two.substr(0, deflated(bytes.substr(0, 100), true).size() + 12)),
                  "cut short after 100 bytes of content");
  EXPECT_CONTAINS(message("this was never packed"), "damaged after 0 bytes of content");
  EXPECT_CONTAINS(message(""), "cut short after 0 bytes");
  std::string checksum = deflated(bytes, true);
  checksum[checksum.size() - 8] = static_cast<char>(checksum[checksum.size() - 8] ^ 1);
  EXPECT_CONTAINS(message(checksum), "damaged after 420 bytes");
  EXPECT_CONTAINS(
      errorOf([&] { openAndRead(write("lost.mhd", kMeta + "ElementDataFile = none.zraw\n")); }),
      "lost.mhd' names: No such file");
}

TEST_F(PackedFilesTest, AReadThatFailsIsNoDamage) {
  // Nothing is mapped at address 0: reading there is an error of the device.
  const std::string path =
      write("disk.nhdr", kNrrd + "endian: little\ndata file: /proc/self/mem\n");
  try {
    openAndRead(path);
    ADD_FAILURE() << "no Error was thrown";
  } catch (const ResumableError& error) {
    EXPECT_CONTAINS(std::string(error.what()),
                    "cannot read '/proc/self/mem' at byte 0: Input/output");
  }
}

// ---- NIfTI --------------------------------------------------------------------------------------

// Stored numbers as they are, or scaled in double: float32 of what float32 holds, else float64.
// A slope of 0 or NaN is none, and then the intercept means nothing.
template <typename T>
void checkNiftiScaling(const std::function<std::string(const std::string&)>& write,
                       std::int16_t data_type) {
  std::vector<T> stored(static_cast<std::size_t>(elementCount(kStreamVoxels)));
  for (std::size_t i = 0; i < stored.size(); ++i)
    stored[i] = static_cast<T>(static_cast<double>(i) * 0.6 + (i % 3 == 0 ? 0 : 0.25));
  stored[1] = static_cast<T>(std::numeric_limits<T>::max() / 3);
  stored[2] = static_cast<T>(std::numeric_limits<T>::lowest() / 3);
  for (const bool big : {false, true})
    for (const float slope : {0.0f, 1.0f, 2.0078f, std::numeric_limits<float>::quiet_NaN()})
      for (const float intercept : {0.0f, -3.3f}) {
        NiftiFields fields{data_type, static_cast<std::int16_t>(8 * sizeof(T)), slope, intercept};
        OpenOptions as_they_are;
        as_they_are.keep_numbers = true;
        const auto source =
            openVolume(write(niftiHeader(kStreamVoxels, fields, big) + bytesOfValues(stored, big)),
                       as_they_are);
        const double s = std::isnan(slope) || slope == 0 ? 1 : static_cast<double>(slope);
        const double b = std::isnan(slope) || slope == 0 ? 0 : static_cast<double>(intercept);
        const bool scaled = s != 1 || b != 0;
        EXPECT_TRUE(source->readsBoxes());
        const bool is_small = sizeof(T) < 4 || std::is_same_v<T, float>;
        EXPECT_EQ(source->info().voxel_type, !scaled    ? voxelTypeOf<T>()
                                             : is_small ? VoxelType::kFloat32
                                                        : VoxelType::kFloat64);
        visitNumberType(source->info().voxel_type, [&](auto tag) {
          using Out = typename decltype(tag)::Type;
          const auto read = readVoxels<Out>(*source);
          for (std::size_t i = 0; i < stored.size(); ++i) {
            const double number = static_cast<double>(stored[i]);
            const Out expected =
                scaled ? static_cast<Out>(number * s + b) : static_cast<Out>(stored[i]);
            ASSERT_EQ(read[i], expected) << data_type << " " << slope << " " << intercept;
          }
        });
      }
}

TEST_F(PackedFilesTest, NiftiValuesAreScaledInDouble) {
  const auto save = [&](const std::string& bytes) { return write("scaled.nii", bytes); };
  checkNiftiScaling<std::uint8_t>(save, 2);
  checkNiftiScaling<std::int16_t>(save, 4);
  checkNiftiScaling<std::int32_t>(save, 8);
  checkNiftiScaling<float>(save, 16);
  checkNiftiScaling<double>(save, 64);
  checkNiftiScaling<std::int8_t>(save, 256);
  checkNiftiScaling<std::uint16_t>(save, 512);
  checkNiftiScaling<std::uint32_t>(save, 768);
  checkNiftiScaling<std::int64_t>(save, 1024);
  checkNiftiScaling<std::uint64_t>(save, 1280);
}

TEST_F(PackedFilesTest, NiftiNumbersThatAreNotFiniteStayWhatTheyAre) {
  std::vector<float> stored(210, 2.0f);
  stored[3] = std::numeric_limits<float>::quiet_NaN();
  stored[4] = std::numeric_limits<float>::infinity();
  for (const float intercept : {0.0f, 3.5f}) {
    const NiftiFields fields{16, 32, 1, intercept};
    const auto source = openVolume(
        write("nan.nii", niftiHeader(kStreamVoxels, fields, false) + bytesOfValues(stored)));
    const auto read = readVoxels<float>(*source);
    EXPECT_TRUE(std::isnan(read[3]));
    EXPECT_EQ(read[4], std::numeric_limits<float>::infinity());
    EXPECT_EQ(read[5], 2 + intercept);
  }
}

TEST_F(PackedFilesTest, DamagedNiftiHeadersAreErrors) {
  const std::string bytes = bytesOfValues(sampleVoxels());
  NiftiFields fields;
  fields.offset = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(openAndRead(write("x.nii", niftiHeader(kStreamVoxels, fields, false) + bytes)),
               Error);
  fields.offset = 1e30f;
  EXPECT_THROW(openAndRead(write("x.nii", niftiHeader(kStreamVoxels, fields, false) + bytes)),
               Error);
  fields.offset = 0;
  fields.magic = "ni1";
  EXPECT_CONTAINS(
      errorOf([&] {
        openAndRead(write("alone.hdr", niftiHeader(kStreamVoxels, fields, false).substr(0, 348)));
      }),
      "alone.");
  const std::string whole = niftiHeader(kStreamVoxels, {}, false) + bytes;
  for (std::size_t i = 0; i < 352; ++i)
    for (const int bits : {0x01, 0x80, 0xff}) {
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ bits);
      try {
        openAndRead(write("damaged.nii", damaged));
      } catch (const Error&) {
      }
    }
}

// ---- boxes of raw files -------------------------------------------------------------------------

template <typename T>
void checkBoxes(const std::string& path, const std::string& type, Random& random) {
  const Index3 dims(13, 9, 11);
  std::vector<T> values(static_cast<std::size_t>(elementCount(dims)));
  for (T& value : values) value = static_cast<T>(random() % 100'000);
  for (const bool big : {false, true}) {
    std::ofstream(path, std::ios::binary) << "#####" << bytesOfValues(values, big);
    const auto source = openRawSource(path, {dims, type, big, 5});
    ASSERT_TRUE(source->readsBoxes());
    EXPECT_EQ(source->files(), std::vector<std::string>{path});
    visitNumberType(source->info().voxel_type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      const auto all = readVoxels<Out>(*source);
      for (int i = 0; i < 60; ++i) {
        IndexBox box;
        for (int axis = 0; axis < 3; ++axis) {
          const bool whole = random() % 3 == 0;
          box.first[axis] = whole ? 0 : static_cast<std::int64_t>(random() % 9) % dims[axis];
          const std::int64_t room = dims[axis] - box.first[axis];
          box.count[axis] = whole ? room : 1 + static_cast<std::int64_t>(random() % 20) % room;
        }
        std::vector<Out> read(static_cast<std::size_t>(box.size()));
        source->readBox(box, read.data());
        auto at = read.begin();
        for (std::int64_t z = box.first.z; z < box.end().z; ++z)
          for (std::int64_t y = box.first.y; y < box.end().y; ++y, at += box.count.x)
            ASSERT_TRUE(std::equal(at, at + box.count.x,
                                   all.begin() + linearIndex({box.first.x, y, z}, dims)))
                << type;
      }
    });
  }
}

TEST_F(StreamSourceTest, BoxesHaveTheVoxelsOfTheRows) {
  Random random(5);
  const std::string path = pathOf("box.raw");
  checkBoxes<std::uint8_t>(path, "u8", random);
  checkBoxes<std::int8_t>(path, "i8", random);
  checkBoxes<std::uint16_t>(path, "u16", random);
  checkBoxes<std::int16_t>(path, "i16", random);
  checkBoxes<float>(path, "f32", random);
  checkBoxes<std::uint32_t>(path, "u32", random);
  checkBoxes<std::int32_t>(path, "i32", random);
  checkBoxes<double>(path, "f64", random);
}

TEST_F(StreamSourceTest, BoxesAreReadByManyThreads) {
  // Rows of more voxels than a piece of the conversion.
  const Index3 dims(20'000, 3, 4);
  std::vector<double> values(static_cast<std::size_t>(elementCount(dims)));
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  const auto source =
      openRawSource(write("big.raw", bytesOfValues(values, true)), {dims, "f64", true});
  std::vector<std::thread> threads;
  std::vector<int> wrong(4);
  for (std::size_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      const IndexBox box{{static_cast<std::int64_t>(t), 0, static_cast<std::int64_t>(t)},
                         {19'990, 3, 1}};
      std::vector<double> read(static_cast<std::size_t>(box.size()));
      for (int repeat = 0; repeat < 20; ++repeat) {
        source->readBox(box, read.data());
        for (std::int64_t y = 0; y < 3; ++y)
          for (std::int64_t x = 0; x < 19'990; ++x)
            wrong[t] += read[static_cast<std::size_t>(y * 19'990 + x)] !=
                        static_cast<double>(linearIndex(box.first + Index3(x, y, 0), dims));
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, std::vector<int>(4));
}

TEST_F(StreamSourceTest, SourcesOfRowsHaveNoBoxes) {
  ArraySource<float> source(Index3(8), std::vector<float>(512));
  EXPECT_FALSE(source.readsBoxes());
  EXPECT_TRUE(source.files().empty());
  float voxel = 0;
  EXPECT_THROW(source.readBox({Index3(0), Index3(1)}, &voxel), std::logic_error);
}

TEST_F(StreamSourceTest, PhantomsAreReadByBoxes) {
  for (const std::string& name : phantomNames()) {
    PhantomSpec spec;
    spec.name = name;
    spec.size = 24;
    spec.voxel_type = VoxelType::kUint16;
    const auto source = makePhantomSource(spec);
    ASSERT_TRUE(source->readsBoxes());
    std::vector<std::uint16_t> whole(24 * 24 * 24), part(5 * 7 * 3);
    source->readRows(0, 24 * 24, whole.data());
    const IndexBox box{{13, 9, 20}, {5, 7, 3}};
    source->readBox(box, part.data());
    std::size_t i = 0;
    forEachIndex(box, [&](const Index3& at) {
      EXPECT_EQ(part[i++], whole[static_cast<std::size_t>(linearIndex(at, Index3(24)))]) << name;
    });
  }
}

}  // namespace
}  // namespace isobrick
