// The build in bounded memory: the same bytes however it is cut up, interrupted and continued.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <cstring>
#include <filesystem>

#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/storage/write_journal.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

namespace fs = std::filesystem;

// The same voxels, read box by box.
template <typename T>
class BoxwiseSource final : public VolumeSource {
 public:
  BoxwiseSource(const Index3& voxels, const std::vector<T>& values) : values_(values) {
    info_.voxels = voxels;
    info_.voxel_type = voxelTypeOf<T>();
    info_.source = "memory";
    info_.format = "test";
  }
  const VolumeInfo& info() const override { return info_; }
  std::string identity() const override { return info_.source; }
  void readRows(std::int64_t, std::int64_t, void*) override { ADD_FAILURE() << "rows were asked"; }
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    T* to = static_cast<T*>(out);
    for (std::int64_t z = box.first.z; z < box.end().z; ++z)
      for (std::int64_t y = box.first.y; y < box.end().y; ++y, to += box.count.x)
        std::copy_n(values_.data() + linearIndex({box.first.x, y, z}, info_.voxels), box.count.x,
                    to);
  }

 private:
  VolumeInfo info_;
  const std::vector<T>& values_;
};

// Fails as a disk does after so many rows.
template <typename T>
class FailingSource final : public ArraySource<T> {
 public:
  FailingSource(const Index3& voxels, const std::vector<T>& values, std::int64_t good_rows)
      : ArraySource<T>(voxels, values), good_rows_(good_rows) {}

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    if (first + count > good_rows_) throw ResumableError("the disk failed");
    const std::int64_t row = this->info().voxels.x;
    std::copy_n(this->values().data() + first * row, count * row, static_cast<T*>(out));
  }

  std::int64_t good_rows_;
};

// Smooth with noise here and there, and an even corner: all codecs and constants occur.
template <typename T>
std::vector<T> testVolume(const Index3& dims, std::uint64_t seed) {
  Random random(seed);
  return arrayOfField<T>(dims, [&](const Index3& p) -> double {
    if (p.x > dims.x / 2 && p.z > dims.z / 3) return 7;
    const double wave = 60 + 40 * std::sin(0.3 * static_cast<double>(p.x)) *
                                 std::cos(0.2 * static_cast<double>(p.y + p.z));
    return wave + (p.y % 16 == 0 ? randomReal(random, 0, 20) : 0.0);
  });
}

BuildOptions smallBricks() {
  BuildOptions options;
  options.brick_cells = 16;
  options.tile_cells = 4;
  options.tool_version = "test";
  return options;
}

std::uint64_t leastMemory(VolumeSource& source, const BuildOptions& options) {
  PyramidSpec spec;
  spec.voxels = source.info().voxels;
  spec.voxel_type = source.info().voxel_type;
  spec.brick_cells = options.brick_cells;
  spec.tile_cells = options.tile_cells;
  spec.has_curvature = options.with_curvature;
  for (std::uint64_t bytes = std::uint64_t{1} << 20;; bytes += bytes / 32) {
    try {
      makeBuildPlan(spec, BuildRegion(spec), &source, bytes,
                    tbb::this_task_arena::max_concurrency());
      return bytes;
    } catch (const Error&) {
    }
  }
}

template <typename T>
std::string build(const Index3& dims, const std::vector<T>& values, const std::string& path,
                  const BuildOptions& options, bool boxes) {
  if (boxes) {
    BoxwiseSource<T> source(dims, values);
    buildPyramid(source, path, options);
  } else {
    ArraySource<T> source(dims, values);
    buildPyramid(source, path, options);
  }
  return readBytes(path);
}

template <typename T>
class StreamingBuild : public testing::Test {};
using VoxelTypes = testing::Types<std::uint8_t, std::int8_t, std::uint16_t, std::int16_t, float>;
TYPED_TEST_SUITE(StreamingBuild, VoxelTypes);

