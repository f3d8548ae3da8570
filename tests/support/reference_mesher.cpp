#include "tests/support/reference_mesher.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "tests/support/crossing_triangles.h"

namespace isobrick::test {

namespace {

constexpr float kMinT = 1.0f / 4096.0f;

[[noreturn]] void broken(const std::string& what) {
  throw std::logic_error("reference mesher: " + what);
}

Index3 unit(int axis) {
  Index3 result(0);
  result[axis] = 1;
  return result;
}

bool before(const Index3& a, const Index3& b) {
  return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
}

template <typename F>
void forEachIndex(const Index3& dims, F&& f) {
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) f(Index3(x, y, z));
    }
  }
}

std::size_t offsetOf(const Index3& dims, const Index3& index) {
  return static_cast<std::size_t>((index.z * dims.y + index.y) * dims.x + index.x);
}

// ---- Oracles ------------------------------------------------------------------------------------

// Squared distance from the focus to the centre of the full, unclamped cube of a cell.
double squaredDistance(const Index3& cell, int level, const glm::dvec3& focus) {
  const glm::dvec3 centre =
      (glm::dvec3(cell) + 0.5) * static_cast<double>(std::int64_t{1} << level);
  const glm::dvec3 d = centre - focus;
  return d.x * d.x + d.y * d.y + d.z * d.z;
}

// Rule 3: dist < R_k. The factor on d is larger than 1 by more than all rounding errors together,
// which keeps the proof that neighbours differ by at most one level.
bool isNearEnough(const Index3& cell, int level, const glm::dvec3& focus, double radius) {
  const double d = std::sqrt(3.0) * (1.0 + std::ldexp(1.0, -20));
  const double reach = radius + d * (3.0 * std::ldexp(1.0, level - 1) - 1.0);
  return reach > 0 && squaredDistance(cell, level, focus) < reach * reach;
}

bool isRefined(const Index3& cell, int level, const ReferenceQuery& query) {
  if (level == 0) return false;
  if (query.level >= 0) {
    if (level <= query.level) return false;
  } else if (query.focus && !isNearEnough(cell, level, *query.focus, query.radius)) {
    return false;
  }
  if (level == 1 && query.flat) {
    const bool inside_sphere =
        !query.focus || squaredDistance(cell, 1, *query.focus) <= query.radius * query.radius;
    if (inside_sphere && query.flat(cell)) return false;
  }
  if (query.further && !query.further(level, cell)) return false;
  return true;
}

// ---- Meshing ------------------------------------------------------------------------------------

// The closed box of a leaf, in positions.
struct LeafBox {
  int level = 0;
  Index3 cell{0};
  Index3 lower{0}, upper{0};
};

// A point of a loop, before triangulation.
struct LoopPoint {
  std::uint32_t crossing = 0;
  unsigned faces = 0;  // bit f: the point is on face f of the cell
};
using Loop = std::vector<LoopPoint>;

// Finds a triangulation of the polygon 0 .. n-1 whose diagonals never join two points of one cell
// face (rule 10), by trying all. Empty if there is none.
class LoopTriangulator {
 public:
  explicit LoopTriangulator(const Loop& loop) : loop_(loop) {}

  std::vector<std::array<std::size_t, 3>> run() {
    std::vector<std::array<std::size_t, 3>> triangles;
    if (!split(0, loop_.size() - 1, triangles)) triangles.clear();
    return triangles;
  }

 private:
  bool mayJoin(std::size_t i, std::size_t j) const {
    const std::size_t gap = j - i;
    if (gap == 1 || gap + 1 == loop_.size()) return true;  // a side of the polygon
    return (loop_[i].faces & loop_[j].faces) == 0;
  }

  // Triangulates the polygon i .. j, whose side (i, j) is taken care of by the caller.
  bool split(std::size_t i, std::size_t j, std::vector<std::array<std::size_t, 3>>& triangles) {
    if (j - i < 2) return true;
    for (std::size_t k = i + 1; k < j; ++k) {
      if (!mayJoin(i, k) || !mayJoin(k, j)) continue;
      const std::size_t mark = triangles.size();
      triangles.push_back({i, k, j});
      if (split(i, k, triangles) && split(k, j, triangles)) return true;
      triangles.resize(mark);
    }
    return false;
  }

  const Loop& loop_;
};

// The points of the loop from which diagonals to all others lead through the cell: no two points of
// a diagonal are on one face of the cell (rule 10).
std::vector<std::size_t> hubsOf(const Loop& loop) {
  std::vector<std::size_t> hubs;
  for (std::size_t hub = 0; hub < loop.size(); ++hub) {
    std::size_t others = 0;
    for (const LoopPoint& point : loop) others += (point.faces & loop[hub].faces) == 0;
    // The others are the point itself and the two beside it, which are on its faces.
    if (others + 3 == loop.size()) hubs.push_back(hub);
  }
  return hubs;
}

