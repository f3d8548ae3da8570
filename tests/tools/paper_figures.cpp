// Figures of docs/PAPER.md that the command cannot make, as one JSON object, with pictures if
// wanted:
//
//   paper_figures meshes FILE.isb --iso V ...  triangles of marching cubes on level 0, of fans, of
//                                              leaves with cracks, and of the conforming split
//   paper_figures cells FILE.isb --at X,Y,Z    curvature samples of nodes and their polynomials
//   paper_figures frames FILE.isb ...          times of random frames around a focus
//
// tools/reproduce.sh runs it.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <iostream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/stream/chunk_sink.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/mesh_picture.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/reference_mesher.h"
#include "tests/support/reference_pyramid.h"
#include "tests/support/split_meshes.h"
#include "tests/support/trilinear_cell.h"

namespace isobrick::test {
namespace {

using nlohmann::json;

Index3 index3(const PlainIndex& index) { return {index[0], index[1], index[2]}; }
glm::dvec3 vector3(const std::vector<double>& numbers) {
  return {numbers.at(0), numbers.at(1), numbers.at(2)};
}

ReferencePyramid referencePyramidOf(const PlainPyramid& plain) {
  ReferencePyramid pyramid{Lattice(index3(plain.dims)), {}};
  for (int level = 0; level < pyramid.lattice.levels(); ++level)
    pyramid.levels.emplace_back(
        static_cast<std::size_t>(elementCount(pyramid.lattice.samples(level))));
  for (const PlainBrick& brick : plain.bricks) {
    const Index3 samples = pyramid.lattice.samples(brick.level);
    std::size_t i = 0;
    for (std::int64_t z = 0; z < brick.count[2]; ++z)
      for (std::int64_t y = 0; y < brick.count[1]; ++y)
        for (std::int64_t x = 0; x < brick.count[0]; ++x)
          pyramid.levels[static_cast<std::size_t>(brick.level)][static_cast<std::size_t>(
              ((brick.first_sample[2] + z) * samples.y + brick.first_sample[1] + y) * samples.x +
              brick.first_sample[0] + x)] = brick.samples[i++];
  }
  return pyramid;
}

// The curvature bound of a cell of level 1: its block's range of values, and the stored bytes.
struct StoredBound {
  PlainRange range;
  const std::uint8_t* codes = nullptr;
};

StoredBound storedBound(const PlainPyramid& plain, const Index3& level1_cell) {
  const std::int64_t edge = plainBlockCells(plain);
  PlainIndex brick_index{}, block{};
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    brick_index[a] = 2 * level1_cell[axis] / plain.brick_cells;
    block[a] = 2 * level1_cell[axis] % plain.brick_cells / edge;
  }
  const PlainBrick& brick = plain.brickAt(0, brick_index);
  const auto number = (block[2] * brick.blocks[1] + block[1]) * brick.blocks[0] + block[0];
  return {plainBlockRange(plain, brick, block), brick.codes.data() + 8 * number};
}

// ---- Meshes -------------------------------------------------------------------------------------

struct MeshArguments {
  std::string file;
  double iso = 0, radius = 0;
  std::vector<double> focus;
  double curvature = -1;  // tolerance; below 0: no curvature oracle
  // Pictures: NAME-cracks.png, NAME-fans.png, NAME-split.png, NAME-uniform.png.
  std::string pictures;
  std::vector<double> box;  // of the close-up, voxel indices
  MeshLook look;
};

struct DrawnMesh {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> triangles;
  std::vector<std::uint8_t> levels;
};

DrawnMesh drawnMesh(const ReferenceMesh& mesh) {
  return {
      mesh.positions, mesh.triangles, {mesh.triangle_levels.begin(), mesh.triangle_levels.end()}};
}
DrawnMesh drawnMesh(const SplitMesh& mesh) {
  return {mesh.positions, mesh.triangles, mesh.triangle_levels};
}

void draw(const std::string& path, const DrawnMesh& mesh, const MeshArguments& arguments) {
  static OffscreenRenderer renderer;
  MeshLook look = arguments.look;
  look.width = 400;
  look.height = 320;
  look.view.wireframe = true;
  look.view.coloring = ViewColoring::kLevel;
  if (!arguments.box.empty()) {
    const std::vector<double>& box = arguments.box;
    look.frame = WorldBox{vector3(box), vector3({box.at(3), box.at(4), box.at(5)})};
  }
  const std::vector<glm::vec3> positions(mesh.positions.begin(), mesh.positions.end());
  writeImage(path,
             pictureOf(renderer, surfaceOf(positions, {}, mesh.triangles, mesh.levels), look));
}

json reportOf(const DrawnMesh& mesh, const Index3& voxels) {
  const MeshReport report = checkMesh(mesh.positions, mesh.triangles, indexOptions(voxels));
  return {{"triangles", report.triangles}, {"open_edges", report.open_edges}, {"ok", report.ok()}};
}

json compareMeshes(const MeshArguments& arguments) {
  const PlainPyramid plain = readPlainPyramid(arguments.file);
  const ReferencePyramid pyramid = referencePyramidOf(plain);
  ReferenceQuery query;
  query.iso = arguments.iso;
  if (!arguments.focus.empty()) query.focus = vector3(arguments.focus);
  query.radius = arguments.radius;
  if (arguments.curvature >= 0)
    query.flat = [&](const Index3& cell) {
      const StoredBound bound = storedBound(plain, cell);
      return plainDeviationBound(bound.codes, bound.range, arguments.iso) <=
             1.5 * std::sqrt(2 * arguments.curvature);
    };
  const LeafLevels leaves = referenceLeafLevels(pyramid.lattice, query);
  ReferenceQuery finest;
  finest.iso = arguments.iso;

  json result;
  const auto add = [&](const char* name, const DrawnMesh& mesh) {
    result[name] = reportOf(mesh, pyramid.lattice.voxels());
    if (!arguments.pictures.empty())
      draw(arguments.pictures + "-" + name + ".png", mesh, arguments);
  };
  add("uniform", drawnMesh(referenceMesh(pyramid, finest)));
  const ReferenceMesh fans = referenceMesh(pyramid, leaves, arguments.iso);
  add("fans", drawnMesh(fans));
  result["fans"]["cells"] = fans.transitionCellCount();
  add("cracks", drawnMesh(crackedMesh(pyramid, leaves, arguments.iso)));
  const SplitMesh split = conformingSplitMesh(pyramid, leaves, arguments.iso);
  add("split", drawnMesh(split));
  result["split"]["leaves"] = split.split_leaves;
  result["split"]["triangles_in_split_leaves"] = split.split_triangles;
  return result;
}

// ---- Curvature samples (Sect. 5.2, Figure 7) ----------------------------------------------------

struct CurvatureSample {
  double value = 0, curvature = 0;
};

// The paper's update for every sample: a quadratic in Bernstein form over `range`, never below one.
std::array<double, 3> fitQuadratic(const std::vector<CurvatureSample>& samples,
                                   const PlainRange& range) {
  std::array<double, 3> b{};
  const double low = static_cast<double>(range.min), high = static_cast<double>(range.max);
  for (const CurvatureSample& sample : samples) {
    const double t = (sample.value - low) / (high - low);
    const std::array<double, 3> basis = {(1 - t) * (1 - t), 2 * t * (1 - t), t * t};
    double p = 0, squares = 0;
    for (std::size_t j = 0; j < 3; ++j) {
      p += b[j] * basis[j];
      squares += basis[j] * basis[j];
    }
    if (p < sample.curvature)
      for (std::size_t j = 0; j < 3; ++j) b[j] += (sample.curvature - p) * basis[j] / squares;
  }
  return b;
}

// A node, the eight unit cubes in it, and `per_edge` samples on each edge of each.
json sampleNode(const PlainPyramid& plain, const ReferencePyramid& pyramid, const Index3& node,
                int per_edge) {
  const PlainRange range = storedBound(plain, node).range;
  const double least =
      plain.curvature_epsilon * (static_cast<double>(range.max) - static_cast<double>(range.min));
  std::vector<CurvatureSample> counted;
  json points = json::array(), left_out = json::array();
  PlainRange own{pyramid.sampleAt(0, node * Index3(2)), pyramid.sampleAt(0, node * Index3(2))};
  for (int c = 0; c < 8; ++c) {
    const Index3 cell = node * Index3(2) + Index3(c & 1, c >> 1 & 1, c >> 2);
    TrilinearCell trilinear;
    for (int i = 0; i < 8; ++i) {
      const float value = pyramid.sampleAt(0, cell + Index3(i & 1, i >> 1 & 1, i >> 2));
      own = {std::min(own.min, value), std::max(own.max, value)};
      trilinear.corners[static_cast<std::size_t>(i)] = static_cast<double>(value);
    }
    for (int edge = 0; edge < 12; ++edge)
      for (int s = 0; s < per_edge; ++s) {
        glm::dvec3 p;
        p[edge / 4] = (s + 0.5) / per_edge;
        p[(edge / 4 + 1) % 3] = edge & 1;
        p[(edge / 4 + 2) % 3] = edge >> 1 & 1;
        const double gradient = glm::length(trilinear.gradient(p));
        if (!(gradient > 0)) continue;
        const CurvatureSample sample{trilinear.value(p), trilinear.totalCurvatureAt(p)};
        (gradient >= least ? points : left_out).push_back({sample.value, sample.curvature});
        if (gradient >= least) counted.push_back(sample);
      }
  }
  if (!(own.min < own.max)) throw std::runtime_error("a node whose voxels are all equal");
  return {{"cell", {2 * node.x, 2 * node.y, 2 * node.z}},
          {"samples", points},
          {"left_out", left_out},
          {"own_range", {own.min, own.max}},
          {"own", fitQuadratic(counted, own)}};
}

json sampleNodes(const std::string& file, const std::vector<std::vector<std::int64_t>>& places,
                 int per_edge) {
  const PlainPyramid plain = readPlainPyramid(file);
  const ReferencePyramid pyramid = referencePyramidOf(plain);
  json nodes = json::array();
  for (const std::vector<std::int64_t>& at : places)
    nodes.push_back(
        sampleNode(plain, pyramid, Index3(at.at(0), at.at(1), at.at(2)) >> Index3(1), per_edge));
  return nodes;
}

// ---- Frames (Sect. 7) ---------------------------------------------------------------------------

struct FrameArguments {
  std::string file;
  double least = 0, greatest = 0;  // isovalues
  std::uint64_t triangles = 50000;
  int frames = 100;
  bool is_drawn = true;
};

double quantile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values.at(static_cast<std::size_t>(part * static_cast<double>(values.size() - 1)));
}

