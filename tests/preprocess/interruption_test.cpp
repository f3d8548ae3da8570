// How much is still done after a request to stop. Nothing here measures time: a request comes at a
// known piece of work, and what follows is counted.
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/atomic_file.h"
#include "tests/support/file_bytes.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/vdb_file.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;

class InterruptionTest : public VolumeFilesTest {
 protected:
  CancelFlag cancel_;
};

// Asks to stop in the middle of call `stop_at`, and counts the calls.
class StoppingSource final : public VolumeSource {
 public:
  StoppingSource(const Index3& voxels, bool reads_boxes, int stop_at, CancelFlag& cancel)
      : reads_boxes_(reads_boxes), stop_at_(stop_at), cancel_(cancel) {
    info_.voxels = voxels;
    info_.voxel_type = VoxelType::kUint16;
    info_.source = "memory";
    info_.format = "test";
  }
  const VolumeInfo& info() const override { return info_; }
  void readRows(std::int64_t, std::int64_t count, void* out) override {
    fill(count * info_.voxels.x, out);
  }
  bool readsBoxes() const override { return reads_boxes_; }
  std::string identity() const override { return "zeros"; }
  void readBox(const IndexBox& box, void* out) const override { fill(box.size(), out); }

  int calls() const { return calls_; }
  std::int64_t mostBytes() const { return most_bytes_; }

 private:
  void fill(std::int64_t voxels, void* out) const {
    if (++calls_ == stop_at_) cancel_.request();
    most_bytes_ = std::max<std::int64_t>(most_bytes_, 2 * voxels);
    std::memset(out, 0, static_cast<std::size_t>(2 * voxels));
  }

  VolumeInfo info_;
  bool reads_boxes_;
  int stop_at_;
  CancelFlag& cancel_;
  mutable std::atomic<int> calls_{0};
  mutable std::atomic<std::int64_t> most_bytes_{0};
};

TEST_F(InterruptionTest, ABuildReadsNoFurtherByBoxes) {
  StoppingSource source(Index3(512, 512, 80), true, 2, cancel_);
  BuildOptions options;
  options.cancel = &cancel_;
  EXPECT_THROW(buildPyramid(source, pathOf("a.isb"), options), Cancelled);
  EXPECT_EQ(source.calls(), 2);
  EXPECT_LE(source.mostBytes(), 4 << 20);
  EXPECT_EQ(filesLeft(), 0u);
}

TEST_F(InterruptionTest, ABuildReadsNoFurtherByRows) {
  StoppingSource source(Index3(512, 512, 80), false, 3, cancel_);
  BuildOptions options;
  options.cancel = &cancel_;
  EXPECT_THROW(buildPyramid(source, pathOf("a.isb"), options), Cancelled);
  EXPECT_EQ(source.calls(), 3);
  EXPECT_EQ(filesLeft(), 0u);
}

TEST_F(InterruptionTest, AWrittenVolumeStopsWithinASlab) {
  StoppingSource source(Index3(512, 512, 80), false, 3, cancel_);
  VolumeWriteOptions options;
  options.cancel = &cancel_;
  EXPECT_THROW(writeVolume(source, pathOf("a.raw"), options), Cancelled);
  EXPECT_EQ(source.calls(), 3);
  EXPECT_LE(source.mostBytes(), 1 << 20);
  EXPECT_EQ(filesLeft(), 0u);
}

TEST_F(InterruptionTest, AFileIsNotPublishedAfterARequest) {
  write("file", "old");
  {
    AtomicFile file(pathOf("file"));
    file.write("new", 3);
    file.commit(&cancel_);
  }
  EXPECT_EQ(readBytes(pathOf("file")), "new");
  cancel_.request();
  {
    AtomicFile file(pathOf("file"));
    const std::string bytes(10 << 20, 'x');
    EXPECT_THROW(file.reserve(1000, &cancel_), Cancelled);
    file.write(bytes.data(), bytes.size());
    EXPECT_THROW(file.commit(&cancel_), Cancelled);
  }
  EXPECT_EQ(readBytes(pathOf("file")), "new");
  EXPECT_EQ(filesLeft(), 1u);
}