class Mesher {
 public:
  Mesher(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso)
      : pyramid_(pyramid),
        lattice_(pyramid.lattice),
        leaves_(leaves),
        iso_(static_cast<float>(iso)),
        last_(pyramid.lattice.voxels() - Index3(1)),
        values_(static_cast<std::size_t>(elementCount(lattice_.voxels()))) {
    if (leaves.cells != last_) throw std::invalid_argument("reference: leaves of another volume");
  }

  float value(const Index3& p);
  ReferenceMesh run();
  ReferenceCaps caps(const Index3& low, const Index3& high, bool below);

 private:
  // Least and greatest level of the leaves that touch p.
  std::pair<int, int> touchingLevels(const Index3& p) const;
  float computeValue(const Index3& p);
  float cornerValue(const Index3& p, int level);
  bool isInside(const Index3& p) { return value(p) >= iso_; }
  glm::vec3 gradient(const Index3& p) const;

  std::pair<int, int> levelsAround(const Index3& base, int axis) const;
  std::uint32_t crossingOf(const Index3& base, int axis, int level);
  ReferenceCrossing computeCrossing(const Index3& base, int axis, int level);

  int faceNeighbourLevel(const LeafBox& leaf, int axis, int side) const;
  std::vector<std::int64_t> faceSteps(const LeafBox& leaf, int axis, int level) const;
  void addFace(const LeafBox& leaf, int axis, int side, int level);
  void addSubFace(const Index3& lower, const Index3& upper, int axis, int side, int level);
  std::vector<Loop> takeLoops();
  std::vector<std::size_t> hubsApart(const std::vector<Loop>& loops) const;
  bool isBesideMissing(const LeafBox& leaf) const;
  void meshLeaf(const LeafBox& leaf);
  void emit(const LeafBox& leaf, std::uint32_t a, std::uint32_t b, std::uint32_t c);
  void sortCrossings();
  template <typename F>
  void forEachLeaf(F&& f) const;

  // A point of a face's border: a lattice point, or a crossing.
  struct RingPoint {
    glm::dvec3 place{0};
    std::optional<Index3> lattice_point;
    bool is_in = true;
  };
  std::vector<RingPoint> ringOf(const std::array<Index3, 4>& corners, int level, bool below);
  void capFace(const LeafBox& leaf, int axis, int side, bool below, ReferenceCaps& caps);
  void capPolygon(const std::vector<RingPoint>& polygon, int level, int axis, ReferenceCaps& caps);

  const ReferencePyramid& pyramid_;
  const Lattice& lattice_;
  const LeafLevels& leaves_;
  const float iso_;
  const Index3 last_;  // the last voxel: greatest position

  std::vector<std::optional<float>> values_;  // by position, once computed
  std::unordered_map<std::int64_t, std::uint32_t> crossing_of_edge_;
  // In the cell at hand: each crossing's successor along its loop, and the faces it is on.
  std::map<std::uint32_t, std::uint32_t> next_;
  std::map<std::uint32_t, unsigned> faces_;

  // While meshing, a triangle's corner >= kFanMark is the fan centre number (corner - kFanMark).
  static constexpr std::uint32_t kFanMark = std::uint32_t{1} << 31;
  std::vector<glm::dvec3> fan_centres_;
  ReferenceMesh mesh_;
};

std::pair<int, int> Mesher::touchingLevels(const Index3& p) const {
  int least = std::numeric_limits<int>::max();
  int greatest = -1;
  forEachIndex(Index3(2), [&](const Index3& corner) {
    const Index3 cell = p - corner;
    for (int axis = 0; axis < 3; ++axis) {
      if (cell[axis] < 0 || cell[axis] >= leaves_.cells[axis]) return;
    }
    const int level = leaves_.leafLevelAt(cell);
    least = std::min(least, level);
    greatest = std::max(greatest, level);
  });
  return {least, greatest};
}

float Mesher::value(const Index3& p) {
  std::optional<float>& known = values_[offsetOf(lattice_.voxels(), p)];
  if (!known) known = computeValue(p);
  return *known;
}

// std::clamp, but a NaN becomes `low`: see clampedLerp.
double clampOrLow(double x, double low, double high) {
  if (!(x >= low)) return low;
  return x <= high ? x : high;
}

// Linear interpolation that stays between its ends, so that a mean of equal values is that value
// and a half-edge has a crossing only where its edge has one. With the infinite and the NaN (which
// is never inside) as ends too: the result is on the side of one of the ends.
double clampedLerp(double a, double b, double w) {
  return clampOrLow(a + w * (b - a), std::min(a, b), std::max(a, b));
}