// The radius around the query's focus at which the surface has about so many triangles.
double radiusFor(Extractor& extractor, Query query, std::uint64_t triangles) {
  double low = 0, high = 512;
  while (high - low > 0.25) {
    query.focus->radius = 0.5 * (low + high);
    CountingSink sink;
    (extractor.extract(query, sink).triangles < triangles ? low : high) = query.focus->radius;
  }
  return high;
}

// Each frame has another focus point, and another isovalue if `least` < `greatest`.
json timeFrames(const FrameArguments& arguments) {
  const Pyramid pyramid(arguments.file, std::uint64_t{1} << 30);
  Extractor extractor(pyramid);
  Random random(1);
  std::vector<Query> queries;
  for (int i = 0; i < arguments.frames; ++i) {
    Query& query = queries.emplace_back();
    query.isovalue = arguments.least < arguments.greatest
                         ? randomReal(random, arguments.least, arguments.greatest)
                         : arguments.least;
    glm::dvec3 focus;
    for (int axis = 0; axis < 3; ++axis)
      focus[axis] =
          randomReal(random, 0.35, 0.65) * static_cast<double>(pyramid.spec().voxels[axis]);
    query.focus = FocusSphere{focus, 0};
    query.focus->radius = radiusFor(extractor, query, arguments.triangles);
  }

  using Clock = std::chrono::steady_clock;
  const auto milliseconds = [](Clock::duration d) {
    return std::chrono::duration<double, std::milli>(d).count();
  };
  OffscreenRenderer renderer;
  MeshLook look;
  look.width = 640;
  look.height = 480;
  std::vector<double> triangles, extract_ms, draw_ms;
  for (const Query& query : queries) {
    DrawableSurface surface;
    surface.volume.voxels = pyramid.spec().voxels;
    surface.volume.geometry = pyramid.spec().geometry;
    std::mutex mutex;
    ChunkSink sink({}, {}, [&](std::size_t, SurfaceChunk&& chunk) {
      const std::lock_guard lock(mutex);
      surface.chunks.push_back(std::move(chunk));
    });
    const Clock::time_point begin = Clock::now();
    triangles.push_back(static_cast<double>(extractor.extract(query, sink).triangles));
    const Clock::time_point extracted = Clock::now();
    extract_ms.push_back(milliseconds(extracted - begin));
    if (!arguments.is_drawn) continue;
    pictureOf(renderer, std::move(surface), look);
    draw_ms.push_back(milliseconds(Clock::now() - extracted));
  }
  json result = {{"frames", arguments.frames},
                 {"triangles", quantile(triangles, 0.5)},
                 {"extract_ms", quantile(extract_ms, 0.5)},
                 {"extract_ms_p99", quantile(extract_ms, 0.99)},
                 {"device", renderer.deviceName()}};
  if (arguments.is_drawn) result["draw_ms"] = quantile(draw_ms, 0.5);
  return result;
}

