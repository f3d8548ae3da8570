// Stored error bounds in files that lie: meshes stay closed, and what cannot be is refused.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

const Index3 kDims(38, 41, 35);
constexpr double kIsovalue = 100.5;

class ErrorPart : public testing::Test {
 protected:
  void SetUp() override {
    Random random(9);
    std::vector<std::uint8_t> voxels;
    forEachIndex({Index3(0), kDims}, [&](const Index3& at) {
      const double noise = at.x < 20 ? randomReal(random, 0, 90) : 0;
      voxels.push_back(
          static_cast<std::uint8_t>(60 + 40 * std::sin(0.2 * static_cast<double>(at.x + at.y)) +
                                    static_cast<double>(at.z) + noise));
    });
    BuildOptions options;
    options.brick_cells = 8;
    options.error_level = 3;
    ArraySource<std::uint8_t> source(kDims, voxels);
    buildPyramid(source, folder_.file("good.isb"), options);
    good_ = readWholeFile(folder_.file("good.isb"));
  }

  std::string lyingFile(const std::function<void(PyramidDraft&)>& edit) {
    PyramidDraft draft(good_);
    edit(draft);
    const std::string path = folder_.file("lying.isb");
    const Bytes bytes = draft.seal();
    writeBytes(path, std::string(bytes.begin(), bytes.end()));
    return path;
  }
  // Changes the codes of all bricks that have some.
  static void editCodes(PyramidDraft& draft, const std::function<std::byte(std::byte)>& edit) {
    for (PyramidDraft::Brick& brick : draft.bricks) {
      if (brick.row.part(PartKind::kError).stored_bytes == 0) continue;
      PyramidDraft::Elements elements = draft.elementsOf(brick);
      for (std::byte& code : elements[3]) code = edit(code);
      draft.setElements(brick, elements, format::Codec::kLz4);
    }
  }
  static IndexedMesh extractClosed(const std::string& path, ExtractionReport* report = nullptr) {
    Query query;
    query.isovalue = kIsovalue;
    query.tolerance = 30;
    IndexedMeshSink sink;
    const ExtractionReport made = extractIsosurface(Pyramid(path), query, sink);
    if (report != nullptr) *report = made;
    const MeshReport check =
        checkMesh(sink.mesh().positions, sink.mesh().triangles, indexOptions(kDims));
    EXPECT_TRUE(check.ok()) << check.summary();
    return sink.mesh();
  }

  TemporaryFolder folder_;
  Bytes good_;
};

TEST_F(ErrorPart, OfAGoodFileLeavesCoarseCells) {
  ExtractionReport report;
  extractClosed(folder_.file("good.isb"), &report);
  EXPECT_GE(report.levels.back().level, 2);
  EXPECT_EQ(report.levels.front().level, 0);
}

TEST_F(ErrorPart, WhateverCodesSayMeshesAreClosed) {
  Random random(4);
  const std::function<std::byte(std::byte)> edits[] = {
      [](std::byte) { return std::byte{0}; }, [](std::byte) { return std::byte{255}; },
      [&](std::byte) { return static_cast<std::byte>(randomBelow(random, 256)); },
      [&](std::byte code) { return randomBelow(random, 8) == 0 ? std::byte{255} : code; },
      [&](std::byte code) { return randomBelow(random, 8) == 0 ? std::byte{0} : code; }};
  for (const auto& edit : edits)
    EXPECT_GT(extractClosed(lyingFile([&](PyramidDraft& draft) {
                editCodes(draft, edit);
              })).triangles.size(),
              100u);
}

TEST_F(ErrorPart, OfAnotherSizeThanTheRangesAskForIsNamed) {
  const std::string path = lyingFile([](PyramidDraft& draft) {
    for (PyramidDraft::Brick& brick : draft.bricks) {
      if (brick.row.part(PartKind::kError).stored_bytes == 0) continue;
      PyramidDraft::Elements elements = draft.elementsOf(brick);
      elements[3].resize(elements[3].size() + 64);
      draft.setElements(brick, elements, format::Codec::kStored);
    }
  });
  const Pyramid pyramid(path);
  std::size_t damaged = 0;
  for (std::size_t row = 0; row < pyramid.brickCount(); ++row) {
    const BrickAddress at = pyramid.parts().brickAt(row);
    const auto damage = verifyBrick(pyramid, at.level, at.brick);
    if (!damage) continue;
    ++damaged;
    EXPECT_GE(at.level, kFirstErrorLevel);
    EXPECT_NE(damage->what.find("bytes that its ranges ask for"), std::string::npos)
        << damage->what;
  }
  EXPECT_GT(damaged, 8u);
  try {
    extractClosed(path);
    FAIL() << "errors of a wrong size were taken";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("of level"), std::string::npos) << error.what();
  }
}

TEST_F(ErrorPart, ImpossibleBinsAreRefused) {
  const std::function<void(format::Header&)> edits[] = {
      [](format::Header& h) { h.error_width = 0; },
      [](format::Header& h) { h.error_width = -1; },
      [](format::Header& h) { h.error_first = std::nan(""); },
      [](format::Header& h) { h.error_bins = 0; },
      [](format::Header& h) { h.error_bins = 257; },
      [](format::Header& h) { h.error_last_level = 1; },
      [](format::Header& h) { h.error_last_level = 4; }};
  for (const auto& edit : edits) {
    const std::string path = lyingFile([&](PyramidDraft& draft) { edit(draft.header); });
    EXPECT_THROW(Pyramid{path}, Error);
  }
}

}  // namespace
}  // namespace isobrick::test