// Rule 6.
float Mesher::computeValue(const Index3& p) {
  const auto [least, greatest] = touchingLevels(p);
  const int m = least, M = greatest;  // clang 14 takes no structured binding into a lambda
  if (isOnLattice(lattice_, M, p)) return pyramid_.sampleAtPosition(m, p);
  if (M - m != 1) broken("touching leaves differ by more than one level");

  // Along each axis off the lattice of level M: the ends of the level-M edge and p's weight.
  std::array<std::int64_t, 3> from{}, to{};
  std::array<double, 3> weight{};
  std::vector<int> off;
  for (int axis = 0; axis < 3; ++axis) {
    if (isOnLattice(lattice_, M, axis, p[axis])) continue;
    const auto a = static_cast<std::size_t>(axis);
    from[a] = (p[axis] >> M) << M;
    to[a] = std::min(from[a] + (std::int64_t{1} << M), last_[axis]);
    if (p[axis] != from[a] + (std::int64_t{1} << m)) broken("a value between lattice points");
    weight[a] = static_cast<double>(p[axis] - from[a]) / static_cast<double>(to[a] - from[a]);
    off.push_back(axis);
  }
  if (off.size() == 3) broken("a lattice point inside a coarser leaf");

  const auto a = static_cast<std::size_t>(off[0]);
  auto along_first = [&](Index3 q) {
    q[off[0]] = from[a];
    const float low = cornerValue(q, M);
    q[off[0]] = to[a];
    return clampedLerp(low, cornerValue(q, M), weight[a]);
  };
  if (off.size() == 1) return static_cast<float>(along_first(p));

  const auto b = static_cast<std::size_t>(off[1]);
  Index3 q = p;
  q[off[1]] = from[b];
  const double low = along_first(q);
  q[off[1]] = to[b];
  return static_cast<float>(clampedLerp(low, along_first(q), weight[b]));
}

// The value of a corner of a level-M leaf beside a hanging point: by rule 5 it does not hang.
float Mesher::cornerValue(const Index3& p, int level) {
  if (touchingLevels(p).second > level)
    broken("the corner that a hanging point needs hangs itself");
  return value(p);
}

// Rule 12: differences of the raw samples of the point's finest level.
glm::vec3 Mesher::gradient(const Index3& p) const {
  const int m = touchingLevels(p).first;
  const Index3 sample = sampleIndex(lattice_, m, p);
  glm::vec3 g(0);
  for (int axis = 0; axis < 3; ++axis) {
    Index3 low = sample, high = sample;
    low[axis] = std::max<std::int64_t>(sample[axis] - 1, 0);
    high[axis] = std::min(sample[axis] + 1, lattice_.samples(m)[axis] - 1);
    if (pyramid_.has_missing) {
      const auto isMissing = [&](const Index3& at) { return std::isnan(pyramid_.sampleAt(m, at)); };
      if (isMissing(low))
        low = sample;
      else if (isMissing(high))
        high = sample;
      if (isMissing(low) || isMissing(high) || low == high) continue;
    }
    const float difference = pyramid_.sampleAt(m, high) - pyramid_.sampleAt(m, low);
    g[axis] = difference / static_cast<float>(lattice_.position(m, axis, high[axis]) -
                                              lattice_.position(m, axis, low[axis]));
  }
  return g;
}

ReferenceCrossing Mesher::computeCrossing(const Index3& base, int axis, int level) {
  const std::int64_t length = std::int64_t{1} << level;
  const std::int64_t upper = std::min(base[axis] + length, last_[axis]);
  Index3 end = base;
  end[axis] = upper;
  const float a = value(base), b = value(end);
  if (isInside(base) == isInside(end)) broken("a crossing on an edge that the surface misses");

  ReferenceCrossing crossing;
  crossing.base = base;
  crossing.axis = axis;
  crossing.upper = upper;
  // Rounded to a multiple of 1/32768, halves to even.
  const double part = clampOrLow((iso_ - a) / (b - a), kMinT, 1.0f - kMinT);
  crossing.t = std::nearbyint(part * 32768) / 32768;
  // Finer leaves have half of it as an edge, on which it must lie, at no end.
  Index3 middle = base;
  middle[axis] += length / 2;
  if (levelsAround(base, axis).first < level && middle[axis] < upper) {
    const double at = std::nearbyint(32768 * static_cast<double>(length / 2) /
                                     static_cast<double>(upper - base[axis])) /
                      32768;
    crossing.t = isInside(middle) == isInside(base) ? std::max(crossing.t, at + 1.0 / 32768)
                                                    : std::min(crossing.t, at - 1.0 / 32768);
  }
  const auto t = static_cast<float>(crossing.t), s = static_cast<float>(1 - crossing.t);
  // From the upper end: what a thin cell's length adds in rounding is the same on all levels.
  crossing.position =
      static_cast<double>(upper) - static_cast<double>(s * static_cast<float>(upper - base[axis]));

  const glm::vec3 low = gradient(base), high = gradient(end);
  const glm::vec3 g(low.x * s + high.x * t, low.y * s + high.y * t, low.z * s + high.z * t);
  const float norm = std::sqrt((g.x * g.x + g.y * g.y) + g.z * g.z);
  if (norm > 0 && std::isfinite(norm)) {
    const float factor = -1 / norm;
    crossing.normal = glm::dvec3(g.x * factor, g.y * factor, g.z * factor);
  } else {
    crossing.normal[axis] = isInside(base) ? 1.0 : -1.0;
  }
  return crossing;
}