int run(int argc, char** argv) {
  CLI::App app("What docs/PAPER.md shows and the command cannot make");
  app.require_subcommand(1);

  MeshArguments meshes;
  CLI::App& meshes_app = *app.add_subcommand("meshes", "Fans, cracks and the conforming split");
  meshes_app.add_option("FILE", meshes.file)->required();
  meshes_app.add_option("--iso", meshes.iso)->required();
  meshes_app.add_option("--focus", meshes.focus, "Voxel indices")->delimiter(',')->expected(3);
  meshes_app.add_option("--radius", meshes.radius, "In voxels");
  meshes_app.add_option("--curvature", meshes.curvature, "Tolerance");
  meshes_app.add_option("--pictures", meshes.pictures, "NAME of NAME-cracks.png and the others");
  meshes_app.add_option("--box", meshes.box, "Of a close-up: voxel indices")
      ->delimiter(',')
      ->expected(6);
  meshes_app.add_option("--azimuth", meshes.look.view.camera.azimuth);
  meshes_app.add_option("--elevation", meshes.look.view.camera.elevation);

  std::string cells_file;
  std::vector<std::vector<std::int64_t>> places;
  int per_edge = 10;
  CLI::App& cells_app = *app.add_subcommand("cells", "Curvature samples and their polynomials");
  cells_app.add_option("FILE", cells_file)->required();
  cells_app.add_option("--at", places, "A voxel in the node")->delimiter(',')->required();
  cells_app.add_option("--per-edge", per_edge);

  FrameArguments frames;
  CLI::App& frames_app = *app.add_subcommand("frames", "Times of random frames around a focus");
  frames_app.add_option("FILE", frames.file)->required();
  frames_app.add_option("--least", frames.least, "Isovalue")->required();
  frames_app.add_option("--greatest", frames.greatest, "Isovalue")->required();
  frames_app.add_option("--triangles", frames.triangles, "Of each frame, about");
  frames_app.add_option("--frames", frames.frames);
  frames_app.add_option("--drawn", frames.is_drawn);

  CLI11_PARSE(app, argc, argv);
  const json result = meshes_app.parsed()  ? compareMeshes(meshes)
                      : cells_app.parsed() ? sampleNodes(cells_file, places, per_edge)
                                           : timeFrames(frames);
  std::cout << result.dump() << "\n";
  return 0;
}

}  // namespace
}  // namespace isobrick::test

int main(int argc, char** argv) {
  try {
    return isobrick::test::run(argc, argv);
  } catch (const std::exception& failure) {
    std::cerr << "paper_figures: " << failure.what() << "\n";
    return 1;
  }
}
