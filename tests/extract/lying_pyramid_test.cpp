// Pyramids with right checksums and wrong contents: an extraction ends in an Error or in a mesh
// whose indices and positions can be used, whatever ranges and samples say.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Bytes of a pyramid with one brick of `dims` voxels a level if it fits, of values 0 .. 99.
Bytes buildNoise(const TemporaryFolder& folder, const Index3& dims, std::int64_t brick_cells,
                 std::int64_t tile_cells) {
  Random random(3);
  ArraySource<float> source(dims, arrayOfField<float>(dims, [&](const Index3&) {
                              return static_cast<float>(random() % 100);
                            }));
  BuildOptions options;
  options.brick_cells = brick_cells;
  options.tile_cells = tile_cells;
  const std::string path = folder.file("good.isb");
  buildPyramid(source, path, options);
  return readWholeFile(path);
}

void writeFile(const std::string& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

// Fails the test if a batch cannot be used. A sanitizer sees the rest.
class CheckingSink : public TriangleSink {
 public:
  void accept(const MeshBatch& batch) override {
    EXPECT_EQ(batch.normals.size(), batch.positions.size());
    for (const std::uint32_t index : batch.triangles) {
      if (index < batch.positions.size()) continue;
      ++bad_indices;
    }
    for (const glm::vec3& p : batch.positions)
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) ++bad_positions;
    for (const glm::vec3& n : batch.normals)
      if (!(std::abs(glm::dot(n, n) - 1.0f) < 1e-3f)) ++bad_normals;
    triangles += batch.triangles.size() / 3;
  }
  std::uint64_t triangles = 0, bad_indices = 0, bad_positions = 0, bad_normals = 0;
};