TYPED_TEST(StreamingBuild, SameBytesForAnyMemoryThreadsAndWayOfReading) {
  using T = TypeParam;
  const TemporaryFolder folder;
  constexpr std::int64_t kTiles[] = {4, 2, 16};
  for (const Index3 dims : {Index3(150, 70, 83), Index3(17, 130, 40), Index3(300, 20, 3)}) {
    const std::vector<T> values = testVolume<T>(dims, 1);
    for (const std::int64_t tile : someOf(kTiles)) {
      BuildOptions options = smallBricks();
      options.tile_cells = tile;
      const std::string reference =
          build(dims, values, folder.file("reference.isb"), options, false);
      ArraySource<T> probe(dims, values);
      const std::uint64_t least = leastMemory(probe, options);
      for (const bool boxes : {false, true})
        for (const std::uint64_t memory : {least, least + (1 << 19), least + (1 << 21)}) {
          options.memory_bytes = memory;
          EXPECT_TRUE(build(dims, values, folder.file("a.isb"), options, boxes) == reference)
              << dims.x << " tile " << tile << " boxes " << boxes << " memory " << memory;
        }
      options.memory_bytes = std::uint64_t{1} << 30;
      for (const int threads : {1, 4}) {
        tbb::task_arena arena(threads);
        const std::string bytes =
            arena.execute([&] { return build(dims, values, folder.file("a.isb"), options, true); });
        EXPECT_TRUE(bytes == reference) << threads << " threads";
      }
    }
  }
}

TEST(StreamingBuildPlan, TheLeastMemoryPutsStoresAndSlicesInFiles) {
  const Index3 dims(150, 70, 83);
  ArraySource<std::uint16_t> source(dims, std::vector<std::uint16_t>(1));
  PyramidSpec spec;
  spec.voxels = dims;
  spec.voxel_type = VoxelType::kUint16;
  spec.brick_cells = 16;
  // It depends on the threads: those of the plan, whatever the machine has.
  const std::uint64_t least =
      tbb::task_arena(2).execute([&] { return leastMemory(source, smallBricks()); });
  const BuildPlan tight = makeBuildPlan(spec, BuildRegion(spec), &source, least, 2);
  EXPECT_EQ(tight.spool_place, ScratchVolume::Place::kFile);
  EXPECT_EQ(tight.stores[1], ScratchVolume::Place::kFile);
  EXPECT_EQ(tight.windows[0].y, 1);
  const BuildPlan wide = makeBuildPlan(spec, BuildRegion(spec), &source, std::uint64_t{1} << 30, 2);
  EXPECT_EQ(wide.spool_place, ScratchVolume::Place::kMemory);
  EXPECT_EQ(wide.stores[1], ScratchVolume::Place::kMemory);
  EXPECT_EQ(wide.windows[0].x, 10);
  EXPECT_EQ(wide.windows[0].y, 5);
}

TEST(StreamingBuildPlan, TooLittleMemoryIsRefusedWithWhatIsNeeded) {
  const TemporaryFolder folder;
  const Index3 dims(64, 64, 64);
  BuildOptions options = smallBricks();
  options.memory_bytes = 1000;
  ArraySource<std::uint8_t> source(dims, testVolume<std::uint8_t>(dims, 1));
  const std::string message = messageOfBuild(source, folder.file("a.isb"), options);
  EXPECT_NE(message.find("too small"), std::string::npos) << message;
  EXPECT_NE(message.find("<more memory>"), std::string::npos) << message;
  EXPECT_TRUE(fs::is_empty(folder.path()));
  // The memory that it asks for is enough.
  const std::size_t number = message.rfind("allow ") + 6;
  options.memory_bytes = std::stoull(message.substr(number)) << 20;
  EXPECT_EQ(messageOfBuild(source, folder.file("a.isb"), options), "");
}

