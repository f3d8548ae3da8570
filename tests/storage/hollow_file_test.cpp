// Files with holes: any size, for nothing. Opening one costs no more than what is looked at.

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/child_process.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_edits.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_reader.h"
#include "tests/support/pyramid_verdict.h"
#include "tests/support/requirement.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// A file of `bytes` bytes, all zero but for the header and the level table of a volume of n^3
// voxels in bricks of four cells; `edit` changes the header.
void writeHollowFile(
    const std::string& path, std::int64_t n, std::uint64_t bytes,
    const std::function<void(format::Header&)>& edit = [](format::Header&) {}) {
  PyramidSpec spec;
  spec.voxels = Index3(n);
  spec.brick_cells = 4;
  spec.tile_cells = 2;
  const BrickLayout layout = spec.layout();
  std::vector<format::LevelRow> levels;
  std::uint64_t rows = 0;
  for (int level = 0; level < layout.lattice().levels(); ++level) {
    format::LevelRow row{};
    for (int axis = 0; axis < 3; ++axis) {
      row.samples[axis] = static_cast<std::uint64_t>(layout.lattice().samples(level)[axis]);
      row.bricks[axis] = static_cast<std::uint64_t>(layout.bricks(level)[axis]);
    }
    row.first_brick = rows;
    rows += static_cast<std::uint64_t>(elementCount(layout.bricks(level)));
    levels.push_back(row);
  }
  format::Header header{};
  std::memcpy(header.magic, format::kMagic, sizeof header.magic);
  header.version = format::kVersion;
  header.header_bytes = sizeof header;
  header.file_bytes = bytes;
  header.level_count = static_cast<std::uint32_t>(levels.size());
  header.brick_cells = 4;
  header.tile_cells = 2;
  for (int axis = 0; axis < 3; ++axis) {
    header.dims[axis] = static_cast<std::uint64_t>(n);
    header.spacing[axis] = 1;
    header.direction[4 * axis] = 1;
  }
  header.level_table_offset = sizeof header;
  const std::uint64_t level_bytes = levels.size() * sizeof(format::LevelRow);
  header.level_table_checksum = checksum64(levels.data(), level_bytes);
  header.brick_table_offset = 8192;
  header.brick_count = rows;
  header.kind_count = 2;
  header.kinds[1] = 1;
  header.provenance_checksum = checksum64(nullptr, 0);
  edit(header);
  ASSERT_LE(8192 + header.brick_count * format::rowBytes(header.kind_count), bytes);
  Bytes start(sizeof header + level_bytes);
  std::memcpy(start.data() + sizeof header, levels.data(), level_bytes);
  std::memcpy(start.data(), &header, sizeof header);
  sealHeader(start);
  writeBytes(path, start);
  std::filesystem::resize_file(path, bytes);
}

// Opening takes nothing of the table, and a row of zeros is none.
TEST(HollowFile, ATableOfATerabyteInAFileOfHolesCostsNothingAndIsRefusedRowByRow) {
  const DiskFolder folder;
  const std::string path = folder.file("hollow.isb");
  try {
    writeHollowFile(path, 8192, std::uint64_t{1} << 40);
  } catch (const std::filesystem::filesystem_error&) {
    SKIP_UNLESS_REQUIRED("no file of a terabyte with holes on this file system");
  }
  expectChildLeavesWith(0, [&] {
    rusage before = {}, after = {};
    getrusage(RUSAGE_SELF, &before);
    const Pyramid pyramid(path);
    const Index3 last = pyramid.layout().bricks(0) - Index3(1);
    for (const Index3& brick : {Index3(0), last / std::int64_t{2}, last}) {
      try {
        pyramid.brickRange(0, brick);
        return 3;
      } catch (const Error& error) {
        if (std::string(error.what()).find(brickName(0, brick)) == std::string::npos) return 4;
      }
    }
    getrusage(RUSAGE_SELF, &after);
    return after.ru_maxrss - before.ru_maxrss < 16 * 1024 ? 0 : 5;
  });
}

// An index of super-bricks whose table of files has 3.7 GB of zeros: the first entry is none.
TEST(HollowFile, ATableOfManyFilesIsRefusedByItsFirstEntry) {
  const DiskFolder folder;
  const std::string path = folder.file("index.isb");
  constexpr std::uint64_t kAlong = 405, kFiles = kAlong * kAlong * kAlong;
  constexpr std::uint64_t kTableBytes =
      kFiles * (sizeof(format::FileEntry) + sizeof(format::Range));
  try {
    writeHollowFile(path, 4 * kAlong + 1, 8192 + 2 * kTableBytes, [&](format::Header& header) {
      header.brick_count = 0;
      header.super_cells = 4;
      header.super_levels = 1;
      header.division = {8192, 0, static_cast<std::uint32_t>(kTableBytes), 0};
    });
  } catch (const std::filesystem::filesystem_error&) {
    SKIP_UNLESS_REQUIRED("no file of 9 GB with holes on this file system");
  }
  expectChildLeavesWith(0, [&] {
    rusage before = {}, after = {};
    getrusage(RUSAGE_SELF, &before);
    const std::string refusal = judge(path).open_error;
    getrusage(RUSAGE_SELF, &after);
    if (refusal.find("has a damaged table of files") == std::string::npos) return 3;
    return after.ru_maxrss - before.ru_maxrss < 16 * 1024 ? 0 : 4;
  });
}

TEST(HollowFile, AProvenanceOfAGigabyteIsRefused) {
  const DiskFolder folder;
  Bytes bytes = readWholeFile(buildTinyFile(folder));
  const std::string path = folder.file("long.isb");
  constexpr std::uint64_t kLong = std::uint64_t{1} << 30;
  putU64(bytes, kFileBytesAt, bytes.size() + kLong);
  putU64(bytes, 248, bytes.size());
  putU64(bytes, 256, kLong);
  sealHeader(bytes);
  writeBytes(path, bytes);
  std::filesystem::resize_file(path, bytes.size() + kLong);
  EXPECT_NE(judge(path).open_error.find("provenance of 1073741824 bytes"), std::string::npos);
}

}  // namespace
}  // namespace isobrick::test
