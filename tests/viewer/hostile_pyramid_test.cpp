// Whatever a sealed file says, it is refused, or meshed, or drawn: never more. Sanitizers see the
// rest, so the long run belongs into the asan-ubsan build:
//
//   ISOBRICK_HOSTILE_PYRAMIDS=100000 isobrick_viewer_tests --gtest_filter='HostilePyramid.*'
//
// ISOBRICK_HOSTILE_SEED is the first seed (1), and the next are counted from there; a failure names
// its seed.
#include "tests/support/hostile_pyramid.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <memory>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/array_source.h"
#include "tests/support/mesh_picture.h"
#include "tests/support/plain_reader.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Said by the sanitizers' last words too.
std::uint64_t g_seed = 0;

#if defined(__SANITIZE_ADDRESS__)
extern "C" void __sanitizer_set_death_callback(void (*callback)());
void nameSeedAtDeath() {
  __sanitizer_set_death_callback([] { std::fprintf(stderr, "hostile seed %lu\n", g_seed); });
}
#else
void nameSeedAtDeath() {}
#endif

std::uint64_t numberFrom(const char* variable, std::uint64_t otherwise) {
  const char* const text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

template <typename T>
Bytes buildGood(const TemporaryFolder& folder, Random& random) {
  Index3 dims;
  for (int axis = 0; axis < 3; ++axis) dims[axis] = randomInt(random, 2, 20);
  const std::uint64_t field = randomBelow(random, 4);
  const glm::dvec3 center(randomReal(random, 0, 20), randomReal(random, 0, 20),
                          randomReal(random, 0, 20));
  GridGeometry geometry;
  for (int axis = 0; axis < 3; ++axis) {
    geometry.spacing[axis] = randomReal(random, 0.1, 3);
    geometry.origin[axis] = randomReal(random, -100, 100);
  }
  if (random() % 2 == 0) geometry.direction[0] *= -1.0;
  ArraySource<T> source(
      dims,
      arrayOfField<T>(dims,
                      [&](const Index3& at) {
                        const double r = glm::distance(glm::dvec3(at), center);
                        if (field == 0) return static_cast<double>(random() % 100);
                        if (field == 1) return std::min(100.0, 8 * r);
                        if (field == 2) return r < 9 ? 20.0 : static_cast<double>(random() % 120);
                        return 60 + 40 * std::sin(r) + static_cast<double>(random() % 8);
                      }),
      geometry);
  BuildOptions options;
  options.brick_cells = std::int64_t{4} << randomBelow(random, 3);
  do options.tile_cells = std::int64_t{2} << randomBelow(random, 4);
  while (options.tile_cells > options.brick_cells);
  constexpr format::Codec kCodecs[] = {format::Codec::kStored, format::Codec::kLz4,
                                       format::Codec::kZstd};
  options.codec = kCodecs[randomBelow(random, 3)];
  options.filter = random() % 2 == 0 ? format::Filter::kAverage : format::Filter::kSubsample;
  options.with_curvature = random() % 4 != 0;
  const std::string path = folder.file("good.isb");
  buildPyramid(source, path, options);
  return readWholeFile(path);
}

// Good pyramids to begin with, each made when it is first wanted.
class GoodPyramids {
 public:
  const Bytes& of(std::uint64_t seed) {
    const std::uint64_t number = seed % kCount;
    Bytes& bytes = bytes_[number];
    if (bytes.empty()) {
      Random random(number);
      bytes = visitVoxelType(static_cast<VoxelType>(number % kVoxelTypeCount), [&](auto tag) {
        return buildGood<typename decltype(tag)::Type>(folder_, random);
      });
    }
    return bytes;
  }

 private:
  static constexpr std::uint64_t kCount = 500;
  TemporaryFolder folder_;
  std::map<std::uint64_t, Bytes> bytes_;
};

Query anyQuery(const Pyramid& pyramid, Random& random) {
  Query query;
  const ValueRange& values = pyramid.valueRange();
  const std::uint64_t way = randomBelow(random, 8);
  const bool may_be_refused = randomBelow(random, 20) == 0;
  if (way == 0) do
      query.isovalue = static_cast<double>(nastyFloat(random));
    while (!std::isfinite(query.isovalue) && !may_be_refused);
  else if (way == 1)
    query.isovalue = may_be_refused ? 1e300 : static_cast<double>(values.max);
  else if (way < 5)
    query.isovalue = randomReal(random, 0, 100);
  else
    query.isovalue = static_cast<double>(values.min) +
                     randomReal(random, 0, 1) *
                         (static_cast<double>(values.max) - static_cast<double>(values.min));
  const glm::dvec3 last(pyramid.spec().voxels - Index3(1));
  const auto anyPoint = [&] {
    return glm::dvec3(randomReal(random, -1, last.x + 1), randomReal(random, -1, last.y + 1),
                      randomReal(random, -1, last.z + 1));
  };
  switch (randomBelow(random, 5)) {
    case 0:
      break;
    case 1:
      query.uniform_level = static_cast<int>(
          randomInt(random, 0, pyramid.lattice().levels() - (may_be_refused ? 0 : 1)));
      break;
    default:
      query.focus = FocusSphere{anyPoint(), randomReal(random, 0, 6)};
  }
  const bool may_tolerate =
      may_be_refused || (pyramid.spec().has_curvature && query.uniform_level.value_or(0) == 0);
  if (may_tolerate && randomBelow(random, 3) != 0)
    query.curvature_tolerance = std::exp2(randomReal(random, -12, 4));
  if (randomBelow(random, 4) == 0) {
    const glm::dvec3 a = anyPoint(), b = anyPoint();
    query.box = QueryBox{glm::min(a, b), glm::max(a, b)};
  }
  query.cull_by_ranges = randomBelow(random, 4) != 0;
  return query;
}

// How many files came to which end.
struct Tally {
  std::uint64_t files = 0, opened = 0, faulty = 0, meshes = 0, empty = 0, errors = 0, pictures = 0;
  std::uint64_t meshed_files = 0, files_with_errors = 0;
  double slowest_seconds = 0;
  std::uint64_t slowest_seed = 0;
  std::map<std::string, std::uint64_t> reasons;  // by text, without names and numbers
};

std::string reasonOf(std::string text) {
  for (std::size_t quote = text.find('\''); quote != std::string::npos;) {
    const std::size_t end = text.find('\'', quote + 1);
    if (end == std::string::npos) break;
    text.erase(quote, end + 1 - quote);
    quote = text.find('\'', quote);
  }
  std::erase_if(text, [](char c) { return c >= '0' && c <= '9'; });
  return text.substr(0, 100);
}

class Harness {
 public:
  void run(std::uint64_t seed) {
    g_seed = seed;
    Random random(seed);
    std::string changes;
    const Bytes bytes = makeHostilePyramid(good_.of(seed), random, changes);
    SCOPED_TRACE("seed " + std::to_string(seed) + ": " + changes);
    const std::string path = folder_.file("hostile.isb");
    std::ofstream(path, std::ios::binary | std::ios::trunc)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    const auto begin = std::chrono::steady_clock::now();
    ++tally_.files;
    try {
      const Pyramid pyramid(path, random() % 2 == 0 ? 1 << 20 : 1 << 12);
      ++tally_.opened;
      verify(pyramid);
      const std::uint64_t meshes = tally_.meshes, errors = tally_.errors;
      for (int sink = 0; sink < 4; ++sink) extract(pyramid, sink, random);
      tally_.meshed_files += tally_.meshes > meshes ? 1 : 0;
      tally_.files_with_errors += tally_.errors > errors ? 1 : 0;
    } catch (const Error& error) {
      note("open", error);
    }
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    if (seconds > tally_.slowest_seconds) {
      tally_.slowest_seconds = seconds;
      tally_.slowest_seed = seed;
    }
  }

  void report() const {
    std::printf(
        "%lu files: %lu opened, of them %lu faulty to verify, %lu meshed, %lu with an Error while "
        "meshing\n%lu queries with triangles, %lu without, %lu Errors; %lu pictures\n"
        "slowest %.2f s (seed %lu)\n",
        tally_.files, tally_.opened, tally_.faulty, tally_.meshed_files, tally_.files_with_errors,
        tally_.meshes, tally_.empty, tally_.errors, tally_.pictures, tally_.slowest_seconds,
        tally_.slowest_seed);
    for (const auto& [reason, count] : tally_.reasons)
      std::printf("%8lu  %s\n", count, reason.c_str());
  }
  const Tally& tally() const { return tally_; }

 private:
  void note(const char* stage, const Error& error) {
    const std::string text = error.what();
    EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    EXPECT_FALSE(text.empty());
    ++tally_.reasons[std::string(stage) + ": " + reasonOf(text)];
  }

  void verify(const Pyramid& pyramid) {
    std::string first;
    for (const std::string& fault : verifyRest(pyramid)) first = first.empty() ? fault : first;
    for (int level = 0; level < pyramid.lattice().levels(); ++level) {
      const Index3 bricks = pyramid.layout().bricks(level);
      for (std::int64_t i = 0; i < elementCount(bricks); ++i)
        if (const auto damage = verifyBrick(
                pyramid, level,
                Index3(i % bricks.x, i / bricks.x % bricks.y, i / (bricks.x * bricks.y))))
          if (first.empty()) first = damage->what;
    }
    if (first.empty()) return;
    ++tally_.faulty;
    ++tally_.reasons["verify: " + reasonOf(first)];
  }

  void extract(const Pyramid& pyramid, int which, Random& random) {
    const Query query = anyQuery(pyramid, random);
    try {
      CountingSink counting;
      IndexedMeshSink indexed;
      std::unique_ptr<MeshFileSink> file;
      // Another format each time; the values at the vertices are the pyramid's own.
      const PyramidValues values(pyramid);
      const std::string path = folder_.file(kMeshNames[next_name_ % std::size(kMeshNames)]);
      if (which > 1) {
        const bool has_values = next_name_++ % std::size(kMeshNames) >= kFirstWithValues;
        MeshFileOptions options;
        if (has_values) options.attributes.push_back({.values = &values});
        file = makeMeshFileSink(path, options);
      }
      TriangleSink& sink = which == 0   ? static_cast<TriangleSink&>(counting)
                           : which == 1 ? static_cast<TriangleSink&>(indexed)
                                        : *file;
      const ExtractionReport report = extractIsosurface(pyramid, query, sink);
      ++(report.triangles > 0 ? tally_.meshes : tally_.empty);
      if (which == 0) {
        EXPECT_EQ(counting.triangles(), report.triangles);
      } else if (which == 1) {
        check(indexed.mesh());
        draw(pyramid, indexed.mesh(), random);
      } else {
        EXPECT_GT(std::filesystem::file_size(path), 12 * report.triangles);
      }
    } catch (const Error& error) {
      ++tally_.errors;
      note("extract", error);
    }
  }

  static constexpr const char* kMeshNames[] = {"mesh.stl", "mesh.obj", "mesh.ply", "mesh.glb",
                                               "mesh.vtp"};
  static constexpr std::size_t kFirstWithValues = 2;
  std::size_t next_name_ = 0;

  static void check(const IndexedMesh& mesh) {
    EXPECT_EQ(mesh.positions.size(), mesh.normals.size());
    EXPECT_EQ(mesh.triangles.size(), 3 * mesh.triangle_levels.size());
    std::uint64_t wrong = 0;
    for (const std::uint32_t index : mesh.triangles) wrong += index >= mesh.positions.size();
    EXPECT_EQ(wrong, 0u) << "indices";
    for (const glm::dvec3& p : mesh.positions)
      wrong += !std::isfinite(static_cast<float>(p.x)) || !std::isfinite(static_cast<float>(p.y)) ||
               !std::isfinite(static_cast<float>(p.z));
    EXPECT_EQ(wrong, 0u) << "positions";
    for (const glm::vec3& n : mesh.normals) wrong += !(std::abs(glm::dot(n, n) - 1.0f) < 1e-3f);
    EXPECT_EQ(wrong, 0u) << "normals";
  }

  // As `isobrick render` does.
  void draw(const Pyramid& pyramid, const IndexedMesh& mesh, Random& random) {
    if (mesh.triangles.empty() && random() % 8 != 0) return;
    const glm::dvec3 center =
        pyramid.spec().geometry.indexToWorld(glm::dvec3(pyramid.spec().voxels - Index3(1)) / 2.0);
    std::vector<glm::vec3> positions;
    for (const glm::dvec3& p : mesh.positions) positions.emplace_back(p - center);
    MeshLook look;
    look.width = 24;
    look.height = 16;
    if (random() % 2 == 0) look.view.coloring = ViewColoring::kLevel;
    look.view.wireframe = random() % 2 == 0;
    if (!renderer_) renderer_ = std::make_unique<OffscreenRenderer>();
    const bool with_normals = random() % 4 != 0;
    const std::vector<glm::vec3> normals = with_normals ? mesh.normals : std::vector<glm::vec3>();
    const Image image = pictureOf(
        *renderer_, surfaceOf(positions, normals, mesh.triangles, mesh.triangle_levels), look);
    EXPECT_EQ(image.rgb.size(), 3u * 24 * 16);
    ++tally_.pictures;
  }

  GoodPyramids good_;
  TemporaryFolder folder_;
  std::unique_ptr<OffscreenRenderer> renderer_;  // a context takes 0.1 s, so one for all
  Tally tally_;
};

std::uint64_t greatestResidentBytes() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return 1024 * static_cast<std::uint64_t>(usage.ru_maxrss);
}

TEST(HostilePyramid, IsRefusedOrMeshedOrDrawn) {
  const std::uint64_t count = numberFrom("ISOBRICK_HOSTILE_PYRAMIDS", 300);
  const std::uint64_t first = numberFrom("ISOBRICK_HOSTILE_SEED", 1);
  nameSeedAtDeath();
  Harness harness;
  const std::uint64_t memory_before = greatestResidentBytes();
  for (std::uint64_t seed = first; seed < first + count && !HasFailure(); ++seed) harness.run(seed);
  harness.report();
  EXPECT_LT(greatestResidentBytes() - memory_before, std::uint64_t{1} << 30);
  // The changes must reach deep: a file that does not open shows little.
  const Tally& tally = harness.tally();
  if (tally.files < 100 || HasFailure()) return;
  EXPECT_GT(tally.opened, tally.files / 2);
  EXPECT_GT(tally.meshed_files, tally.files / 4);
  EXPECT_GT(tally.files_with_errors, tally.files / 20);
  EXPECT_GT(tally.pictures, tally.files / 10);
}

}  // namespace
}  // namespace isobrick::test
