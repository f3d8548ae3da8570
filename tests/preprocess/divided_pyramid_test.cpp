// A pyramid of many files has the values, and gives the meshes, of one that is built as a whole.
#include "isobrick/preprocess/divided_pyramid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <filesystem>

#include "isobrick/extract/extractor.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/super_brick_input.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/extract/random_case.h"
#include "tests/support/array_source.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// A volume that is read box by box.
template <typename T>
class BoxSource : public ArraySource<T> {
 public:
  using ArraySource<T>::ArraySource;
  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    auto* to = static_cast<T*>(out);
    const Index3& dims = this->info().voxels;
    forEachIndex({Index3(0), {1, box.count.y, box.count.z}}, [&](const Index3& row) {
      const auto from = static_cast<std::ptrdiff_t>(linearIndex(box.first + row, dims));
      std::copy_n(this->values().begin() + from, box.count.x, to);
      to += box.count.x;
    });
    voxels_read_ += box.size();
  }
  std::int64_t voxelsRead() const { return voxels_read_; }

 private:
  mutable std::atomic<std::int64_t> voxels_read_ = 0;
};

template <typename Source, typename T>
void buildAll(const std::string& folder, const Index3& dims, const std::vector<T>& values,
              const BuildOptions& options, RandomCase& random) {
  std::filesystem::create_directory(folder);
  VolumeInfo info = Source(dims, values).info();
  std::vector<std::size_t> order(superBrickFiles(info, options).size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  for (std::size_t i = order.size(); i > 1; --i)
    std::swap(order[i - 1],
              order[static_cast<std::size_t>(random.uniform(0, static_cast<int>(i) - 1))]);
  for (const std::size_t number : order) {
    Source source(dims, values);
    InputWatch input(source);
    const std::string path = folder + "/" + superBrickFiles(info, options)[number].name;
    const std::string identity = buildIdentity(info, input.identity(), options);
    ASSERT_EQ(stateOfDividedFile(path, identity), DividedFileState::kMissing);
    buildSuperBrick(source, input, folder, number, options);
    ASSERT_EQ(stateOfDividedFile(path, identity), DividedFileState::kBuilt);
    BuildOptions others = options;
    others.super_cells *= 2;
    ASSERT_EQ(stateOfDividedFile(path, buildIdentity(info, input.identity(), others)),
              DividedFileState::kOfAnotherBuild);
  }
}

void expectSameValues(const Pyramid& divided, const Pyramid& whole) {
  const BrickLayout& layout = whole.layout();
  EXPECT_EQ(divided.valueRange(), whole.valueRange());
  EXPECT_EQ(divided.noise(), whole.noise());
  EXPECT_TRUE(std::ranges::equal(divided.histogram().counts(), whole.histogram().counts()));
  const auto steep = divided.parts().tables().gradients(),
             whole_steep = whole.parts().tables().gradients();
  ASSERT_EQ(steep.has_value(), whole_steep.has_value());
  if (steep) {
    EXPECT_EQ(elementsOf(*steep), elementsOf(*whole_steep));
  }
  ASSERT_EQ(divided.brickCount(), whole.brickCount());
  std::vector<ValueRange> tiles, whole_tiles;
  std::vector<std::uint8_t> codes, whole_codes;
  for (int level = 0; level < layout.lattice().levels(); ++level)
    forEachIndex({Index3(0), layout.bricks(level)}, [&](const Index3& brick) {
      SCOPED_TRACE(brickName(level, brick));
      EXPECT_EQ(divided.brickRange(level, brick), whole.brickRange(level, brick));
      const BrickSamples samples = divided.samples(level, brick),
                         whole_samples = whole.samples(level, brick);
      ASSERT_EQ(samples.box, whole_samples.box);
      EXPECT_EQ(std::memcmp(samples.part.data(), whole_samples.part.data(),
                            static_cast<std::size_t>(samples.box.size()) *
                                voxelBytes(whole.spec().voxel_type)),
                0);
      divided.tileRanges(level, brick, tiles);
      whole.tileRanges(level, brick, whole_tiles);
      EXPECT_EQ(tiles, whole_tiles);
      if (level > 0) return;
      divided.parts().curvature(brick, codes);
      whole.parts().curvature(brick, whole_codes);
      EXPECT_EQ(codes, whole_codes);
    });
}

std::uint64_t meshOf(const Pyramid& pyramid, const Query& query) {
  HashingSink sink;
  Extractor(pyramid).extract(query, sink);
  return sink.value();
}

template <typename T>
void expectSamePyramid(std::uint32_t seed) {
  RandomCase random(seed);
  const TemporaryFolder folder;
  Index3 dims(random.uniform(2, 70), random.uniform(2, 70), random.uniform(2, 70));
  while (elementCount(dims) > 60000) dims[random.uniform(0, 2)] = random.uniform(2, 30);
  BuildOptions options;
  options.brick_cells = std::int64_t{4} << random.uniform(0, 2);
  options.tile_cells = std::min<std::int64_t>(options.brick_cells, 2 << random.uniform(0, 1));
  options.filter = random.chance(0.3) ? format::Filter::kSubsample : format::Filter::kAverage;
  options.codec = random.chance(0.5) ? format::Codec::kLz4 : format::Codec::kStored;
  options.with_curvature = random.chance(0.8);
  if (Lattice(dims).levels() < 2) dims.x = 70;
  if (BrickLayout(Lattice(dims), options.brick_cells, options.tile_cells).lattice().levels() < 2)
    return;
  const std::vector<T> values = random.field<T>(dims);
  ArraySource<T> source(dims, values);
  buildPyramid(source, folder.file("whole.isb"), options);

  options.super_cells = options.brick_cells << random.uniform(0, 4);
  const std::string divided_path = folder.file("divided.isbs");
  if (random.chance(0.7))
    ASSERT_NO_FATAL_FAILURE((buildAll<BoxSource<T>>(divided_path, dims, values, options, random)));
  else
    ASSERT_NO_FATAL_FAILURE(
        (buildAll<ArraySource<T>>(divided_path, dims, values, options, random)));
  const JoinReport report = joinPyramid(divided_path, {});

  const Pyramid whole(folder.file("whole.isb"));
  const Pyramid divided(divided_path, Pyramid::kDefaultBudgetBytes,
                        random.chance(0.5) ? FileAccess::kMap : FileAccess::kRead);
  EXPECT_EQ(report.bricks, whole.brickCount());
  EXPECT_EQ(report.file_bytes, divided.fileBytes());
  expectSameValues(divided, whole);
  const PyramidFaults faults = verifyPyramid(divided);
  EXPECT_TRUE(faults.bricks.empty()) << faults.bricks.front().what;
  EXPECT_TRUE(faults.rest.empty()) << faults.rest.front();
  for (int i = 0; i < 3; ++i) {
    Query query;
    const ValueRange& range = whole.valueRange();
    query.isovalue = random.real(static_cast<double>(range.min), static_cast<double>(range.max));
    static_cast<DetailChoice&>(query) = randomChoice(random, whole, 0.6);
    if (!options.with_curvature) query.curvature_tolerance.reset();
    EXPECT_EQ(meshOf(divided, query), meshOf(whole, query));
  }
}

class DividedPyramids : public testing::TestWithParam<std::uint32_t> {};

TEST_P(DividedPyramids, HaveTheValuesOfOneBuild) {
  for (std::uint32_t i = 0; i < 20; ++i) {
    const std::uint32_t seed = 100 * GetParam() + i;
    SCOPED_TRACE("pyramid " + std::to_string(seed));
    switch (i % 5) {
      case 0:
        expectSamePyramid<std::uint8_t>(seed);
        break;
      case 1:
        expectSamePyramid<std::int8_t>(seed);
        break;
      case 2:
        expectSamePyramid<std::uint16_t>(seed);
        break;
      case 3:
        expectSamePyramid<std::int16_t>(seed);
        break;
      default:
        expectSamePyramid<float>(seed);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Random, DividedPyramids, testing::Range(1u, 7u));

// Counts the rows that are read, of all copies.
class CountedSource final : public ArraySource<std::uint8_t> {
 public:
  CountedSource(const Index3& dims, const std::vector<std::uint8_t>& values,
                std::vector<int>& reads)
      : ArraySource(dims, values), reads_(reads) {}

 private:
  void fillRows(std::int64_t first, std::int64_t count, void* out) override {
    for (std::int64_t row = first; row < first + count; ++row)
      ++reads_[static_cast<std::size_t>(row)];
    std::copy_n(values().begin() + first * info().voxels.x, count * info().voxels.x,
                static_cast<std::uint8_t*>(out));
  }
  std::vector<int>& reads_;
};

// Slices that are read in order are read once for super-bricks beside each other.
TEST(SuperBrickInputTest, ReadsASliceOnceForAllThatLieBesideEachOther) {
  const TemporaryFolder folder;
  const Index3 dims(120, 110, 130);
  RandomCase random(5);
  const auto values = random.field<std::uint8_t>(dims);
  BuildOptions options;
  options.brick_cells = 8;
  {
    ArraySource<std::uint8_t> source(dims, values);
    buildPyramid(source, folder.file("whole.isb"), options);
  }
  options.super_cells = 64;
  std::filesystem::create_directory(folder.file("divided.isbs"));
  std::vector<int> reads(static_cast<std::size_t>(dims.y * dims.z));
  SuperBrickInput input([&] { return std::make_unique<CountedSource>(dims, values, reads); },
                        folder.file("divided.isbs"));
  InputWatch watch(input.volume());
  const std::vector<SuperBrickFile> files = superBrickFiles(input.volume().info(), options);
  ASSERT_EQ(files.size(), 2u * 2u * 3u);
  double told = -1;
  for (std::size_t i = 0; i < files.size(); ++i) {
    VolumeSource& source = input.sourceOf(std::span(files).subspan(i), nullptr, [&](double share) {
      EXPECT_GE(share, 0);
      EXPECT_LE(share, 1);
      told = share;
    });
    EXPECT_EQ(source.readsBoxes(), true);
    buildSuperBrick(source, watch, folder.file("divided.isbs"), i, options);
  }
  EXPECT_GE(told, 0);
  joinPyramid(folder.file("divided.isbs"), {});
  expectSameValues(Pyramid(folder.file("divided.isbs")), Pyramid(folder.file("whole.isb")));
  // Slabs overlap by the voxels around super-bricks, and by no more.
  std::int64_t sum = 0;
  for (const int count : reads) {
    EXPECT_GE(count, 1);
    EXPECT_LE(count, 3);
    sum += count;
  }
  std::int64_t slabs = 0;
  for (std::size_t i = 0; i < files.size(); i += 4) slabs += files[i].reads.count.z * dims.y;
  EXPECT_LE(sum, slabs);
}

// One alone reads the source itself; slices that were read are read again from a new one.
TEST(SuperBrickInputTest, ASingleSuperBrickNeedsNoFile) {
  const TemporaryFolder folder;
  const Index3 dims(40, 40, 70);
  const std::vector<std::uint8_t> values(static_cast<std::size_t>(elementCount(dims)), 7);
  std::vector<int> reads(static_cast<std::size_t>(dims.y * dims.z));
  SuperBrickInput input([&] { return std::make_unique<CountedSource>(dims, values, reads); },
                        folder.path());
  BuildOptions options;
  options.brick_cells = 8;
  options.super_cells = 32;
  const std::vector<SuperBrickFile> files = superBrickFiles(input.volume().info(), options);
  const auto sourceOf = [&](std::size_t number) -> VolumeSource& {
    return input.sourceOf(std::span(&files[number], 1), nullptr, {});
  };
  EXPECT_FALSE(sourceOf(0).readsBoxes());
  buildSuperBrick(sourceOf(0), folder.path(), 0, options);
  buildSuperBrick(sourceOf(1), folder.path(), 1, options);
  EXPECT_EQ(stateOfDividedFile(folder.file(files[1].name), buildIdentity(input.volume(), options)),
            DividedFileState::kBuilt);
}

}  // namespace
}  // namespace isobrick::test