// The finest and the coarsest leaf around the first voxel step of an edge. One of the edge's level
// covers all of it, and so do leaves that are finer than it.
std::pair<int, int> Mesher::levelsAround(const Index3& base, int axis) const {
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  int finest = std::numeric_limits<int>::max(), coarsest = -1;
  forEachIndex(Index3(2, 2, 1), [&](const Index3& side) {
    const Index3 cell = base - side.x * unit(u) - side.y * unit(v);
    for (int i = 0; i < 3; ++i) {
      if (cell[i] < 0 || cell[i] >= leaves_.cells[i]) return;
    }
    finest = std::min(finest, leaves_.leafLevelAt(cell));
    coarsest = std::max(coarsest, leaves_.leafLevelAt(cell));
  });
  return {finest, coarsest};
}

// Rule 8: the crossing of the edge of `level` that begins at `base`, or of the coarser leaf's edge
// that it is a half of.
std::uint32_t Mesher::crossingOf(const Index3& base, int axis, int level) {
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  const int coarsest = levelsAround(base, axis).second;
  if (coarsest > level + 1) broken("an edge touches a leaf two levels coarser");

  Index3 lower = base;
  int edge_level = level;
  if (coarsest == level + 1 && isOnLattice(lattice_, coarsest, u, base[u]) &&
      isOnLattice(lattice_, coarsest, v, base[v])) {
    edge_level = coarsest;
    lower[axis] = (base[axis] >> coarsest) << coarsest;
  }
  ReferenceCrossing crossing = computeCrossing(lower, axis, edge_level);

  const auto key = static_cast<std::int64_t>(offsetOf(lattice_.voxels(), lower)) * 3 + axis;
  const auto [found, is_new] =
      crossing_of_edge_.try_emplace(key, static_cast<std::uint32_t>(mesh_.crossings.size()));
  if (is_new) {
    mesh_.crossings.push_back(crossing);
  } else if (mesh_.crossings[found->second].upper != crossing.upper) {
    broken("one edge with two extents");
  }
  return found->second;
}

// The level of the leaves across a face of a leaf: the leaf's own level or coarser is one leaf,
// finer is one level finer everywhere. -1 at the volume's border.
int Mesher::faceNeighbourLevel(const LeafBox& leaf, int axis, int side) const {
  Index3 lower = leaf.lower;
  Index3 upper = leaf.upper;
  if (side == 0) {
    if (lower[axis] == 0) return -1;
    lower[axis] -= 1;
  } else {
    if (upper[axis] == last_[axis]) return -1;
    lower[axis] = upper[axis];
  }
  upper[axis] = lower[axis] + 1;

  const int level = leaves_.leafLevelAt(lower);
  forEachIndex(upper - lower, [&](const Index3& offset) {
    if (leaves_.leafLevelAt(lower + offset) != level) broken("a face with leaves of two levels");
  });
  if (level < leaf.level - 1 || level > leaf.level + 1) broken("neighbours two levels apart");
  return level;
}

// Where the lattice of `level` divides a leaf's extent along an axis, ends included.
std::vector<std::int64_t> Mesher::faceSteps(const LeafBox& leaf, int axis, int level) const {
  std::vector<std::int64_t> steps;
  for (std::int64_t p = leaf.lower[axis]; p < leaf.upper[axis]; p += std::int64_t{1} << level) {
    steps.push_back(p);
  }
  steps.push_back(leaf.upper[axis]);
  return steps;
}

// Adds the boundary of the surface on one face of a leaf, as cells of `level` see it: the leaf's
// own, or one finer on a transition face.
void Mesher::addFace(const LeafBox& leaf, int axis, int side, int level) {
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  const std::vector<std::int64_t> us = faceSteps(leaf, u, level);
  const std::vector<std::int64_t> vs = faceSteps(leaf, v, level);
  for (std::size_t j = 0; j + 1 < vs.size(); ++j) {
    for (std::size_t i = 0; i + 1 < us.size(); ++i) {
      Index3 lower(0), upper(0);
      lower[axis] = upper[axis] = side == 0 ? leaf.lower[axis] : leaf.upper[axis];
      lower[u] = us[i];
      upper[u] = us[i + 1];
      lower[v] = vs[j];
      upper[v] = vs[j + 1];
      addSubFace(lower, upper, axis, side, level);
    }
  }
}