// Interrupts after every window, wherever the reading of the cancel flag finds it.
TEST(Resume, AnyInterruptionGivesTheSameBytes) {
  const TemporaryFolder folder;
  const Index3 dims(90, 70, 60);
  const auto values = testVolume<std::uint16_t>(dims, 3);
  for (const format::Codec codec :
       {format::Codec::kStored, format::Codec::kLz4, format::Codec::kZstd}) {
    BuildOptions options = smallBricks();
    options.codec = codec;
    const std::string reference = build(dims, values, folder.file("reference.isb"), options, false);
    ArraySource<std::uint16_t> probe(dims, values);
    const std::uint64_t least = leastMemory(probe, options);
    int interruptions = 0, kept = 0;
    // Packing changes where bytes lie, not how a build goes on.
    const int step = codec == format::Codec::kLz4 ? 51 / std::clamp(repetitions(17), 3, 51) : 17;
    for (int after = 0;; after += step) {
      CancelFlag cancel;
      int calls = 0;
      BuildOptions broken = options;
      broken.cancel = &cancel;
      broken.memory_bytes = least;  // small windows
      broken.progress = [&](std::string_view, double) {
        if (calls++ == after) cancel.request();
      };
      ArraySource<std::uint16_t> source(dims, values);
      const std::string path = folder.file("a.isb");
      bool cancelled = false;
      try {
        buildPyramid(source, path, broken);
      } catch (const Cancelled& stop) {
        cancelled = true;
        const bool is_kept = fs::exists(path + ".partial");
        EXPECT_EQ(textWithRemedies(stop).find("<resume>") != std::string::npos, is_kept);
        EXPECT_EQ(fs::exists(path + ".partial.journal"), is_kept);
        EXPECT_FALSE(fs::exists(path));
        kept += is_kept;
      }
      if (cancelled) ++interruptions;
      BuildOptions again = options;
      again.resume = true;
      // Another memory cuts other windows; other ways of reading do not matter either.
      if (after % 2 == 0) again.memory_bytes = least;
      EXPECT_TRUE(build(dims, values, path, again, after % 3 == 0) == reference)
          << "interrupted after " << after;
      EXPECT_FALSE(fs::exists(path + ".partial"));
      EXPECT_FALSE(fs::exists(path + ".partial.journal"));
      fs::remove(path);
      if (!cancelled) break;
    }
    EXPECT_GT(interruptions, 5);
    EXPECT_GT(kept, 4);
  }
}

// Leaves a partial of a build that failed late, and returns the finished file.
class ResumeDamaged : public testing::Test {
 protected:
  void SetUp() override {
    values_ = testVolume<std::uint8_t>(dims_, 5);
    options_ = smallBricks();
    reference_ = build(dims_, values_, folder_.file("reference.isb"), options_, false);
    FailingSource<std::uint8_t> source(dims_, values_, dims_.y * 55);
    ArraySource<std::uint8_t> probe(dims_, values_);
    BuildOptions options = options_;
    options.memory_bytes = leastMemory(probe, options_);
    const std::string message = messageOfBuild(source, path_, options);
    EXPECT_NE(message.find("the disk failed; "), std::string::npos) << message;
    EXPECT_NE(message.find("<resume>"), std::string::npos) << message;
    partial_ = readBytes(path_ + ".partial");
    journal_ = readBytes(path_ + ".partial.journal");
    ASSERT_GT(WriteJournal::read(path_ + ".partial.journal")->entries.size(), 20u);
  }
  // A resumed build says that the journal is damaged, and leaves all as it was.
  void expectRefusal() {
    const std::string partial = readBytes(path_ + ".partial");
    ArraySource<std::uint8_t> source(dims_, values_);
    BuildOptions options = options_;
    options.resume = true;
    const std::string message = messageOfBuild(source, path_, options);
    EXPECT_NE(message.find("'" + path_ + ".partial.journal' is missing or damaged"),
              std::string::npos)
        << message;
    EXPECT_NE(message.find("<begin anew>"), std::string::npos) << message;
    EXPECT_TRUE(readBytes(path_ + ".partial") == partial);
  }
  // True if a resumed build gives the reference's bytes.
  bool resumes(std::uint64_t* resumed = nullptr) {
    ArraySource<std::uint8_t> source(dims_, values_);
    BuildOptions options = options_;
    options.resume = true;
    const BuildReport report = buildPyramid(source, path_, options);
    if (resumed != nullptr) *resumed = report.bricks_resumed;
    const bool same = readBytes(path_) == reference_;
    fs::remove(path_);
    return same;
  }

