// Extractions in which a call to the system fails, whichever it is: an error, and the next query on
// the same objects is whole.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <filesystem>
#include <optional>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/faults/fault_points.h"
#include "tests/faults/fault_sweep.h"
#include "tests/support/child_process.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

struct QueryCase {
  const char* name;
  format::Codec codec = format::Codec::kStored;
  FileAccess access = FileAccess::kMap;
  bool is_adaptive = false;
  const char* file = nullptr;  // of the mesh; in memory without
  bool through_sink = false;   // in memory, but not in place
  bool is_packed = false;      // the file
};

// A mesh in memory as a number.
std::uint64_t hashOf(const SurfaceMesh& mesh) {
  return checksum64(mesh.triangles().data(), mesh.triangles().size_bytes(),
                    checksum64(mesh.positions().data(), mesh.positions().size_bytes()));
}
std::uint64_t hashOf(const IndexedMesh& mesh) {
  return checksum64(
      mesh.triangles.data(), mesh.triangles.size() * sizeof mesh.triangles[0],
      checksum64(mesh.positions.data(), mesh.positions.size() * sizeof mesh.positions[0]));
}

Query queryOf(bool is_adaptive) {
  Query query;
  query.isovalue = 500;
  if (is_adaptive) {
    query.focus = FocusSphere{glm::dvec3(20, 18, 15), 6};
    query.curvature_tolerance = 0.01;
  }
  return query;
}

class QuerySubject : public FaultSubject {
 public:
  QuerySubject(const QueryCase& how, const std::string& pyramid, const std::string& folder,
               std::uint64_t expected)
      : how_(how),
        folder_(folder),
        expected_(expected),
        pyramid_(pyramid, Pyramid::kDefaultBudgetBytes, how.access),
        extractor_(pyramid_) {}

  void attempt() override { is_other_ = extract() != expected_; }
  std::string afterwards() override {
    if (is_other_) return "the query gave another mesh, and no error";
    if (std::filesystem::exists(path()) && readHash() != expected_)
      return "half a mesh has the name of a whole one";
    std::filesystem::remove(path());
    for (const auto& left : std::filesystem::directory_iterator(folder_))
      return "is left behind: " + left.path().filename().string();
    return extract() == expected_ ? "" : "the next query gives another mesh";
  }
  std::uint64_t extract() {
    const Query query = queryOf(how_.is_adaptive);
    if (how_.file != nullptr) {
      {
        const auto sink =
            makeMeshFileSink(path(), {.zlib = how_.is_packed && how_.file[0] == 'v',
                                      .meshopt = how_.is_packed && how_.file[0] == 'g'});
        extractor_.extract(query, *sink);
      }
      disarmFaults();
      const std::uint64_t hash = readHash();
      std::filesystem::remove(path());
      return hash;
    }
    if (how_.through_sink) {
      IndexedMeshSink sink;
      extractor_.extract(query, sink);
      return hashOf(sink.mesh());
    }
    extractor_.extract(query, mesh_);
    return hashOf(mesh_);
  }

 private:
  std::string path() const {
    return folder_ + "/mesh." + (how_.file != nullptr ? how_.file : "none");
  }
  std::uint64_t readHash() const {
    const std::string bytes = readBytes(path());
    return checksum64(bytes.data(), bytes.size());
  }

  const QueryCase& how_;
  const std::string folder_;
  const std::uint64_t expected_;
  const Pyramid pyramid_;
  Extractor extractor_;
  SurfaceMesh mesh_;
  bool is_other_ = false;
};

// Answers from what is resident, until all is.
class ProgressiveSubject : public FaultSubject {
 public:
  ProgressiveSubject(const std::string& pyramid, std::uint64_t expected)
      : expected_(expected), pyramid_(pyramid), extractor_(pyramid_) {}

  void attempt() override { is_other_ = refine() && hashOf(mesh_) != expected_; }
  std::string afterwards() override {
    if (is_other_) return "a complete answer was another mesh";
    if (!refine()) return "the next progressive queries do not end complete";
    return hashOf(mesh_) == expected_ ? "" : "the next query gives another mesh";
  }
  // True if the mesh is complete.
  bool refine() {
    Query query = queryOf(true);
    query.is_progressive = true;
    for (int times = 0; times < 1000; ++times) {
      if (extractor_.extract(query, mesh_).is_complete) return true;
      if (!extractor_.waitForBricks(std::chrono::milliseconds(50))) return false;
    }
    return false;
  }