// Marching squares with the inside corners kept apart (rule 9). Walking round the face
// counter-clockwise as seen from outside the cell, every run of inside corners is cut off by one
// segment, from the edge that enters the run to the edge that leaves it: it has the inside on its
// right, so that the loop is counter-clockwise seen from the lower values.
void Mesher::addSubFace(const Index3& lower, const Index3& upper, int axis, int side, int level) {
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  std::array<Index3, 4> corners = {lower, lower, upper, lower};
  corners[1][u] = upper[u];
  corners[3][v] = upper[v];
  if (side == 0) std::swap(corners[1], corners[3]);

  auto crossing_after = [&](std::size_t i) {
    const Index3& a = corners[i];
    const Index3& b = corners[(i + 1) % 4];
    return crossingOf(before(a, b) ? a : b, a[u] != b[u] ? u : v, level);
  };
  for (std::size_t i = 0; i < 4; ++i) {
    if (isInside(corners[i]) || !isInside(corners[(i + 1) % 4])) continue;
    std::size_t end = (i + 1) % 4;
    while (isInside(corners[(end + 1) % 4])) end = (end + 1) % 4;
    const std::uint32_t from = crossing_after(i);
    const std::uint32_t to = crossing_after(end);
    if (!next_.emplace(from, to).second) broken("a loop that forks");
    const unsigned face = 1u << (2 * axis + side);
    faces_[from] |= face;
    faces_[to] |= face;
    mesh_.segments.push_back({from, to});
  }
}

std::vector<Loop> Mesher::takeLoops() {
  std::vector<Loop> loops;
  while (!next_.empty()) {
    Loop loop;
    const std::uint32_t start = next_.begin()->first;
    std::uint32_t at = start;
    do {
      const auto step = next_.find(at);
      if (step == next_.end()) broken("a loop that does not close");
      loop.push_back({at, faces_.at(at)});
      at = step->second;
      next_.erase(step);
    } while (at != start);
    if (loop.size() < 3) broken("a loop of fewer than three points");
    loops.push_back(std::move(loop));
  }
  faces_.clear();
  return loops;
}

void Mesher::emit(const LeafBox& leaf, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  mesh_.triangles.insert(mesh_.triangles.end(), {a, b, c});
  mesh_.triangle_levels.push_back(static_cast<std::int8_t>(leaf.level));
  mesh_.triangle_cells.push_back(leaf.cell);
}

// Whether a corner of the leaf has no data, or hangs between corners of which one has none.
bool Mesher::isBesideMissing(const LeafBox& leaf) const {
  bool is_any = false;
  forEachIndex(Index3(2), [&](const Index3& corner) {
    Index3 p = leaf.lower;
    for (int axis = 0; axis < 3; ++axis)
      if (corner[axis] == 1) p[axis] = leaf.upper[axis];
    is_any = is_any || std::isnan(pyramid_.sampleAtPosition(leaf.level, p));
    const int M = touchingLevels(p).second;
    if (M == leaf.level) return;
    forEachIndex(Index3(2), [&](const Index3& end) {
      Index3 q = p;
      for (int axis = 0; axis < 3; ++axis)
        if (!isOnLattice(lattice_, M, axis, p[axis]))
          q[axis] = std::min(((p[axis] >> M) + end[axis]) << M, last_[axis]);
      is_any = is_any || std::isnan(pyramid_.sampleAtPosition(M, q));
    });
  });
  return is_any;
}

// For every loop the point that its fan is around, or the loop's size for its centre: the first
// hub, unless fans of two loops cross; then any hubs with which they do not, and as few centres in
// place of hubs as possible.
std::vector<std::size_t> Mesher::hubsApart(const std::vector<Loop>& loops) const {
  std::vector<std::vector<std::size_t>> choices;
  for (const Loop& loop : loops) {
    choices.push_back(hubsOf(loop));
    choices.back().push_back(loop.size());
  }
  std::vector<std::size_t> first, best;
  std::size_t best_centres = loops.size() + 1;
  // Choice number n has its digits in the mixed base of the sizes.
  std::size_t all = 1;
  for (const auto& of_loop : choices) all *= of_loop.size();
  for (std::size_t n = 0; n < all; ++n) {
    std::vector<std::size_t> hubs;
    std::vector<glm::dvec3> positions;
    std::vector<std::uint32_t> triangles;
    std::size_t rest = n, centres = 0;
    for (std::size_t l = 0; l < loops.size(); ++l) {
      const std::size_t size = loops[l].size();
      hubs.push_back(choices[l][rest % choices[l].size()]);
      rest /= choices[l].size();
      centres += hubs[l] == size && choices[l].size() > 1;
      const auto begin = static_cast<std::uint32_t>(positions.size());
      glm::dvec3 sum(0);
      for (const LoopPoint& point : loops[l]) {
        positions.push_back(mesh_.crossings[point.crossing].point());
        sum += positions.back();
      }
      positions.push_back(sum / static_cast<double>(size));
      for (std::size_t i = 0; i < size; ++i)
        if (const std::size_t next = (i + 1) % size; i != hubs[l] && next != hubs[l])
          for (const std::size_t corner : {hubs[l], i, next})
            triangles.push_back(begin + static_cast<std::uint32_t>(corner));
    }
    if (n == 0) {
      first = hubs;
      if (loops.size() < 2) return first;
    }
    if (centres >= best_centres || !crossingTriangles(positions, triangles).empty()) continue;
    best = hubs;
    best_centres = centres;
    if (n == 0) break;
  }
  return best.empty() ? first : best;
}