  const TemporaryFolder folder_;
  const Index3 dims_{70, 60, 100};
  const std::string path_ = folder_.file("a.isb");
  std::vector<std::uint8_t> values_;
  BuildOptions options_;
  std::string reference_, partial_, journal_;
};

TEST_F(ResumeDamaged, AsItWasLeft) {
  std::uint64_t resumed = 0;
  EXPECT_TRUE(resumes(&resumed));
  EXPECT_GT(resumed, 20u);
}

TEST_F(ResumeDamaged, FlippedCutAndTornFilesStillGiveTheSameBytes) {
  Random random(11);
  for (int round = 0; round < 60; ++round) {
    std::string partial = partial_, journal = journal_;
    switch (round % 5) {
      case 0:  // a page of the temporary never reached the disk
        partial[8 + randomBelow(random, partial.size() - 8)] ^= 0x40;
        break;
      case 1:
        partial.resize(randomBelow(random, partial.size()));
        break;
      case 2:
        journal[randomBelow(random, journal.size())] ^= 0x01;
        break;
      case 3:
        journal.resize(randomBelow(random, journal.size()));
        break;
      case 4:
        partial += std::string(randomBelow(random, 5000), 'x');
        break;
    }
    writeBytes(path_ + ".partial", partial);
    writeBytes(path_ + ".partial.journal", journal);
    // A flip in the identity makes it another build's journal: damaged, not different.
    const auto left = WriteJournal::read(path_ + ".partial.journal");
    if (partial.size() <= 512 || left)
      EXPECT_TRUE(resumes()) << round;
    else
      expectRefusal();
  }
}

TEST_F(ResumeDamaged, AnEntryWithAChangedByteEndsTheJournal) {
  const std::string path = path_ + ".partial.journal";
  const std::size_t entries = WriteJournal::read(path)->entries.size();
  const std::size_t third = journal_.size() - (entries - 2) * sizeof(JournalEntry);
  for (std::size_t byte = third; byte < third + sizeof(JournalEntry); ++byte) {
    std::string journal = journal_;
    journal[byte] ^= 0x01;
    writeBytes(path, journal);
    ASSERT_EQ(WriteJournal::read(path)->entries.size(), 2u) << byte - third;
  }
}

// Bytes between parts have no checksum; they must be zero all the same.
TEST_F(ResumeDamaged, FlippedPaddingStillGivesTheSameBytes) {
  const auto journal = WriteJournal::read(path_ + ".partial.journal");
  std::uint64_t end = 512;
  for (const JournalEntry& entry : journal->entries) {
    std::string partial = partial_;
    const std::uint64_t first = entry.row.part(PartKind::kSamples).stored_bytes > 0
                                    ? entry.row.part(PartKind::kSamples).offset
                                    : entry.row.part(PartKind::kRanges).offset;
    if (first > end) {
      partial[end] ^= 0x10;
      writeBytes(path_ + ".partial", partial);
      writeBytes(path_ + ".partial.journal", journal_);
      EXPECT_TRUE(resumes());
      break;
    }
    end = entry.end;
  }
}

