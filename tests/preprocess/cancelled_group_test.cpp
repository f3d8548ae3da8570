// Builds and conversions inside a TBB task whose group is cancelled make what they make elsewhere:
// only their own flag cancels them.
#include "tests/support/cancelled_group.h"

#include <gtest/gtest.h>

#include <memory>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr std::uint64_t kPagerBytes = 1 << 20;

std::vector<float> voxelsOf(VolumeSource& source) {
  const VolumeInfo& info = source.info();
  std::vector<std::byte> bytes(static_cast<std::size_t>(elementCount(info.voxels)) *
                               voxelBytes(info.voxel_type));
  source.readRows(0, info.voxels.y * info.voxels.z, bytes.data());
  std::vector<float> values;
  visitVoxelType(info.voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const T* const voxels = reinterpret_cast<const T*>(bytes.data());
    values.assign(voxels, voxels + bytes.size() / sizeof(T));
  });
  return values;
}

class InACancelledGroup : public testing::Test {
 protected:
  void build(const std::string& name) const {
    BuildOptions options;
    options.brick_cells = 16;
    buildPyramid(*makePhantomSource(PhantomSpec{"head", 70, {}, 16}), folder_.file(name), options);
  }
  std::shared_ptr<const Pyramid> pyramid() const {
    return std::make_shared<const Pyramid>(folder_.file("whole.isb"));
  }

  const TemporaryFolder folder_;
};

TEST_F(InACancelledGroup, ABuildIsWhole) {
  build("whole.isb");
  runInCancelledGroup([&] { build("inside.isb"); });
  EXPECT_EQ(readBytes(folder_.file("inside.isb")), readBytes(folder_.file("whole.isb")));
}

TEST_F(InACancelledGroup, VolumesOfAPyramidAreWhole) {
  build("whole.isb");
  const auto samples = [&] { return makePyramidSource(pyramid(), kPagerBytes, 0); };
  const std::vector<float> expected = voxelsOf(*samples());
  runInCancelledGroup([&] { EXPECT_TRUE(voxelsOf(*samples()) == expected); });
}

TEST_F(InACancelledGroup, ConvertedVolumesAreWholeAndReadWhole) {
  build("whole.isb");
  const std::vector<float> expected = voxelsOf(*makePyramidSource(pyramid(), kPagerBytes, 0));
  for (const char* name : {"a.vdb", "a.ome.zarr", "a.nii.gz", "a.h5"}) {
    const std::string path = folder_.file(name);
    const auto write = [&] {
      VolumeLevels levels;
      levels.push_back(makePyramidSource(pyramid(), kPagerBytes, 0));
      ExportOptions options;
      options.memory_bytes = std::uint64_t{256} << 20;
      exportVolume(levels, path, options);
    };
    runInCancelledGroup(write);
    EXPECT_TRUE(voxelsOf(*openVolume(path)) == expected) << name;
    runInCancelledGroup(
        [&] { EXPECT_TRUE(voxelsOf(*openVolume(path)) == expected) << name << ", read"; });
  }
}

}  // namespace
}  // namespace isobrick::test