void Mesher::meshLeaf(const LeafBox& leaf) {
  ReferenceLevelCounts& counts = mesh_.level_counts[static_cast<std::size_t>(leaf.level)];
  if (pyramid_.has_missing && isBesideMissing(leaf)) return;
  bool is_transition = false, is_crossed = false;  // across a transition face
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      const int neighbour = faceNeighbourLevel(leaf, axis, side);
      const bool is_finer = neighbour >= 0 && neighbour < leaf.level;
      is_transition = is_transition || is_finer;
      const std::size_t pieces = next_.size();
      addFace(leaf, axis, side, is_finer ? neighbour : leaf.level);
      is_crossed = is_crossed || (is_finer && next_.size() > pieces);
    }
  }

  const std::size_t triangles_before = mesh_.triangles.size();
  const std::vector<Loop> loops = takeLoops();
  const std::vector<std::size_t> hubs =
      is_crossed ? hubsApart(loops) : std::vector<std::size_t>(loops.size());
  for (std::size_t l = 0; l < loops.size(); ++l) {
    const Loop& loop = loops[l];
    const std::size_t hub = is_crossed ? hubs[l] : loop.size();
    if (hub < loop.size()) {
      for (std::size_t i = 1; i + 1 < loop.size(); ++i)
        emit(leaf, loop[hub].crossing, loop[(hub + i) % loop.size()].crossing,
             loop[(hub + i + 1) % loop.size()].crossing);
    } else if (is_crossed) {
      glm::dvec3 sum(0);
      for (const LoopPoint& point : loop) sum += mesh_.crossings[point.crossing].point();
      const auto centre = kFanMark + static_cast<std::uint32_t>(fan_centres_.size());
      fan_centres_.push_back(sum / static_cast<double>(loop.size()));
      for (std::size_t i = 0; i < loop.size(); ++i) {
        emit(leaf, loop[i].crossing, loop[(i + 1) % loop.size()].crossing, centre);
      }
    } else {
      const auto triangles = LoopTriangulator(loop).run();
      if (triangles.empty()) broken("a loop without a triangulation");
      for (const auto& [i, j, k] : triangles) {
        emit(leaf, loop[i].crossing, loop[j].crossing, loop[k].crossing);
      }
    }
  }

  const auto triangles = static_cast<std::int64_t>((mesh_.triangles.size() - triangles_before) / 3);
  counts.leaves += 1;
  counts.transition_leaves += is_transition;
  counts.cells += triangles > 0;
  counts.transition_cells += is_crossed;
  counts.triangles += triangles;
}

// Brings crossings into their order, renumbers what refers to them and appends the fan centres.
void Mesher::sortCrossings() {
  const std::size_t count = mesh_.crossings.size();
  std::vector<std::uint32_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = static_cast<std::uint32_t>(i);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return mesh_.crossings[a] < mesh_.crossings[b];
  });

  std::vector<std::uint32_t> rank(count);
  std::vector<ReferenceCrossing> sorted;
  for (std::size_t i = 0; i < count; ++i) {
    rank[order[i]] = static_cast<std::uint32_t>(i);
    sorted.push_back(mesh_.crossings[order[i]]);
  }
  mesh_.crossings = std::move(sorted);
  for (std::uint32_t& corner : mesh_.triangles) {
    corner =
        corner >= kFanMark ? static_cast<std::uint32_t>(count) + (corner - kFanMark) : rank[corner];
  }
  for (auto& segment : mesh_.segments) segment = {rank[segment[0]], rank[segment[1]]};
  std::sort(mesh_.segments.begin(), mesh_.segments.end());

  for (const ReferenceCrossing& crossing : mesh_.crossings) {
    mesh_.positions.push_back(crossing.point());
  }
  mesh_.positions.insert(mesh_.positions.end(), fan_centres_.begin(), fan_centres_.end());
}

template <typename F>
void Mesher::forEachLeaf(F&& f) const {
  forEachIndex(leaves_.cells, [&](const Index3& cell) {
    LeafBox leaf;
    leaf.level = leaves_.leafLevelAt(cell);
    leaf.cell = cell >> Index3(leaf.level);
    leaf.lower = lattice_.position(leaf.level, leaf.cell);
    leaf.upper = lattice_.position(leaf.level, leaf.cell + Index3(1));
    if (leaf.lower == cell) f(leaf);
  });
}

