// Small files of every format that is written here, cut short and with bytes of them changed: a
// clear line, or the volume; never a crash, which a sanitizer sees best.
#include <gtest/gtest.h>

#include <cstring>
#include <map>
#include <memory>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/array_source.h"
#include "tests/support/random_numbers.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

constexpr Index3 kHostileVoxels(9, 8, 7);

struct HostileFormat {
  const char* output;  // what is written
  const char* input;   // what is opened
  int prefixes;        // of each of its files, at the most
  int changes;         // in one byte
};

class HostileFormats : public VolumeFilesTest, public testing::WithParamInterface<HostileFormat> {
 protected:
  static std::vector<std::uint8_t> values() {
    return arrayOfField<std::uint8_t>(kHostileVoxels, [](const Index3& p) {
      return p.x * 31 + p.y * 57 + p.z * 101 + p.x * p.y;
    });
  }

  // Every file of the format, by its path.
  std::map<std::string, std::string> writeGood() const {
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<std::uint8_t>>(kHostileVoxels, values()));
    ExportOptions options;
    options.memory_bytes = std::uint64_t{64} << 20;
    exportVolume(levels, pathOf(GetParam().output), options);
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder_))
      if (entry.is_regular_file()) files[entry.path()] = readBytes(entry.path());
    return files;
  }

  // The voxels as numbers, or nothing if they are refused as they should be.
  std::vector<std::uint8_t> readOrRefuse(const std::string& what) const {
    std::vector<std::uint8_t> voxels;
    try {
      const auto source = openVolume(pathOf(GetParam().input));
      const Index3 count = source->info().voxels;
      if (elementCount(count) > 1 << 16) {  // a header that says so and is believed, not yet read
        std::vector<std::byte> row(static_cast<std::size_t>(count.x) * 4);
        source->readRows(0, 1, row.data());
        return {};
      }
      visitNumberType(source->info().voxel_type, [&](auto tag) {
        for (const auto value : readVoxels<typename decltype(tag)::Type>(*source))
          voxels.push_back(static_cast<std::uint8_t>(static_cast<int>(value)));
      });
    } catch (const Error& error) {
      const std::string line = textWithRemedies(error);
      EXPECT_EQ(line.find('\n'), std::string::npos) << what << ": " << line;
      EXPECT_NE(line.find(folder_.string()), std::string::npos) << what << ": " << line;
      return {};
    }
    return voxels;
  }
};

TEST_P(HostileFormats, EveryPrefixIsAnErrorOrTheVolume) {
  const auto good = writeGood();
  ASSERT_EQ(readOrRefuse("whole"), values());
  int refused = 0;
  for (const auto& [path, bytes] : good) {
    const std::size_t step = 1 + bytes.size() / static_cast<std::size_t>(GetParam().prefixes);
    for (std::size_t length = 0; length < bytes.size(); length += step) {
      writeBytes(path, bytes.substr(0, length));
      const std::string what = path + " of " + std::to_string(length) + " bytes";
      const auto found = readOrRefuse(what);
      refused += found.empty();
      if (!found.empty()) {
        EXPECT_EQ(found, values()) << what;
      }
    }
    writeBytes(path, bytes);
  }
  EXPECT_GT(refused, 20);
}

TEST_P(HostileFormats, AChangedByteNeverCrashes) {
  const auto good = writeGood();
  testing::internal::CaptureStderr();  // nobody but the caller says what is wrong
  Random random(12);
  for (int i = 0; i < GetParam().changes; ++i) {
    const auto file =
        std::next(good.begin(), static_cast<std::ptrdiff_t>(randomBelow(random, good.size())));
    std::string bytes = file->second;
    const auto at = static_cast<std::size_t>(randomBelow(random, bytes.size()));
    bytes[at] = static_cast<char>(randomBelow(random, 256));
    writeBytes(file->first, bytes);
    readOrRefuse(file->first + " with another byte at " + std::to_string(at));
    writeBytes(file->first, file->second);
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// OpenVDB asks for as much memory as a damaged block says, which is an exception, but for
// AddressSanitizer the end; and of some damaged headers HDF5 reads memory that it gave back.
#ifdef __SANITIZE_ADDRESS__
constexpr int kVdbChanges = 0, kHdf5Changes = 0;
#else
constexpr int kVdbChanges = 40, kHdf5Changes = 200;
#endif

INSTANTIATE_TEST_SUITE_P(All, HostileFormats,
                         testing::Values(HostileFormat{"a.nrrd", "a.nrrd", 400, 300},
                                         HostileFormat{"a.mhd", "a.mhd", 400, 300},
                                         HostileFormat{"a.mha", "a.mha", 400, 300},
                                         HostileFormat{"a.nii", "a.nii", 400, 300},
                                         HostileFormat{"a.nii.gz", "a.nii.gz", 400, 300},
                                         HostileFormat{"a.vti", "a.vti", 400, 300},
                                         HostileFormat{"a.vdb", "a.vdb", 400, kVdbChanges},
                                         HostileFormat{"a.h5", "a.h5", 200, kHdf5Changes},
                                         HostileFormat{"a.ome.zarr", "a.ome.zarr", 200, 300},
                                         HostileFormat{"a.tif", "a.tif", 200, 300},
                                         HostileFormat{"a/%d.tif", "a", 20, 100},
                                         HostileFormat{"a/%d.exr", "a", 30, 150}),
                         [](const auto& test) {
                           std::string name = test.param.output;
                           std::erase_if(name,
                                         [](unsigned char c) { return std::isalnum(c) == 0; });
                           return name;
                         });

}  // namespace
}  // namespace isobrick::test
