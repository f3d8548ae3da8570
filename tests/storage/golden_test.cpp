// The checked-in pyramids: read by the library and by the plain reader, and built anew. See
// tests/golden/README.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/file_bytes.h"
#include "tests/support/golden_pyramid.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick::test {
namespace {

std::string goldenText(const std::string& name) {
  return readBytes(goldenFolder() + "/" + name + ".txt");
}

class Golden : public testing::TestWithParam<GoldenPyramid> {
 protected:
  std::string file() const { return goldenFolder() + "/" + GetParam().name + ".isb"; }
};

TEST_P(Golden, ThePlainReaderFindsWhatTheTextSays) {
  const std::string text = goldenText(GetParam().name);
  ASSERT_NE(text, "") << "no dump of " << file();
  EXPECT_EQ(dumpOf(readPlainPyramid(file())), text);
}

TEST_P(Golden, TheLibraryFindsWhatTheTextSays) {
  const std::string text = goldenText(GetParam().name);
  ASSERT_NE(text, "") << "no dump of " << file();
  const Pyramid pyramid(file());
  EXPECT_EQ(dumpOf(pyramid), withoutParts(text));
  EXPECT_NE(pyramid.provenance().find("golden"), std::string::npos);
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 bricks = pyramid.layout().bricks(level);
    for (std::int64_t i = 0; i < elementCount(bricks); ++i) {
      const Index3 brick(i % bricks.x, i / bricks.x % bricks.y, i / bricks.x / bricks.y);
      const auto damage = verifyBrick(pyramid, level, brick);
      EXPECT_FALSE(damage) << damage->what;
    }
  }
}

// The file without its provenance (paths, versions) and what the header says of that.
Bytes withoutProvenance(const std::string& path) {
  Bytes bytes = readWholeFile(path);
  const PlainPyramid plain = readPlainPyramid(path);
  const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(plain.provenance_offset);
  bytes.erase(begin, begin + static_cast<std::ptrdiff_t>(plain.provenance.size()));
  const auto clear = [&](std::size_t at, std::size_t count) {
    std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), count, std::uint8_t{0});
  };
  clear(16, 8);    // file_bytes
  clear(248, 24);  // the provenance
  clear(504, 8);   // header_checksum
  return bytes;
}

TEST_P(Golden, IsBuiltTheSameToday) {
  const TemporaryFolder folder;
  const std::string path = folder.file("today.isb");
  buildGoldenPyramid(GetParam(), path);
  // Packed bytes depend on the versions of the libraries that pack.
  EXPECT_EQ(withoutParts(dumpOf(readPlainPyramid(path))),
            withoutParts(goldenText(GetParam().name)));
  if (GetParam().options.codec == format::Codec::kStored) {
    EXPECT_TRUE(withoutProvenance(path) == withoutProvenance(file()));
  }
}

INSTANTIATE_TEST_SUITE_P(Files, Golden, testing::ValuesIn(goldenPyramids()),
                         [](const testing::TestParamInfo<GoldenPyramid>& golden) {
                           std::string name = golden.param.name;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

// The dump without what it says of the curvature.
std::string withoutCurvature(const std::string& dump) {
  std::istringstream lines(dump);
  std::string result;
  bool is_left_out = false;
  for (std::string line; std::getline(lines, line);) {
    is_left_out = line.starts_with("has_curvature") || line.starts_with("  curvature:") ||
                  (is_left_out && line.starts_with("    "));
    if (!is_left_out) result += line + '\n';
  }
  return result;
}

// Files of earlier programs, with kinds of parts that none writes today: passed over is what only
// they have.
class GoldenOfOldKinds : public testing::TestWithParam<const char*> {};

TEST_P(GoldenOfOldKinds, IsReadAsTheSameWithout) {
  const std::string old = GetParam(), name = old.substr(old.find('-') + 1);
  const Pyramid pyramid(goldenFolder() + "/" + old + ".isb");
  EXPECT_FALSE(pyramid.spec().has_curvature);
  EXPECT_EQ(withoutCurvature(dumpOf(pyramid)), withoutCurvature(withoutParts(goldenText(name))));
  const PyramidFaults faults = verifyPyramid(pyramid, {});
  EXPECT_TRUE(faults.rest.empty() && faults.bricks.empty());
  const Pyramid without(goldenFolder() + "/" + name + ".isb");
  Query query;
  query.isovalue = 0.25 * pyramid.valueRange().max + 0.75 * pyramid.valueRange().min;
  query.focus = FocusSphere{glm::dvec3(15, 2, 2), 1};
  IndexedMeshSink sink, expected;
  extractIsosurface(pyramid, query, sink);
  extractIsosurface(without, query, expected);
  EXPECT_GT(sink.mesh().triangles.size(), 10u);
  EXPECT_EQ(sink.mesh().positions, expected.mesh().positions);
  EXPECT_EQ(sink.mesh().triangles, expected.mesh().triangles);
  query.curvature_tolerance = 0.1;
  EXPECT_THROW(extractIsosurface(pyramid, query, sink), Error);
}

INSTANTIATE_TEST_SUITE_P(Files, GoldenOfOldKinds,
                         testing::Values("cells-u8-none", "errors-i8-none", "errors-f32-zstd"),
                         [](const auto& name) {
                           std::string text = name.param;
                           std::replace(text.begin(), text.end(), '-', '_');
                           return text;
                         });

TEST(GoldenFolder, ShowsEveryCodecAndHasNoFileTooMany) {
  std::set<std::uint32_t> codecs;
  std::set<std::string> expected = {"README.md",          "pictures",
                                    "errors-i8-none.isb", "errors-f32-zstd.isb",
                                    "cells-u8-none.isb",  "panels"},
                        found;
  for (const GoldenPyramid& golden : goldenPyramids()) {
    expected.insert(golden.name + ".isb");
    expected.insert(golden.name + ".txt");
    const PlainPyramid plain = readPlainPyramid(goldenFolder() + "/" + golden.name + ".isb");
    for (const PlainBrick& brick : plain.bricks)
      for (const PlainPart& part : brick.parts) codecs.insert(part.codec);
  }
  for (const auto& entry : std::filesystem::directory_iterator(goldenFolder()))
    found.insert(entry.path().filename().string());
  EXPECT_EQ(found, expected);
  EXPECT_EQ(codecs, (std::set<std::uint32_t>{0, 1, 2, 3, 4}));
}

}  // namespace
}  // namespace isobrick::test