ReferenceMesh Mesher::run() {
  mesh_.leaves = leaves_;
  mesh_.level_counts.resize(static_cast<std::size_t>(lattice_.levels()));
  forEachLeaf([&](const LeafBox& leaf) { meshLeaf(leaf); });
  sortCrossings();
  return std::move(mesh_);
}

// ---- Caps ---------------------------------------------------------------------------------------

// All points along the border of a square, counter-clockwise as its corners: these, the middles of
// sides that finer leaves halve, and the crossings between any two of which one alone is inside.
std::vector<Mesher::RingPoint> Mesher::ringOf(const std::array<Index3, 4>& corners, int level,
                                              bool below) {
  std::vector<RingPoint> ring;
  for (std::size_t i = 0; i < 4; ++i) {
    const Index3 &from = corners[i], &to = corners[(i + 1) % 4];
    const Index3& base = before(from, to) ? from : to;
    const Index3& end = before(from, to) ? to : from;
    int axis = 0;
    while (base[axis] == end[axis]) ++axis;
    std::vector<Index3> points = {from, to};
    Index3 middle = base;
    middle[axis] += (std::int64_t{1} << level) / 2;
    if (levelsAround(base, axis).first < level && middle[axis] < end[axis])
      points.insert(points.begin() + 1, middle);
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
      ring.push_back({glm::dvec3(points[n]), points[n], isInside(points[n]) != below});
      if (isInside(points[n]) != isInside(points[n + 1]))
        ring.push_back(
            {mesh_.crossings[crossingOf(base, axis, level)].point(), std::nullopt, true});
    }
  }
  return ring;
}

void Mesher::capPolygon(const std::vector<RingPoint>& polygon, int level, int axis,
                        ReferenceCaps& caps) {
  if (polygon.empty()) return;
  if (polygon.size() < 3) broken("a cap of two points");
  glm::dvec3 doubled(0);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    doubled += glm::cross(polygon[i].place, polygon[(i + 1) % polygon.size()].place);
    if (polygon[i].lattice_point) caps.points.push_back(*polygon[i].lattice_point);
  }
  caps.area += std::abs(doubled[axis]) / 2;
  caps.level_counts[static_cast<std::size_t>(level)].triangles +=
      static_cast<std::int64_t>(polygon.size()) - 2;
}

// In squares of the leaf's level, or of the finer leaves beyond the border if the surface crosses
// the face: the leaf's own triangles follow their contour. Above the isovalue, points that are
// outside part the border of a square into polygons (rule 9); below it they do not.
void Mesher::capFace(const LeafBox& leaf, int axis, int side, bool below, ReferenceCaps& caps) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  int level = leaf.level;
  if (const int across = faceNeighbourLevel(leaf, axis, side); across >= 0 && across < level) {
    int inside = 0;
    forEachIndex(Index3(2, 2, 1), [&](const Index3& corner) {
      Index3 p = leaf.lower;
      if (side == 1) p[axis] = leaf.upper[axis];
      if (corner.x == 1) p[u] = leaf.upper[u];
      if (corner.y == 1) p[v] = leaf.upper[v];
      inside += isInside(p) ? 1 : 0;
    });
    if (inside % 4 != 0) level = across;
  }
  const std::vector<std::int64_t> us = faceSteps(leaf, u, level), vs = faceSteps(leaf, v, level);
  for (std::size_t j = 0; j + 1 < vs.size(); ++j)
    for (std::size_t i = 0; i + 1 < us.size(); ++i) {
      std::array<Index3, 4> corners;
      corners.fill(side == 0 ? leaf.lower : leaf.upper);
      for (std::size_t n = 0; n < 4; ++n) {
        corners[n][u] = us[i + (n == 1 || n == 2)];
        corners[n][v] = vs[j + (n >= 2)];
      }
      std::vector<RingPoint> ring = ringOf(corners, level, below);
      const auto is_out = [](const RingPoint& point) { return !point.is_in; };
      std::rotate(ring.begin(), std::find_if(ring.begin(), ring.end(), is_out), ring.end());
      std::vector<RingPoint> polygon;
      for (const RingPoint& point : ring) {
        if (point.is_in) polygon.push_back(point);
        if (point.is_in || below) continue;
        capPolygon(polygon, leaf.level, axis, caps);
        polygon.clear();
      }
      capPolygon(polygon, leaf.level, axis, caps);
    }
}

