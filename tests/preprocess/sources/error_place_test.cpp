// An Error tells a program its place and its remedies.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

template <typename F>
Error errorThrownBy(F&& action) {
  try {
    action();
  } catch (const Error& error) {
    return error;
  }
  ADD_FAILURE() << "no Error was thrown";
  return Error("");
}

bool helps(const Error& error, Remedy remedy) {
  const std::vector<Remedy>& all = error.remedies();
  return std::find(all.begin(), all.end(), remedy) != all.end();
}

TEST(ErrorPlaceTest, ADamagedBrickIsNamedWithItsOffset) {
  const TemporaryFolder folder;
  const std::string path = folder.file("head.isb");
  PhantomSpec head;
  head.name = "head";
  head.size = 40;
  BuildOptions options;
  options.brick_cells = 16;
  options.codec = format::Codec::kStored;
  buildPyramid(*makePhantomSource(head), path, options);

  // The last sample of a brick in the middle, found by its bytes: stored parts lie as they are.
  const Index3 brick(1, 1, 1);
  std::string part;
  {
    const Pyramid pyramid(path);
    const BrickSamples samples = pyramid.samples(0, brick);
    part.assign(
        reinterpret_cast<const char*>(samples.part.data()),
        static_cast<std::size_t>(samples.box.size()) * voxelBytes(pyramid.spec().voxel_type));
  }
  std::string bytes = readBytes(path);
  const std::size_t offset = bytes.find(part);
  ASSERT_NE(offset, std::string::npos);
  bytes[offset + part.size() - 1] ^= 1;
  writeBytes(path, bytes);

  const Pyramid pyramid(path);
  const Error error = errorThrownBy([&] { (void)pyramid.samples(0, brick); });
  EXPECT_EQ(error.place().path, path);
  EXPECT_EQ(error.place().offset, offset);
  EXPECT_EQ(error.place().level, 0);
  EXPECT_EQ(error.place().brick, brick);
}

TEST(ErrorPlaceTest, AFileThatIsNoPyramidIsNamed) {
  const TemporaryFolder folder;
  const std::string path = folder.file("no.isb");
  writeBytes(path, std::string(1000, 'x'));
  const Error error = errorThrownBy([&] { const Pyramid pyramid(path); });
  EXPECT_EQ(error.place().path, path);
  EXPECT_FALSE(error.place().level.has_value());
}

TEST(ErrorPlaceTest, RemediesAreParametersOfTheCall) {
  const TemporaryFolder folder;
  const std::string path = folder.file("scan.raw");
  writeBytes(path, std::string(1000, 'x'));
  const Error headerless = errorThrownBy([&] { (void)openVolume(path); });
  EXPECT_TRUE(helps(headerless, Remedy::kDescribeRawFile)) << headerless.what();
  EXPECT_EQ(headerless.place().path, path);

  OpenOptions options;
  options.raw = RawLayout{Index3(10, 10, 11), "u8"};
  const Error too_short = errorThrownBy([&] { (void)openVolume(path, options); });
  EXPECT_TRUE(helps(too_short, Remedy::kCorrectRawLayout)) << too_short.what();

  options.raw->voxels = Index3(10, 10, 10);
  const auto source = openVolume(path, options);
  BuildOptions build;
  build.memory_bytes = 1;
  const Error memory =
      errorThrownBy([&] { buildPyramid(*source, folder.file("scan.isb"), build); });
  EXPECT_TRUE(helps(memory, Remedy::kAllowMoreMemory)) << memory.what();
  // The library does not know what the options of a command are called.
  for (const Error& error : {headerless, too_short, memory})
    EXPECT_EQ(std::strstr(error.what(), "--"), nullptr) << error.what();
}

TEST(OpenVolumeTest, PyramidsAndPipesAreRefusedBeforeAnythingIsOpened) {
  const TemporaryFolder folder;
  const std::string path = folder.file("head.isb");
  writeBytes(path, "ISOBRICK");
  EXPECT_NE(std::strstr(errorThrownBy([&] { (void)openVolume(path); }).what(), "pyramid already"),
            nullptr);
  EXPECT_NE(std::strstr(errorThrownBy([] { (void)openVolume("/dev/zero"); }).what(),
                        "neither a file nor a folder"),
            nullptr);
  EXPECT_EQ(errorThrownBy([] { (void)openVolume("/nowhere/at/all.nrrd"); }).place().path,
            "/nowhere/at/all.nrrd");
}

}  // namespace
}  // namespace isobrick::test
