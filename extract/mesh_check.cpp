#include "isobrick/extract/mesh_check.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <mutex>
#include <numbers>
#include <numeric>
#include <tuple>
#include <vector>

#include "isobrick/extract/self_crossings.h"
#include "isobrick/extract/sinks/batch_components.h"
#include "isobrick/extract/sinks/vertex_numbering.h"

namespace isobrick {
namespace {

// A vertex of the mesh: its edge key, or if no other batch has it, a number with this bit.
using VertexName = std::uint64_t;
constexpr VertexName kOwnVertex = VertexName{1} << 63;

// An edge in one batch, and how often triangles there go along it from its lower end, and back.
struct EdgeUse {
  VertexName low = 0, high = 0;
  std::uint32_t forward = 0, backward = 0;
};

// Sums over the triangles of one batch. Batches are added up in the order of their bricks, so that
// the last digits do not depend on threads.
struct BatchSums {
  int level = 0;
  Index3 brick{0};
  double area = 0, volume = 0, aspect = 0;
};

void addTriangle(const std::array<glm::dvec3, 3>& p, bool has_area, BatchSums& sums,
                 double& least_sine, double& worst_aspect) {
  std::array<double, 3> sides = {glm::length(p[1] - p[0]), glm::length(p[2] - p[1]),
                                 glm::length(p[0] - p[2])};
  const double twice_area = glm::length(glm::cross(p[1] - p[0], p[2] - p[0]));
  sums.area += twice_area / 2;
  sums.volume += glm::dot(p[0], glm::cross(p[1], p[2])) / 6;
  std::ranges::sort(sides);
  // The least angle is between the longer sides, and at most 60 degrees.
  least_sine = std::min(least_sine, has_area ? twice_area / (sides[1] * sides[2]) : 0.0);
  if (!has_area) return;
  const double aspect =
      sides[2] * (sides[0] + sides[1] + sides[2]) / (2 * std::numbers::sqrt3 * twice_area);
  sums.aspect += aspect;
  worst_aspect = std::max(worst_aspect, aspect);
}

// Exact: positions have 24 bits.
bool spansArea(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  const glm::dvec3 p(a);
  return glm::cross(glm::dvec3(b) - p, glm::dvec3(c) - p) != glm::dvec3(0.0);
}

void countCrossings(const MeshBatch& batch, std::uint64_t& crossing) {
  // Half the step of crossings, since those of the next finer level lie on a coarser one's border.
  constexpr int kStepBits = 16;
  const float steps = std::ldexp(1.0f, kStepBits - batch.level);
  glm::vec3 lower = batch.positions[0], upper = lower;
  for (const glm::vec3& position : batch.positions) {
    lower = glm::min(lower, position);
    upper = glm::max(upper, position);
  }
  const glm::vec3 center = glm::round((lower + upper) / 2.0f);
  std::vector<glm::ivec3> positions;
  for (const glm::vec3& position : batch.positions)
    positions.emplace_back(glm::round((position - center) * steps));
  std::vector<SelfCrossings::Triangle> triangles;
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3)
    triangles.push_back({batch.triangles[i], batch.triangles[i + 1], batch.triangles[i + 2]});
  SelfCrossings crossings;
  crossing += crossings.find(positions, triangles).size();
}

// Edges of the batch, each once, with vertices named for the whole mesh.
std::vector<EdgeUse> edgesOf(const MeshBatch& batch, VertexName first_own) {
  std::vector<VertexName> names(batch.positions.size());
  std::iota(names.begin(), names.end(), first_own | kOwnVertex);
  for (const MeshBatch::SharedVertex& shared : batch.shared) names[shared.vertex] = shared.key;
  std::vector<EdgeUse> uses;
  uses.reserve(batch.triangles.size());
  for (std::size_t i = 0; i < batch.triangles.size(); ++i) {
    const VertexName from = names[batch.triangles[i]];
    const VertexName to = names[batch.triangles[i % 3 == 2 ? i - 2 : i + 1]];
    if (from < to) uses.push_back({from, to, 1, 0});
    if (to < from) uses.push_back({to, from, 0, 1});
  }
  return uses;
}

// Sorts, and joins the uses of each edge.
void joinUses(std::vector<EdgeUse>& uses) {
  std::ranges::sort(uses, [](const EdgeUse& a, const EdgeUse& b) {
    return std::pair(a.low, a.high) < std::pair(b.low, b.high);
  });
  std::size_t count = 0;
  for (const EdgeUse& use : uses) {
    if (count > 0 && uses[count - 1].low == use.low && uses[count - 1].high == use.high) {
      uses[count - 1].forward += use.forward;
      uses[count - 1].backward += use.backward;
    } else {
      uses[count++] = use;
    }
  }
  uses.resize(count);
}

std::uint64_t countPieces(const std::vector<EdgeUse>& edges) {
  std::vector<VertexName> names;
  for (const EdgeUse& edge : edges) names.insert(names.end(), {edge.low, edge.high});
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  const auto placeOf = [&](VertexName name) {
    return static_cast<std::uint32_t>(std::ranges::lower_bound(names, name) - names.begin());
  };
  std::vector<std::uint32_t> parents(names.size());
  std::iota(parents.begin(), parents.end(), 0u);
  for (const EdgeUse& edge : edges) joinSets(parents, placeOf(edge.low), placeOf(edge.high));
  std::uint64_t pieces = 0;
  for (std::uint32_t i = 0; i < parents.size(); ++i) pieces += parents[i] == i ? 1 : 0;
  return pieces;
}

// Counts what is wrong with an edge of which all uses are known; one that is open goes to the
// others.
void judge(const EdgeUse& use, MeshQuality& counts, std::vector<EdgeUse>& open) {
  if (use.forward + use.backward == 1)
    open.push_back(use);
  else if (use.forward + use.backward > 2)
    ++counts.nonmanifold_edges;
  else if (use.forward != use.backward)
    ++counts.misoriented_edges;
}

}  // namespace

