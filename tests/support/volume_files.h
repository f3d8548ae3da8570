// Files of volumes for the tests of sources: a folder to write them to, reading them, what they say
// when they are refused.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/remedy_text.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {

namespace fs = std::filesystem;

class VolumeFilesTest : public testing::Test {
 protected:
  std::string pathOf(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& bytes) const {
    fs::remove(pathOf(name));  // writing over a file may wait for the disk
    writeBytes(pathOf(name), bytes);
    return pathOf(name);
  }
  std::size_t filesLeft() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.path();
};

template <typename T>
std::string bytesOfValues(const std::vector<T>& values, bool big_endian = false) {
  std::string bytes(values.size() * sizeof(T), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  if (big_endian)
    for (std::size_t i = 0; i < bytes.size(); i += sizeof(T))
      std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(i),
                   bytes.begin() + static_cast<std::ptrdiff_t>(i + sizeof(T)));
  return bytes;
}

// Reads all voxels, `slab` slices at a time, by rows.
template <typename T>
std::vector<T> readVoxels(VolumeSource& source, std::int64_t slab = 3) {
  const Index3 voxels = source.info().voxels;
  EXPECT_EQ(voxelBytes(source.info().voxel_type), sizeof(T));
  std::vector<T> result(static_cast<std::size_t>(elementCount(voxels)));
  for (std::int64_t first = 0; first < voxels.z; first += slab)
    source.readRows(first * voxels.y, std::min(slab, voxels.z - first) * voxels.y,
                    result.data() + first * voxels.x * voxels.y);
  return result;
}

// The message of the Error that `action` throws: one line, or a failed test.
template <typename F>
std::string errorOf(F&& action) {
  try {
    action();
  } catch (const Error& error) {
    const std::string message = textWithRemedies(error);
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    return message;
  }
  ADD_FAILURE() << "no Error was thrown";
  return "";
}

#define EXPECT_CONTAINS(text, part) EXPECT_NE((text).find(part), std::string::npos) << (text)

// Reads everything, as some damage is found only then.
inline void readAll(VolumeSource& source) {
  const VolumeInfo& info = source.info();
  std::vector<std::byte> slice(static_cast<std::size_t>(info.voxels.x * info.voxels.y) *
                               voxelBytes(info.voxel_type));
  for (std::int64_t k = 0; k < info.voxels.z; ++k)
    source.readRows(k * info.voxels.y, info.voxels.y, slice.data());
}
inline void openAndRead(const std::string& path) { readAll(*openVolume(path)); }

}  // namespace isobrick::test