TEST_F(ResumeDamaged, OtherOptionsAndInputsAreRefusedAndNothingIsLost) {
  const auto refusal = [&](const BuildOptions& changed, VolumeSource& source) {
    BuildOptions options = changed;
    options.resume = true;
    const std::string message = messageOfBuild(source, path_, options);
    EXPECT_TRUE(readBytes(path_ + ".partial") == partial_);
    EXPECT_TRUE(readBytes(path_ + ".partial.journal") == journal_);
    return message;
  };
  BuildOptions other = options_;
  other.codec = format::Codec::kZstd;
  ArraySource<std::uint8_t> source(dims_, values_);
  EXPECT_NE(refusal(other, source).find("codec=zstd (it was codec=lz4)"), std::string::npos);
  ArraySource<std::uint8_t> renamed(dims_, values_);
  renamed.editInfo().source = "another";
  EXPECT_NE(refusal(options_, renamed).find("input="), std::string::npos);
  EXPECT_TRUE(resumes());
}

TEST_F(ResumeDamaged, ABuildWithoutResumeBeginsAnew) {
  ArraySource<std::uint8_t> source(dims_, values_);
  const BuildReport report = buildPyramid(source, path_, options_);
  EXPECT_EQ(report.bricks_resumed, 0u);
  EXPECT_TRUE(readBytes(path_) == reference_);
  EXPECT_FALSE(fs::exists(path_ + ".partial"));
  EXPECT_FALSE(fs::exists(path_ + ".partial.journal"));
}

// Entries whose checksums are right and whose content is impossible end what is taken over.
TEST_F(ResumeDamaged, ImpossibleEntriesAreNotBelieved) {
  const auto journal = WriteJournal::read(path_ + ".partial.journal");
  const auto forge = [&](auto&& change) {
    std::vector<JournalEntry> entries(journal->entries.begin(), journal->entries.begin() + 10);
    std::size_t i = 0;
    while (entries[i].row.part(PartKind::kSamples).stored_bytes == 0) ++i;
    change(entries[i]);
    writeBytes(path_ + ".partial", partial_);
    fs::remove(path_ + ".partial.journal");
    WriteJournal forged(path_ + ".partial.journal", journal->identity, {});
    for (const JournalEntry& entry : entries) forged.add(entry.row, entry.end);
    forged.flush();
    std::uint64_t resumed = 0;
    EXPECT_TRUE(resumes(&resumed));
    EXPECT_EQ(resumed, i);
  };
  forge([](JournalEntry& e) { e.row.part(PartKind::kSamples).stored_bytes = 0xFFFFFFFF; });
  forge([](JournalEntry& e) { e.row.part(PartKind::kSamples).codec = 77; });
  forge([](JournalEntry& e) { e.row.part(PartKind::kSamples).codec = 1; });
  forge([](JournalEntry& e) { e.row.constant = 1e9f; });
  forge([](JournalEntry& e) { e.row.constant = std::numeric_limits<float>::quiet_NaN(); });
  forge([](JournalEntry& e) { e.end = ~std::uint64_t{0}; });
  forge([](JournalEntry& e) {
    e.row.part(PartKind::kRanges).offset = e.row.part(PartKind::kSamples).offset;
  });
}

TEST_F(ResumeDamaged, APipeInPlaceOfTheJournalDoesNotHang) {
  fs::remove(path_ + ".partial.journal");
  ASSERT_EQ(mkfifo((path_ + ".partial.journal").c_str(), 0600), 0);
  expectRefusal();
}

// The bricks are worth hours: they are not cut off because their list is gone.
TEST_F(ResumeDamaged, NothingIsCutOffWhenTheJournalIsGone) {
  const std::string path = path_ + ".partial.journal";
  for (const std::string& torn : {std::string(), journal_.substr(0, 20)}) {
    writeBytes(path, torn);
    expectRefusal();
  }
  fs::remove(path);
  expectRefusal();
  writeBytes(path, journal_);
  EXPECT_TRUE(resumes());
}

// A loss of power may tear it, and nobody can put it back.
TEST_F(ResumeDamaged, ADamagedFirstEntryBeginsAnew) {
  const std::string path = path_ + ".partial.journal";
  const std::size_t first_entry =
      journal_.size() - WriteJournal::read(path)->entries.size() * sizeof(JournalEntry);
  std::string damaged = journal_;
  damaged[first_entry] ^= 1;
  writeBytes(path, damaged);
  std::uint64_t resumed = 1;
  EXPECT_TRUE(resumes(&resumed));
  EXPECT_EQ(resumed, 0u);
}

