// Each byte of a small pyramid of every kind changed to three values, and each end cut off: verify
// finds it, and whoever reads the pyramid gets one clear error or the right result. CI tries some,
// ISOBRICK_REPETITIONS=40000 all.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "isobrick/extract/extractor.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/byte_damage.h"
#include "tests/support/every_brick.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/pyramid_kinds.h"
#include "tests/support/range_server.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// One line that names the pyramid, or its file; or the hash of a result.
struct Answer {
  std::string error;
  std::uint64_t hash = 0;
};

template <typename F>
Answer answerOf(F&& f) {
  try {
    return {"", f()};
  } catch (const Error& error) {
    return {error.what()};
  }
}

// As `extract` reads it, also around a focus with curvature.
std::uint64_t meshOfKind(const Pyramid& pyramid) {
  Query query;
  query.isovalue = pyramid.spec().values.real(40);
  HashingSink sink;
  extractIsosurface(pyramid, query, sink);
  query.focus = FocusSphere{glm::dvec3(4, 3, 3), 2};
  if (pyramid.spec().has_curvature) query.curvature_tolerance = 0.3;
  extractIsosurface(pyramid, query, sink);
  return sink.value();
}

// As `convert` and `info` read it.
std::uint64_t contentOfKind(const Pyramid& pyramid) {
  RunningChecksum sum;
  forAllBricks(pyramid, [&](int level, const Index3& brick) {
    const BrickSamples samples = pyramid.samples(level, brick);
    sum.add(samples.part.data(),
            static_cast<std::size_t>(samples.box.size()) * voxelBytes(pyramid.spec().voxel_type));
    pyramid.throwIfReadsFailed(level, brick);
  });
  const auto counts = pyramid.histogram();
  sum.add(counts.counts().data(), counts.counts().size_bytes());
  static_cast<void>(pyramid.sums());
  return sum.value();
}

bool isFoundByVerify(const std::string& path, const RemoteOptions& remote = {}) {
  VerifyOptions options;
  options.threads = 1;
  return !answerOf([&] {
            return verifyPyramid(Pyramid(path, 1 << 20, FileAccess::kMap, remote), options).empty()
                       ? 0u
                       : throw Error("found");
          }).error.empty();
}

void expectErrorOrRight(const Answer& answer, std::uint64_t right) {
  if (answer.error.empty())
    EXPECT_EQ(answer.hash, right);
  else
    EXPECT_EQ(std::count(answer.error.begin(), answer.error.end(), '\n'), 0) << answer.error;
}

class EveryByte : public testing::TestWithParam<PyramidKind> {
 protected:
  const TemporaryFolder folder_;
  const std::string path_ = buildKind(GetParam(), folder_);
};

TEST_P(EveryByte, IsFoundByVerifyAndLeadsNobodyAstray) {
  const std::uint64_t mesh = meshOfKind(Pyramid(path_)), content = contentOfKind(Pyramid(path_));
  ASSERT_FALSE(isFoundByVerify(path_));
  std::size_t tried = 0, all = 0, errors = 0;
  const std::vector<std::string> files = filesOfPyramid(path_);
  for (const std::string& file : files) {
    const std::string good = readBytes(file);
    all += damageCount(good);
    tried += forSomeDamages(good, 500 / static_cast<int>(files.size()), [&](std::size_t number) {
      SCOPED_TRACE(file + ", damage " + std::to_string(number));
      writeBytes(file, damaged(good, number));
      EXPECT_TRUE(isFoundByVerify(path_));
      const FileAccess access = number % 2 == 0 ? FileAccess::kMap : FileAccess::kRead;
      const Answer of_mesh = answerOf([&] { return meshOfKind(Pyramid(path_, 1 << 20, access)); });
      expectErrorOrRight(of_mesh, mesh);
      expectErrorOrRight(answerOf([&] { return contentOfKind(Pyramid(path_, 1 << 20, access)); }),
                         content);
      errors += of_mesh.error.empty() ? 0 : 1;
    });
    writeBytes(file, good);
  }
  EXPECT_FALSE(isFoundByVerify(path_));
  std::printf("%s: %zu of %zu damages, all found; %zu meshes are errors, the others right\n",
              GetParam().name, tried, all, errors);
}

TEST_P(EveryByte, BehindAUrlToo) {
  const RangeServer server(folder_.path());
  const RemoteOptions remote{.cache_folder = {}, .stall_seconds = 2, .tries = 2};
  const std::string url = server.url("good/" + std::filesystem::path(path_).filename().string());
  const auto pyramid = [&] { return Pyramid(url, 1 << 20, FileAccess::kMap, remote); };
  if (GetParam().is_index) return;  // a server may not name a file of this machine
  const std::uint64_t mesh = meshOfKind(pyramid());
  std::size_t tried = 0;
  for (const std::string& file : filesOfPyramid(path_)) {
    const std::string good = readBytes(file);
    tried += forSomeDamages(good, 12, [&](std::size_t number) {
      SCOPED_TRACE(file + ", damage " + std::to_string(number));
      writeBytes(file, damaged(good, number));
      EXPECT_TRUE(isFoundByVerify(url, remote));
      expectErrorOrRight(answerOf([&] { return meshOfKind(pyramid()); }), mesh);
    });
    writeBytes(file, good);
  }
  std::printf("%s: %zu damages behind a URL\n", GetParam().name, tried);
}

INSTANTIATE_TEST_SUITE_P(Kinds, EveryByte, testing::ValuesIn(kPyramidKinds),
                         [](const auto& kind) { return std::string(kind.param.name); });

}  // namespace
}  // namespace isobrick::test
