// Builds that fail leave an Error that names the file, the older file untouched, and nothing that
// opens.

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tests/support/build_message.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/plain_reader.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

TEST(FailedBuild, WriterWithoutFinishLeavesNoFile) {
  const DiskFolder folder;
  PyramidSpec spec;
  spec.voxels = Index3(5);
  spec.brick_cells = 4;
  {
    PyramidWriter writer(folder.file("never.isb"), spec, "a test", false, nullptr);
    EncodedBrick brick;
    brick.samples.bytes.assign(125, std::byte{1});
    brick.ranges.bytes.assign(2, std::byte{1});
    encodeBrick(VoxelType::kUint8, format::Codec::kStored, brick);
    writer.write(brick);
    writer.flush();
    EXPECT_EQ(folder.names(),
              (std::vector<std::string>{"never.isb.partial", "never.isb.partial.journal"}));
    EXPECT_THROW(Pyramid(folder.file("never.isb.partial")), Error);
  }
  EXPECT_TRUE(folder.names().empty());
}

TEST(FailedBuild, LeavesTheOlderFileUntouched) {
  const DiskFolder folder;
  const std::string path = buildGoodFile(folder);
  const std::vector<std::uint8_t> before = readWholeFile(path);
  NoiseSource source(Index3(19, 9, 40), VoxelType::kUint16);
  source.fail_at_row = 33 * 9;
  EXPECT_THROW(buildPyramid(source, path, smallBricks()), Error);
  EXPECT_TRUE(readWholeFile(path) == before);
  EXPECT_EQ(folder.names(), (std::vector<std::string>{"good.isb"}));

  for (const double stop_at : {0.0, 0.2, 0.5, 0.8}) {
    NoiseSource again(Index3(40, 30, 20), VoxelType::kUint16);
    BuildOptions options = smallBricks();
    CancelFlag cancel;
    options.cancel = &cancel;
    options.progress = [&](std::string_view, double fraction) {
      if (fraction >= stop_at) cancel.request();
    };
    EXPECT_THROW(buildPyramid(again, path, options), Cancelled) << stop_at;
    EXPECT_TRUE(readWholeFile(path) == before) << "stopped at " << stop_at;
    // The files that are left for --resume are no pyramids.
    for (const std::string& name : folder.names())
      if (name != "good.isb") {
        EXPECT_TRUE(name.starts_with("good.isb.partial")) << name;
        EXPECT_THROW(Pyramid(folder.file(name)), Error) << name;
      }
  }
}

TEST(FailedBuild, FoldersThatAreMissingAreNamed) {
  const DiskFolder folder;
  NoiseSource source(Index3(5), VoxelType::kUint8);
  const std::string path = folder.file("missing/out.isb");
  const std::string message = messageOfBuild(source, path, smallBricks());
  ASSERT_NE(message, "") << "no error";
  EXPECT_NE(message.find(path), std::string::npos) << message;
}

// A limit on the size of files fails at every point of the file in turn: bricks, tables.
TEST(FailedBuild, FileSizeLimitGivesOneErrorAndLeavesNothing) {
  const DiskFolder folder;
  NoiseSource source(Index3(40, 33, 30), VoxelType::kUint16);
  const std::string whole = folder.file("whole.isb");
  const std::uint64_t size = buildPyramid(source, whole, smallBricks()).file_bytes;
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const std::uint64_t limit :
       {std::uint64_t{0}, std::uint64_t{100}, std::uint64_t{512}, std::uint64_t{5000}, size / 2,
        size - 20000, size - 5000, size - 1}) {
    rlimit lower = before;
    lower.rlim_cur = limit;
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &lower), 0);
    NoiseSource again(Index3(40, 33, 30), VoxelType::kUint16);
    const std::string message = messageOfBuild(again, folder.file("limited.isb"), smallBricks());
    setrlimit(RLIMIT_FSIZE, &before);  // before anything is printed
    EXPECT_NE(message.find("limited.isb"), std::string::npos) << limit << ": '" << message << "'";
    EXPECT_NE(message.find("limit"), std::string::npos) << limit << ": '" << message << "'";
    EXPECT_EQ(folder.names(), (std::vector<std::string>{"whole.isb"})) << limit;
  }
  std::signal(SIGXFSZ, old_handler);
}

}  // namespace
}  // namespace isobrick::test
