// Input that changes, or cannot be read for a while, while a pyramid is built from it: what was
// done is kept, and never are bricks of the old content and of the new in one file.
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <functional>

#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "tests/support/build_message.h"
#include "tests/support/file_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {
namespace {

class ChangedInputTest : public VolumeFilesTest {
 protected:
  void SetUp() override {
    VolumeFilesTest::SetUp();
    path_ = pathOf("a.isb");
    for (std::int64_t i = 0; i < elementCount(kDims); ++i)
      voxels_ += static_cast<char>(i * 31 % 97 + i / 1000 % 50);
    other_ = voxels_;
    std::reverse(other_.begin(), other_.end());
    restore();
    options_.brick_cells = 16;
    options_.memory_bytes = leastMemory();
    bricks_ = buildPyramid(*open(), path_, options_).bricks;
    reference_ = readBytes(path_);
    fs::remove(path_);
  }
  // As `cp -p` of a backup does.
  void restore() const {
    write("a.raw", voxels_);
    fs::last_write_time(pathOf("a.raw"), fs::file_time_type{});
  }
  void writeInPlace(const std::string& bytes) const {
    std::fstream(pathOf("a.raw"), std::ios::in | std::ios::out | std::ios::binary) << bytes;
  }
  std::unique_ptr<VolumeSource> open() const {
    return openRawSource(pathOf("a.raw"), {kDims, "u8"});
  }
  std::uint64_t leastMemory() const {
    const auto source = open();
    PyramidSpec spec;
    spec.voxels = kDims;
    spec.voxel_type = VoxelType::kUint8;
    spec.brick_cells = options_.brick_cells;
    spec.has_curvature = true;
    for (std::uint64_t bytes = std::uint64_t{1} << 20;; bytes += bytes / 32) try {
        makeBuildPlan(spec, BuildRegion(spec), source.get(), bytes, 2);
        return bytes;
      } catch (const Error&) {
      }
  }
  // Builds, and does something once so much is done; at 0.95 level 0 was read to its end.
  std::string messageOf(double done, const std::function<void()>& meddle) {
    BuildOptions options = options_;
    bool is_done = false;
    options.progress = [&](std::string_view, double fraction) {
      if (is_done || fraction < done) return;
      is_done = true;
      meddle();
    };
    const auto source = open();
    std::string message;
    tbb::task_arena(2).execute([&] { message = messageOfBuild(*source, path_, options); });
    EXPECT_TRUE(is_done);
    EXPECT_EQ(fs::exists(path_), message.empty());
    return message;
  }
  void expectKept(const std::string& message) const {
    EXPECT_CONTAINS(message, "of the bricks are kept in '" + path_ + ".partial'");
    EXPECT_CONTAINS(message, "<resume>");
    EXPECT_TRUE(fs::exists(path_ + ".partial"));
    EXPECT_TRUE(fs::exists(path_ + ".partial.journal"));
  }
  // Bricks that were taken over by a build that goes on and gives the reference's bytes.
  std::uint64_t resume() const {
    BuildOptions options = options_;
    options.resume = true;
    const BuildReport report = buildPyramid(*open(), path_, options);
    EXPECT_TRUE(readBytes(path_) == reference_);
    EXPECT_FALSE(fs::exists(path_ + ".partial"));
    return report.bricks_resumed;
  }
  std::string refusalToResume() const {
    const std::string partial = readBytes(path_ + ".partial");
    BuildOptions options = options_;
    options.resume = true;
    const std::string message = errorOf([&] { buildPyramid(*open(), path_, options); });
    EXPECT_TRUE(readBytes(path_ + ".partial") == partial);
    EXPECT_FALSE(fs::exists(path_));
    return message;
  }