struct MeshCheck::Found {
  VertexNumbering numbering;
  std::atomic<VertexName> next_own{0};
  std::mutex mutex;  // guards all below
  MeshQuality counts;
  double least_sine = 1;
  std::vector<BatchSums> sums;
  std::vector<EdgeUse> open;    // with an end that no other batch has
  std::vector<EdgeUse> border;  // both ends of which other batches may have
};

MeshCheck::MeshCheck(TriangleSink& sink) : sink_(sink), found_(std::make_unique<Found>()) {}
MeshCheck::~MeshCheck() = default;

void MeshCheck::begin(const MeshFrame& frame) {
  placement_ = WorldPlacement(frame.geometry);
  middle_ = frame.geometry.indexToWorld(glm::dvec3(frame.voxels - Index3(1)) / 2.0);
  sink_.begin(frame);
}

void MeshCheck::place(PlacedBatch& placed) {
  found_->numbering.place(placed);
  sink_.place(placed);
}

void MeshCheck::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  MeshQuality counts;
  BatchSums sums{batch.level, batch.brick};
  double least_sine = 1;
  std::vector<glm::dvec3> world;
  for (std::uint32_t v = 0; v < batch.positions.size(); ++v)
    world.push_back(placement_.worldPosition(batch, v) - middle_);
  for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
    const std::uint32_t a = batch.triangles[i], b = batch.triangles[i + 1],
                        c = batch.triangles[i + 2];
    const bool has_area = spansArea(batch.positions[a], batch.positions[b], batch.positions[c]);
    counts.zero_area += has_area ? 0 : 1;
    addTriangle({world[a], world[b], world[c]}, has_area, sums, least_sine, counts.worst_aspect);
  }
  if (!batch.triangles.empty()) countCrossings(batch, counts.crossing);
  std::vector<EdgeUse> uses = edgesOf(batch, found_->next_own.fetch_add(batch.positions.size()));
  joinUses(uses);
  std::vector<EdgeUse> open, border;
  for (const EdgeUse& use : uses) {
    if (((use.low | use.high) & kOwnVertex) == 0) {
      border.push_back(use);
      continue;
    }
    ++counts.edges;
    judge(use, counts, open);
  }
  {
    const std::lock_guard lock(found_->mutex);
    MeshQuality& all = found_->counts;
    all.triangles += batch.triangles.size() / 3;
    all.edges += counts.edges;
    all.zero_area += counts.zero_area;
    all.crossing += counts.crossing - std::min(counts.crossing, counts.zero_area);
    all.nonmanifold_edges += counts.nonmanifold_edges;
    all.misoriented_edges += counts.misoriented_edges;
    all.worst_aspect = std::max(all.worst_aspect, counts.worst_aspect);
    found_->least_sine = std::min(found_->least_sine, least_sine);
    found_->sums.push_back(sums);
    found_->open.insert(found_->open.end(), open.begin(), open.end());
    found_->border.insert(found_->border.end(), border.begin(), border.end());
  }
  sink_.write(placed);
}

MeshQuality MeshCheck::quality() const {
  const std::lock_guard lock(found_->mutex);
  MeshQuality quality = found_->counts;
  quality.vertices = found_->numbering.count();
  joinUses(found_->border);
  std::vector<EdgeUse> open = found_->open;
  for (const EdgeUse& use : found_->border) judge(use, quality, open);
  quality.edges += found_->border.size();
  quality.open_edges = open.size();
  quality.boundary_loops = countPieces(open);
  quality.euler = static_cast<std::int64_t>(quality.vertices + quality.triangles) -
                  static_cast<std::int64_t>(quality.edges);
  std::ranges::sort(found_->sums, [](const BatchSums& a, const BatchSums& b) {
    return std::tuple(a.level, a.brick.z, a.brick.y, a.brick.x) <
           std::tuple(b.level, b.brick.z, b.brick.y, b.brick.x);
  });
  double aspect = 0;
  for (const BatchSums& sums : found_->sums) {
    quality.area += sums.area;
    quality.volume += sums.volume;
    aspect += sums.aspect;
  }
  if (!quality.isClosed() || !quality.isManifold() || !quality.isOriented()) quality.volume = 0;
  if (const std::uint64_t with_area = quality.triangles - quality.zero_area; with_area > 0)
    quality.mean_aspect = aspect / static_cast<double>(with_area);
  if (quality.triangles > 0)
    quality.least_angle = std::asin(std::min(1.0, found_->least_sine)) * 180 / std::numbers::pi;
  return quality;
}

}  // namespace isobrick