ReferenceCaps Mesher::caps(const Index3& low, const Index3& high, bool below) {
  ReferenceCaps caps;
  caps.level_counts.resize(static_cast<std::size_t>(lattice_.levels()));
  forEachLeaf([&](const LeafBox& leaf) {
    bool is_within = true, overlaps = true;
    for (int axis = 0; axis < 3; ++axis) {
      is_within = is_within && leaf.lower[axis] >= low[axis] && leaf.upper[axis] <= high[axis];
      overlaps = overlaps && leaf.lower[axis] < high[axis] && leaf.upper[axis] > low[axis];
    }
    if (!overlaps) return;
    if (!is_within) broken("a box that cuts a leaf");
    if (pyramid_.has_missing && isBesideMissing(leaf)) return;
    ReferenceLevelCounts& counts = caps.level_counts[static_cast<std::size_t>(leaf.level)];
    const std::int64_t triangles = counts.triangles;
    for (int axis = 0; axis < 3; ++axis) {
      if (leaf.lower[axis] == low[axis]) capFace(leaf, axis, 0, below, caps);
      if (leaf.upper[axis] == high[axis]) capFace(leaf, axis, 1, below, caps);
    }
    int above = 0;
    forEachIndex(Index3(2), [&](const Index3& corner) {
      Index3 p = leaf.lower;
      for (int axis = 0; axis < 3; ++axis)
        if (corner[axis] == 1) p[axis] = leaf.upper[axis];
      above += isInside(p) ? 1 : 0;
    });
    counts.cells += above % 8 == 0 && counts.triangles > triangles;
  });
  std::sort(caps.points.begin(), caps.points.end(), before);
  caps.points.erase(std::unique(caps.points.begin(), caps.points.end()), caps.points.end());
  return caps;
}

}  // namespace

// ---- Oracles ------------------------------------------------------------------------------------

int LeafLevels::leafLevelAt(const Index3& level0_cell) const {
  return levels.at(offsetOf(cells, level0_cell));
}

LeafLevels finerLeafLevels(const LeafLevels& a, const LeafLevels& b) {
  LeafLevels finer = a;
  for (std::size_t i = 0; i < finer.levels.size(); ++i)
    finer.levels[i] = std::min(a.levels[i], b.levels[i]);
  return finer;
}

LeafLevels referenceLeafLevels(const Lattice& lattice, const ReferenceQuery& query) {
  if (query.focus && query.level >= 0) {
    throw std::invalid_argument("reference: a focus and a uniform level exclude each other");
  }
  LeafLevels leaves;
  leaves.cells = lattice.cells(0);
  forEachIndex(leaves.cells, [&](const Index3& cell) {
    int level = lattice.levels() - 1;
    while (isRefined(cell >> Index3(level), level, query)) --level;
    leaves.levels.push_back(static_cast<std::int8_t>(level));
  });
  return leaves;
}

std::vector<LeafConflict> auditLeafLevels(const LeafLevels& leaves) {
  std::set<LeafConflict> conflicts;
  // Leaves that touch share a lattice point of level 0, so two of their level-0 cells touch.
  forEachIndex(leaves.cells, [&](const Index3& cell) {
    const int level = leaves.leafLevelAt(cell);
    forEachIndex(Index3(3), [&](const Index3& step) {
      const Index3 other = cell + step - Index3(1);
      for (int axis = 0; axis < 3; ++axis) {
        if (other[axis] < 0 || other[axis] >= leaves.cells[axis]) return;
      }
      const int other_level = leaves.leafLevelAt(other);
      if (other_level >= level) return;
      const Index3 leaf = cell >> Index3(level);
      const bool is_overlap = (other >> Index3(level)) == leaf;
      if (level - other_level < 2 && !is_overlap) return;
      LeafConflict conflict;
      conflict.cell_a = leaf;
      conflict.level_a = level;
      conflict.cell_b = other >> Index3(other_level);
      conflict.level_b = other_level;
      conflicts.insert(conflict);
    });
  });
  return {conflicts.begin(), conflicts.end()};
}

// ---- The mesh -----------------------------------------------------------------------------------

glm::dvec3 ReferenceCrossing::point() const {
  glm::dvec3 p(base);
  p[axis] = position;
  return p;
}

bool operator<(const ReferenceCrossing& a, const ReferenceCrossing& b) {
  return std::tie(a.base.z, a.base.y, a.base.x, a.axis) <
         std::tie(b.base.z, b.base.y, b.base.x, b.axis);
}

std::int64_t ReferenceMesh::transitionCellCount() const {
  std::int64_t count = 0;
  for (const ReferenceLevelCounts& counts : level_counts) count += counts.transition_cells;
  return count;
}

ReferenceMesh referenceMesh(const ReferencePyramid& pyramid, const ReferenceQuery& query) {
  return referenceMesh(pyramid, referenceLeafLevels(pyramid.lattice, query), query.iso);
}

ReferenceMesh referenceMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso) {
  return Mesher(pyramid, leaves, iso).run();
}

ReferenceCaps referenceCaps(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso,
                            const Index3& low, const Index3& high, bool below) {
  return Mesher(pyramid, leaves, iso).caps(low, high, below);
}

std::vector<float> referenceValues(const ReferencePyramid& pyramid, const LeafLevels& leaves,
                                   std::span<const Index3> positions) {
  Mesher mesher(pyramid, leaves, 0);
  std::vector<float> values;
  for (const Index3& position : positions) values.push_back(mesher.value(position));
  return values;
}

}  // namespace isobrick::test