// A build removes its own journal, not that of whoever took the name in between.
TEST(Resume, OnlyTheOwnJournalIsRemoved) {
  const TemporaryFolder folder;
  const std::string path = folder.file("a.journal");
  WriteJournal first(path, "one", {});
  WriteJournal second(path, "two", {});
  first.remove();
  EXPECT_EQ(WriteJournal::read(path)->identity, "two");
  second.remove();
  EXPECT_FALSE(fs::exists(path));
}

TEST(StreamingBuild, TheIdentityKnowsHowRawVoxelsAreRead) {
  const TemporaryFolder folder;
  writeBytes(folder.file("a.raw"), std::string(1000 * 4 + 8, 'a'));
  const auto identity = [&](const std::string& type, bool big_endian, std::uint64_t offset) {
    RawLayout layout;
    layout.voxels = {10, 10, 10};
    layout.type = type;
    layout.big_endian = big_endian;
    layout.offset_bytes = offset;
    writeBytes(folder.file("a.raw"), std::string(1000 * 4 + offset, 'a'));
    fs::last_write_time(folder.file("a.raw"), fs::file_time_type{});
    return buildIdentity(*openRawSource(folder.file("a.raw"), layout), {});
  };
  EXPECT_EQ(identity("u32", false, 0), identity("u32", false, 0));
  EXPECT_NE(identity("u32", false, 0), identity("i32", false, 0));
  EXPECT_NE(identity("u32", false, 0), identity("f32", false, 0));
  EXPECT_NE(identity("u32", false, 0), identity("u32", true, 0));
}

// The temporary is emptied and removed: it must be nobody else's file.
TEST(StreamingBuild, NobodysFileIsTakenForTheTemporary) {
  const TemporaryFolder folder;
  RawLayout layout;
  layout.voxels = {10, 10, 10};
  layout.type = "u8";
  const std::string voxels(1000, 'v');
  for (const char* ending : {".partial", ".partial.journal", ".partial.journal.new"}) {
    const std::string input = folder.file("a.isb") + ending;
    writeBytes(input, voxels);
    const auto source = openRawSource(input, layout);
    const std::string message = messageOfBuild(*source, folder.file("a.isb"), smallBricks());
    EXPECT_NE(message.find("is an input"), std::string::npos) << message;
    EXPECT_EQ(readBytes(input), voxels);
    fs::remove(input);
  }
  writeBytes(folder.file("a.isb.partial"), voxels);
  ArraySource<std::uint8_t> source({10, 10, 10}, std::vector<std::uint8_t>(1000));
  const std::string message = messageOfBuild(source, folder.file("a.isb"), smallBricks());
  EXPECT_NE(message.find("not an unfinished pyramid"), std::string::npos) << message;
  EXPECT_EQ(readBytes(folder.file("a.isb.partial")), voxels);
}

TEST(Resume, WithNothingLeftBehindBeginsAtTheBeginning) {
  const TemporaryFolder folder;
  const Index3 dims(20, 20, 20);
  const auto values = testVolume<float>(dims, 1);
  BuildOptions options = smallBricks();
  const std::string reference = build(dims, values, folder.file("a.isb"), options, false);
  options.resume = true;
  EXPECT_TRUE(build(dims, values, folder.file("b.isb"), options, false) == reference);
}

TEST(StreamingBuild, BadInputLeavesNothing) {
  const TemporaryFolder folder;
  const Index3 dims(40, 40, 200);
  auto values = testVolume<float>(dims, 1);
  values.back() = std::numeric_limits<float>::quiet_NaN();
  ArraySource<float> source(dims, values);
  const std::string message = messageOfBuild(source, folder.file("a.isb"), smallBricks());
  EXPECT_NE(message.find("(39,39,199)"), std::string::npos) << message;
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

}  // namespace
}  // namespace isobrick::test