 private:
  const std::uint64_t expected_;
  const Pyramid pyramid_;
  Extractor extractor_;
  SurfaceMesh mesh_;
  bool is_other_ = false;
};

class OpenSubject : public FaultSubject {
 public:
  explicit OpenSubject(std::string path) : path_(std::move(path)) {}
  void attempt() override { lookAtAll(); }
  std::string afterwards() override { return lookAtAll() ? "" : "the file is said to be damaged"; }
  // True if the file is good.
  bool lookAtAll() const {
    const Pyramid pyramid(path_);
    bool is_good = pyramid.histogram().bins() > 0;
    for (std::size_t row = 0; row < pyramid.brickCount(); row += 7) {
      const auto [level, brick] = pyramid.parts().brickAt(row);
      is_good = !verifyBrick(pyramid, level, brick) && is_good;
    }
    return verifyRest(pyramid).empty() && is_good;
  }

 private:
  const std::string path_;
};

class QueryFaults : public testing::Test {
 protected:
  // In a child: this process starts no thread.
  std::string build(format::Codec codec) {
    const std::string path = folder_.file("head.isb");
    expectChildLeavesWith(0, [&] {
      BuildOptions options;
      options.brick_cells = 8;
      options.codec = codec;
      buildPyramid(*makePhantomSource(PhantomSpec{"head", 40, {}, 16}), path, options);
      return 0;
    });
    return path;
  }
  std::string outFolder() {
    const std::string out = folder_.file("out");
    std::filesystem::create_directory(out);
    return out;
  }
  void sweep(const QueryCase& how) {
    const std::string pyramid = build(how.codec), out = outFolder();
    std::optional<std::uint64_t> expected;  // by each child
    sweepFaults(how.name, [&]() -> std::unique_ptr<FaultSubject> {
      if (!expected) expected = QuerySubject(how, pyramid, out, 0).extract();
      return std::make_unique<QuerySubject>(how, pyramid, out, *expected);
    });
  }

  const TemporaryFolder folder_;
};

constexpr format::Codec kZstd = format::Codec::kZstd;

TEST_F(QueryFaults, UniformInPlace) { sweep({.name = "uniform, mapped"}); }
TEST_F(QueryFaults, UniformInPlacePacked) { sweep({.name = "uniform, packed", .codec = kZstd}); }
TEST_F(QueryFaults, UniformWithoutAMap) {
  sweep({.name = "uniform, --no-map", .access = FileAccess::kRead});
}
TEST_F(QueryFaults, UniformThroughASink) {
  sweep({.name = "uniform, sink", .codec = kZstd, .through_sink = true});
}
TEST_F(QueryFaults, AdaptiveInMemory) {
  sweep({.name = "adaptive, memory", .codec = kZstd, .is_adaptive = true});
}
TEST_F(QueryFaults, AdaptiveThroughASink) {
  sweep({.name = "adaptive, sink", .is_adaptive = true, .through_sink = true});
}
TEST_F(QueryFaults, FilesOfAllFormats) {
  for (const QueryCase& how :
       {QueryCase{.name = "uniform, .ply", .file = "ply"},
        QueryCase{.name = "adaptive, .stl", .is_adaptive = true, .file = "stl"},
        QueryCase{.name = "uniform, .obj", .file = "obj"},
        QueryCase{.name = "uniform, .glb", .file = "glb"},
        QueryCase{
            .name = "adaptive, packed .glb", .is_adaptive = true, .file = "glb", .is_packed = true},
        QueryCase{.name = "adaptive, .vtp", .is_adaptive = true, .file = "vtp"},
        QueryCase{.name = "uniform, packed .vtp", .file = "vtp", .is_packed = true}})
    sweep(how);
}
TEST_F(QueryFaults, ProgressiveQueries) {
  for (const format::Codec codec : {format::Codec::kStored, kZstd}) {
    const std::string pyramid = build(codec);
    std::optional<std::uint64_t> expected;
    sweepFaults(codec == kZstd ? "progressive, packed" : "progressive, mapped",
                [&]() -> std::unique_ptr<FaultSubject> {
                  if (!expected) {
                    SurfaceMesh mesh;
                    extractIsosurface(Pyramid(pyramid), queryOf(true), mesh);
                    expected = hashOf(mesh);
                  }
                  return std::make_unique<ProgressiveSubject>(pyramid, *expected);
                });
  }
}
TEST_F(QueryFaults, OpeningAndVerifying) {
  const std::string pyramid = build(kZstd);
  sweepFaults("open and verify", [&] { return std::make_unique<OpenSubject>(pyramid); });
}

}  // namespace
}  // namespace isobrick::test