TEST_F(InterruptionTest, AMeshIsNotPublishedAfterARequest) {
  for (const char* name : {"mesh.ply", "mesh.stl", "mesh.obj", "mesh.glb", "mesh.vtp"}) {
    CancelFlag cancel;
    const auto sink = makeMeshFileSink(pathOf(name), {.cancel = &cancel});
    sink->begin({});
    MeshBatch batch;
    batch.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    batch.normals.resize(3, {0, 0, 1});
    batch.triangles = {0, 1, 2};
    sink->accept(batch);
    cancel.request();
    EXPECT_THROW(sink->finish(), Cancelled);
    EXPECT_FALSE(fs::exists(pathOf(name)));
  }
  EXPECT_EQ(filesLeft(), 0u);
}

TEST_F(InterruptionTest, SkippedRowsOfAStreamAreNotInflated) {
  const std::string header =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 64 64 64\nencoding: gzip\n\n";
  // Damaged in the middle: who inflates as far as that gets an Error instead.
  std::string packed = deflated(std::string(1 << 18, 'v'), true);
  packed[packed.size() / 2] = static_cast<char>(packed[packed.size() / 2] ^ 0x55);
  OpenOptions options;
  options.cancel = &cancel_;
  const auto source = openVolume(write("a.nrrd", header + packed), options);
  cancel_.request();
  std::vector<std::uint8_t> row(64);
  EXPECT_THROW(source->readRows(64 * 64 - 1, 1, row.data()), Cancelled);
}

TEST_F(InterruptionTest, AWholeImageIsNotBegunAfterARequest) {
  const std::string path =
      write("a.nrrd",
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: ascii\n\n"
            "1 2 3 4 5 6 7 8\n");
  OpenOptions options;
  options.cancel = &cancel_;
  std::vector<std::uint8_t> voxels(8);
  {
    const auto source = openVolume(path, options);
    source->readRows(0, 4, voxels.data());
    EXPECT_EQ(voxels[7], 8);
  }
  const auto source = openVolume(path, options);
  cancel_.request();
  EXPECT_THROW(source->readRows(0, 4, voxels.data()), Cancelled);
}

TEST_F(InterruptionTest, LoadingAGridStops) {
  const std::string path = pathOf("fog.vdb");
  const Index3 voxels(96, 96, 96);
  std::vector<float> values(static_cast<std::size_t>(elementCount(voxels)));
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<float>(i * 2654435761u % 1000003u) + 1.0f;
  writeVdbFog(path, voxels, values);
  OpenOptions options;
  options.cancel = &cancel_;
  int calls = 0;
  options.progress = [&](std::string_view phase, double) {
    EXPECT_EQ(phase, "loading grid");
    if (++calls == 3) cancel_.request();
  };
  EXPECT_THROW(openVdbSource(path, options), Cancelled);
  EXPECT_EQ(calls, 3);
}

// ---- calls that cannot be interrupted -----------------------------------------------------------

TEST(AbandonableTest, GivesResultsAndFailuresBack) {
  CancelFlag cancel;
  for (const CancelFlag* flag :
       {static_cast<const CancelFlag*>(&cancel), static_cast<const CancelFlag*>(nullptr)}) {
    EXPECT_EQ(runAbandonable(flag, [] { return std::string("done"); }), "done");
    EXPECT_THROW(runAbandonable(flag, []() -> int { throw Error("failed"); }), Error);
    EXPECT_EQ(*runAbandonable(flag, [] { return std::make_unique<int>(7); }), 7);
  }
  cancel.request();
  bool began = false;
  EXPECT_THROW(runAbandonable(&cancel, [&] { return began = true; }), Cancelled);
  EXPECT_FALSE(began);
}

TEST(AbandonableTest, DoesNotWaitForTheWork) {
  CancelFlag cancel;
  const auto may_end = std::make_shared<std::promise<void>>();
  const auto owned = std::make_shared<int>(1);
  auto ended = std::make_shared<std::promise<long>>();
  std::future<long> uses_at_end = ended->get_future();
  // The work asks to stop and then waits for what comes after the call: it would never return.
  EXPECT_THROW(runAbandonable(&cancel,
                              [&cancel, may_end, owned, ended] {
                                cancel.request();
                                may_end->get_future().wait();
                                ended->set_value(owned.use_count());
                                return *owned;
                              }),
               Cancelled);
  may_end->set_value();
  EXPECT_EQ(uses_at_end.get(), 2);  // here and in the work
}

}  // namespace
}  // namespace isobrick