// Extracts, and returns the Error's text or "".
std::string extractChecked(const Pyramid& pyramid, const Query& query) {
  CheckingSink sink;
  std::string message;
  try {
    extractIsosurface(pyramid, query, sink);
  } catch (const Error& error) {
    message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
  EXPECT_EQ(sink.bad_indices, 0u);
  EXPECT_EQ(sink.bad_positions, 0u);
  EXPECT_EQ(sink.bad_normals, 0u);
  return message;
}

// The same for a mesh in memory, whose bricks take numbers of vertices from each other. Nothing of
// what was extracted before shows in it.
std::string extractInPlaceChecked(const Pyramid& pyramid, const Query& query) {
  std::string message;
  std::vector<std::uint32_t> expected;
  Extractor extractor(pyramid);
  SurfaceMesh mesh;
  for (const bool is_first : {true, false}) {
    std::string now;
    try {
      extractor.extract(query, mesh);
    } catch (const Error& error) {
      EXPECT_EQ(mesh.triangles().size(), 0u);
      now = error.what();
    }
    std::uint64_t bad_indices = 0;
    for (const std::uint32_t index : mesh.triangles())
      bad_indices += index >= mesh.positions().size();
    EXPECT_EQ(bad_indices, 0u);
    const std::vector<std::uint32_t> triangles(mesh.triangles().begin(), mesh.triangles().end());
    if (is_first) {
      message = now;
      expected = triangles;
      Query other = query;
      other.isovalue += 25;
      try {
        extractor.extract(other, mesh);
      } catch (const Error&) {
      }
    } else {
      EXPECT_EQ(now.empty(), message.empty()) << now << message;
      EXPECT_TRUE(triangles == expected) << "the mesh depends on what was extracted before";
    }
  }
  return message;
}

using EditElements = std::function<void(const PyramidDraft::Brick&, PyramidDraft::Elements&)>;

Bytes edited(const Bytes& good, const EditElements& edit) {
  PyramidDraft draft(good);
  for (PyramidDraft::Brick& brick : draft.bricks) {
    PyramidDraft::Elements elements = draft.elementsOf(brick);
    edit(brick, elements);
    draft.setElements(brick, elements, format::Codec::kStored);
  }
  return draft.seal();
}

TEST(LyingPyramid, ADraftThatWasNotChangedIsTheSamePyramid) {
  const TemporaryFolder folder;
  const Bytes good = buildNoise(folder, Index3(17), 16, 4);
  const std::string path = folder.file("same.isb");
  writeFile(path, edited(good, [](const auto&, auto&) {}));
  const Pyramid pyramid(path);
  EXPECT_FALSE(verifyBrick(pyramid, 0, Index3(0)).has_value());
  Query query;
  query.isovalue = 50;
  EXPECT_EQ(extractChecked(pyramid, query), "");
}

// Some tiles claim that no surface crosses them, so that their rows are not swept, but one does.
TEST(LyingPyramid, TileRangesThatAreTooNarrowMakeAnErrorOrAMesh) {
  const TemporaryFolder folder;
  const Bytes good = buildNoise(folder, Index3(33), 16, 4);
  const std::string path = folder.file("narrow.isb");
  Random random(1);
  int errors = 0;
  for (int round = 0; round < 40; ++round) {
    const std::uint64_t hidden = 1 + randomBelow(random, 99);  // of a hundred tiles
    writeFile(path, edited(good, [&](const PyramidDraft::Brick&, PyramidDraft::Elements& elements) {
                // All rows of tiles are hidden alike, or each tile by itself.
                for (std::size_t at = 0; at + 32 <= elements[1].size(); at += 32) {
                  const bool row_is_hidden = randomBelow(random, 100) < hidden;
                  for (std::size_t tile = 0; tile < 32; tile += 8) {
                    const bool is_hidden =
                        round % 2 == 0 ? row_is_hidden : randomBelow(random, 100) < hidden;
                    const float low = 0;
                    if (is_hidden) std::memcpy(elements[1].data() + at + tile + 4, &low, 4);
                  }
                }
              }));
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = 50;
    // A batch has numbers for all that its rows see.
    EXPECT_EQ(extractChecked(pyramid, query), "");
    const std::string message = extractInPlaceChecked(pyramid, query);
    if (message.empty()) continue;
    ++errors;
    EXPECT_NE(message.find(path), std::string::npos) << message;
    EXPECT_NE(message.find("brick ("), std::string::npos) << message;
    EXPECT_NE(message.find("verify"), std::string::npos) << message;
  }
  EXPECT_GT(errors, 5);
}

// A brick claims that no surface crosses it; those behind it take over vertices on its sides.
TEST(LyingPyramid, ABrickThatHidesItsSurfaceMakesAnError) {
  const TemporaryFolder folder;
  const Bytes good = buildNoise(folder, Index3(40, 25, 25), 8, 4);
  const std::string path = folder.file("hidden.isb");
  const Index3 bricks(5, 3, 3);
  for (std::int64_t z = 0; z < bricks.z; ++z)
    for (std::int64_t y = 0; y < bricks.y; ++y)
      for (std::int64_t x = 0; x < bricks.x; ++x) {
        const Index3 hidden(x, y, z);
        if (hidden == bricks - Index3(1)) continue;  // nobody takes anything of the last
        SCOPED_TRACE(testing::Message() << x << "," << y << "," << z);
        writeFile(path, edited(good, [&](const auto& brick, PyramidDraft::Elements& elements) {
                    if (brick.level != 0 || brick.index != hidden) return;
                    const float low = 0;
                    for (std::size_t at = 4; at < elements[1].size(); at += 8)
                      std::memcpy(elements[1].data() + at, &low, 4);
                  }));
        const Pyramid pyramid(path);
        Query query;
        query.isovalue = 50;
        EXPECT_EQ(extractChecked(pyramid, query), "");
        const std::string message = extractInPlaceChecked(pyramid, query);
        EXPECT_NE(message.find("contradicts itself in brick ("), std::string::npos) << message;
      }
}

// The same for a brick whose samples deny what its neighbours have on the common side.
TEST(LyingPyramid, ABrickWithOtherSamplesOnItsSideMakesAnErrorOrTheSameMeshAgain) {
  const TemporaryFolder folder;
  const Bytes good = buildNoise(folder, Index3(40, 25, 25), 8, 4);
  const std::string path = folder.file("denied.isb");
  Random random(5);
  int errors = 0;
  for (int round = 0; round < 40; ++round) {
    const std::uint64_t share = 1 + randomBelow(random, 100);
    writeFile(path, edited(good, [&](const PyramidDraft::Brick& brick, auto& elements) {
                if (brick.level != 0 || randomBelow(random, 3) != 0) return;
                for (std::size_t at = 0; at + 4 <= elements[0].size(); at += 4) {
                  const float value = round % 2 == 0 ? 0 : static_cast<float>(random() % 100);
                  if (randomBelow(random, 100) < share)
                    std::memcpy(elements[0].data() + at, &value, 4);
                }
              }));
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = 50;
    if (!extractInPlaceChecked(pyramid, query).empty()) ++errors;
  }
  EXPECT_GT(errors, 5);
}

// Values that are not finite have no mean: a point between two that are both inside can be outside.
TEST(LyingPyramid, SamplesThatAreNotFiniteMakeAnErrorOrAMesh) {
  const TemporaryFolder folder;
  const Bytes good = buildNoise(folder, Index3(33), 8, 4);
  const std::string path = folder.file("infinite.isb");
  Random random(2);
  const float nasty[] = {
      std::numeric_limits<float>::infinity(),  -std::numeric_limits<float>::infinity(),
      std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::max(),
      std::numeric_limits<float>::lowest(),    std::numeric_limits<float>::denorm_min()};
  int errors = 0, meshes = 0;
  for (int round = 0; round < 60; ++round) {
    const std::uint64_t share = 1 + randomBelow(random, 60);  // of a hundred samples
    const std::uint64_t kinds = round % 3 == 0 ? 1 : 6;
    writeFile(path, edited(good, [&](const PyramidDraft::Brick&, PyramidDraft::Elements& elements) {
                for (std::size_t at = 0; at < elements[0].size(); at += 4)
                  if (randomBelow(random, 100) < share)
                    std::memcpy(elements[0].data() + at, &nasty[randomBelow(random, kinds)], 4);
              }));
    const Pyramid pyramid(path);
    Query query;
    query.isovalue = 50;
    query.cull_by_ranges = false;
    query.focus = FocusSphere{glm::dvec3(randomReal(random, 0, 32), 16, 16), 2};
    (extractChecked(pyramid, query).empty() ? meshes : errors) += 1;
    query.focus.reset();
    (extractChecked(pyramid, query).empty() ? meshes : errors) += 1;
  }
  EXPECT_GT(errors, 5);
  EXPECT_GT(meshes, 5);
}

}  // namespace
}  // namespace isobrick::test