  static constexpr Index3 kDims{90, 70, 180};
  std::string voxels_, other_, reference_, path_;
  BuildOptions options_;
  std::uint64_t bricks_ = 0;
};

TEST_F(ChangedInputTest, UnreadableAtPublishingItIsKept) {
  const std::string message = messageOf(0.95, [&] { fs::rename(pathOf("a.raw"), pathOf("away")); });
  expectKept(message);
  EXPECT_CONTAINS(message, "cannot open '" + pathOf("a.raw") + "'");
  fs::rename(pathOf("away"), pathOf("a.raw"));
  EXPECT_EQ(resume(), bricks_);
}

TEST_F(ChangedInputTest, ChangedAfterItWasReadItIsKeptForTheOldContentAlone) {
  const std::string message = messageOf(0.95, [&] { writeInPlace(other_); });
  expectKept(message);
  EXPECT_CONTAINS(message, "changed while it was read");
  EXPECT_CONTAINS(refusalToResume(), "input=1 files");
  restore();
  EXPECT_EQ(resume(), bricks_);
}

// The bricks that were read after the change, or during it, are those of another input.
TEST_F(ChangedInputTest, ChangedWhileItIsReadOnlyBricksOfTheOldContentAreKept) {
  const std::string message = messageOf(0.3, [&] { writeInPlace(other_); });
  expectKept(message);
  EXPECT_CONTAINS(message, "changed while it was read");
  EXPECT_CONTAINS(refusalToResume(), "input=1 files");
  restore();
  const std::uint64_t resumed = resume();
  EXPECT_GT(resumed, bricks_ / 5);
  EXPECT_LT(resumed, bricks_ / 2);
}

// Such a file looks damaged rather than changed.
TEST_F(ChangedInputTest, CutShortWhileItIsReadItIsKept) {
  const std::string message = messageOf(0.3, [&] { fs::resize_file(pathOf("a.raw"), 1000); });
  expectKept(message);
  EXPECT_NE(refusalToResume(), "");
  restore();
  EXPECT_GT(resume(), 0u);
}

TEST_F(ChangedInputTest, GoneWhileItIsReadItIsKept) {
  expectKept(messageOf(0.3, [&] { fs::rename(pathOf("a.raw"), pathOf("away")); }));
  fs::rename(pathOf("away"), pathOf("a.raw"));
  EXPECT_GT(resume(), 0u);
}

// A backup that makes links changes a time of the file, and nothing in it.
TEST_F(ChangedInputTest, ALinkMoreIsNoChange) {
  EXPECT_EQ(messageOf(0.3, [&] { fs::create_hard_link(pathOf("a.raw"), pathOf("link")); }), "");
  EXPECT_TRUE(readBytes(path_) == reference_);
}

// A build of another version of the tool goes on with what this one began.
TEST_F(ChangedInputTest, AnotherVersionOfTheToolGoesOn) {
  options_.tool_version = "1.2.3";
  messageOf(0.3, [&] { fs::rename(pathOf("a.raw"), pathOf("away")); });
  fs::rename(pathOf("away"), pathOf("a.raw"));
  options_.tool_version.clear();
  EXPECT_GT(resume(), 0u);
}

// Turns out to be damaged, and the user loses patience while the build looks whether its files have
// changed.
class DamagedSource : public VolumeSource {
 public:
  DamagedSource(std::unique_ptr<VolumeSource> source, CancelFlag& cancel)
      : source_(std::move(source)), cancel_(cancel) {}
  const VolumeInfo& info() const override { return source_->info(); }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    if (first > info().voxels.y * info().voxels.z / 2) {
      cancel_.request();  // the check of the input, to which the error leads, is interrupted
      throw Error("the voxels are damaged");
    }
    source_->readRows(first, count, out);
  }
  std::vector<std::string> files() const override { return source_->files(); }
  std::string identity() const override { return source_->identity(); }

 private:
  const std::unique_ptr<VolumeSource> source_;
  CancelFlag& cancel_;
};

TEST_F(ChangedInputTest, AnInterruptionWhileItIsCheckedIsNoChange) {
  CancelFlag cancel;
  DamagedSource source(open(), cancel);
  BuildOptions options = options_;
  options.cancel = &cancel;
  options.memory_bytes *= 2;  // what is read in order is held in a ring of slices
  const std::string message = messageOfBuild(source, path_, options);
  ASSERT_TRUE(cancel.requested()) << message;
  EXPECT_EQ(message.find("interrupted; "), 0u) << message;
  EXPECT_EQ(message.find("changed"), std::string::npos) << message;
  expectKept(message);
}

}  // namespace
}  // namespace isobrick::test
