#include "tests/support/split_meshes.h"

#include <algorithm>
#include <array>
#include <glm/common.hpp>
#include <map>
#include <optional>
#include <stdexcept>
#include <unordered_map>
#include <utility>

namespace isobrick::test {
namespace {

using PointId = std::uint32_t;
using Polygon = std::vector<PointId>;  // counter-clockwise seen from outside of its polyhedron

// A point of a loop: a vertex of the mesh, and a bit for each face of the polyhedron that it is on.
struct SplitPoint {
  std::uint32_t vertex = 0;
  std::uint64_t faces = 0;
};

// Points with values, and the surface in convex polyhedra between them.
class PolyhedronMesher {
 public:
  explicit PolyhedronMesher(double iso) : iso_(static_cast<float>(iso)) {}

  PointId addPoint(const glm::dvec3& at, float value) {
    points_.push_back({at, value});
    return static_cast<PointId>(points_.size() - 1);
  }
  const glm::dvec3& at(PointId id) const { return points_[id].at; }
  float value(PointId id) const { return points_[id].value; }

  // The surface in a polyhedron: contours on its faces, linked to loops, cut into triangles.
  void meshPolyhedron(const std::vector<Polygon>& faces, int level) {
    next_.clear();
    faces_of_.clear();
    for (std::size_t face = 0; face < faces.size(); ++face) addContours(faces[face], face);
    while (!next_.empty()) triangulate(takeLoop(), level);
  }

  SplitMesh& mesh() { return mesh_; }

 private:
  struct Point {
    glm::dvec3 at;
    float value;
  };

  bool isInside(PointId id) const { return points_[id].value >= iso_; }

  std::uint32_t vertexOn(PointId a, PointId b) {
    const auto [low, high] = std::minmax(a, b);
    const std::uint64_t key = std::uint64_t{low} << 32 | high;
    const auto [found, is_new] =
        vertex_of_edge_.try_emplace(key, static_cast<std::uint32_t>(mesh_.positions.size()));
    if (is_new) {
      const Point &p = points_[low], &q = points_[high];
      const double from = static_cast<double>(p.value), to = static_cast<double>(q.value);
      const double t =
          std::clamp((static_cast<double>(iso_) - from) / (to - from), 1.0 / 4096, 1 - 1.0 / 4096);
      mesh_.positions.push_back(p.at + t * (q.at - p.at));
    }
    return found->second;
  }

  // Every run of inside corners is cut off by one segment, so that inside corners are kept apart
  // (rule 9); it has the inside on its right.
  void addContours(const Polygon& face, std::size_t number) {
    const std::size_t n = face.size();
    for (std::size_t i = 0; i < n; ++i) {
      if (isInside(face[i]) || !isInside(face[(i + 1) % n])) continue;
      std::size_t end = (i + 1) % n;
      while (isInside(face[(end + 1) % n])) end = (end + 1) % n;
      const std::uint32_t from = vertexOn(face[i], face[(i + 1) % n]);
      const std::uint32_t to = vertexOn(face[end], face[(end + 1) % n]);
      if (!next_.emplace(from, to).second) throw std::logic_error("split mesh: a loop that forks");
      faces_of_[from] |= std::uint64_t{1} << number;
      faces_of_[to] |= std::uint64_t{1} << number;
    }
  }

  std::vector<SplitPoint> takeLoop() {
    std::vector<SplitPoint> loop;
    for (auto step = next_.begin(); step != next_.end();) {
      loop.push_back({step->first, faces_of_.at(step->first)});
      const std::uint32_t to = step->second;
      next_.erase(step);
      step = next_.find(to);
    }
    return loop;
  }

  // Triangles of the points i .. j of a loop, with no diagonal between two points of one face
  // (rule 10), by trying all.
  static bool cut(const std::vector<SplitPoint>& loop, std::size_t i, std::size_t j,
                  std::vector<std::size_t>& corners) {
    if (j - i < 2) return true;
    const auto may_join = [&](std::size_t a, std::size_t b) {
      return b - a == 1 || b - a + 1 == loop.size() || (loop[a].faces & loop[b].faces) == 0;
    };
    for (std::size_t k = i + 1; k < j; ++k) {
      if (!may_join(i, k) || !may_join(k, j)) continue;
      const std::size_t mark = corners.size();
      corners.insert(corners.end(), {i, k, j});
      if (cut(loop, i, k, corners) && cut(loop, k, j, corners)) return true;
      corners.resize(mark);
    }
    return false;
  }

  void triangulate(const std::vector<SplitPoint>& loop, int level) {
    std::vector<std::size_t> corners;
    if (loop.size() < 3 || !cut(loop, 0, loop.size() - 1, corners))
      throw std::logic_error("split mesh: a loop without a triangulation");
    for (const std::size_t corner : corners) mesh_.triangles.push_back(loop[corner].vertex);
    mesh_.triangle_levels.insert(mesh_.triangle_levels.end(), corners.size() / 3,
                                 static_cast<std::uint8_t>(level));
  }

  const float iso_;
  std::vector<Point> points_;
  std::unordered_map<std::uint64_t, std::uint32_t> vertex_of_edge_;
  // In the polyhedron at hand: each vertex' successor along its loop, and the faces it is on.
  std::map<std::uint32_t, std::uint32_t> next_;
  std::map<std::uint32_t, std::uint64_t> faces_of_;
  SplitMesh mesh_;
};

// The closed box of a leaf, in voxel indices.
struct SplitLeaf {
  int level = 0;
  Index3 lower{0}, upper{0};

  Index3 corner(int i) const {  // bit 0: x, 1: y, 2: z
    return {i & 1 ? upper.x : lower.x, i & 2 ? upper.y : lower.y, i & 4 ? upper.z : lower.z};
  }
};

template <typename F>
void forEachLeaf(const Lattice& lattice, const LeafLevels& leaves, F&& f) {
  Index3 cell;
  for (cell.z = 0; cell.z < leaves.cells.z; ++cell.z)
    for (cell.y = 0; cell.y < leaves.cells.y; ++cell.y)
      for (cell.x = 0; cell.x < leaves.cells.x; ++cell.x) {
        const int level = leaves.leafLevelAt(cell);
        const Index3 index = cell >> Index3(level);
        SplitLeaf leaf{level, lattice.position(level, index),
                       lattice.position(level, index + Index3(1))};
        if (leaf.lower == cell) f(leaf);
      }
}

// The corners of a face, counter-clockwise seen from outside of the leaf.
std::array<Index3, 4> faceCorners(const SplitLeaf& leaf, int axis, int side) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const int base = side << axis;
  std::array<Index3, 4> corners = {leaf.corner(base), leaf.corner(base | 1 << u),
                                   leaf.corner(base | 1 << u | 1 << v), leaf.corner(base | 1 << v)};
  if (side == 0) std::swap(corners[1], corners[3]);
  return corners;
}

class LeafMesher {
 public:
  LeafMesher(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso)
      : pyramid_(pyramid), leaves_(leaves), mesher_(iso) {}

  SplitMesh withCracks() {
    addCornersByRule6();
    forEachLeaf(pyramid_.lattice, leaves_, [&](const SplitLeaf& leaf) { meshWhole(leaf); });
    return std::move(mesher_.mesh());
  }

  SplitMesh withConformingSplit() {
    forEachLeaf(pyramid_.lattice, leaves_, [&](const SplitLeaf& leaf) {
      const std::int64_t before = mesher_.mesh().triangleCount();
      if (!hasHangingPoint(leaf)) {
        meshWhole(leaf);
      } else {
        meshSplit(leaf);
        mesher_.mesh().split_leaves += 1;
        mesher_.mesh().split_triangles += mesher_.mesh().triangleCount() - before;
      }
    });
    return std::move(mesher_.mesh());
  }

 private:
  static std::int64_t keyOf(const Lattice& lattice, const Index3& p) {
    return (p.z * lattice.voxels().y + p.y) * lattice.voxels().x + p.x;
  }

  void addCornersByRule6() {
    std::vector<Index3> corners;
    forEachLeaf(pyramid_.lattice, leaves_, [&](const SplitLeaf& leaf) {
      for (int i = 0; i < 8; ++i) corners.push_back(leaf.corner(i));
    });
    const std::vector<float> values = referenceValues(pyramid_, leaves_, corners);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const std::int64_t key = keyOf(pyramid_.lattice, corners[i]);
      if (!points_.contains(key))
        points_[key] = mesher_.addPoint(glm::dvec3(corners[i]), values[i]);
    }
  }

  // The point of a lattice point: the one that is there, or one with the sample of the finest leaf.
  PointId pointAt(const Index3& p) {
    const std::int64_t key = keyOf(pyramid_.lattice, p);
    const auto found = points_.find(key);
    if (found != points_.end()) return found->second;
    int finest = pyramid_.lattice.levels() - 1;
    for (int i = 0; i < 8; ++i)
      finest = std::min(finest, levelAt(p - Index3(i & 1, i >> 1 & 1, i >> 2)).value_or(finest));
    return points_[key] = mesher_.addPoint(glm::dvec3(p), pyramid_.sampleAtPosition(finest, p));
  }

  std::optional<int> levelAt(const Index3& cell) const {
    for (int axis = 0; axis < 3; ++axis)
      if (cell[axis] < 0 || cell[axis] >= leaves_.cells[axis]) return std::nullopt;
    return leaves_.leafLevelAt(cell);
  }

  // Where an edge of a leaf is halved by a finer leaf that touches it.
  std::optional<Index3> hangingPoint(const SplitLeaf& leaf, const Index3& a,
                                     const Index3& b) const {
    const int axis = a.x != b.x ? 0 : a.y != b.y ? 1 : 2;
    const Index3 low = glm::min(a, b);
    Index3 middle = low;
    middle[axis] += (std::int64_t{1} << leaf.level) / 2;
    if (leaf.level == 0 || middle[axis] >= std::max(a[axis], b[axis])) return std::nullopt;
    for (int i = 0; i < 4; ++i) {
      Index3 cell = low;
      cell[(axis + 1) % 3] -= i & 1;
      cell[(axis + 2) % 3] -= i >> 1;
      if (levelAt(cell).value_or(leaf.level) < leaf.level) return middle;
    }
    return std::nullopt;
  }

  bool hasHangingPoint(const SplitLeaf& leaf) const {
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        const auto corners = faceCorners(leaf, axis, side);
        for (std::size_t i = 0; i < 4; ++i)
          if (hangingPoint(leaf, corners[i], corners[(i + 1) % 4])) return true;
      }
    return false;
  }

  void meshWhole(const SplitLeaf& leaf) {
    std::vector<Polygon> faces;
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        Polygon& face = faces.emplace_back();
        for (const Index3& corner : faceCorners(leaf, axis, side)) face.push_back(pointAt(corner));
      }
    mesher_.meshPolyhedron(faces, leaf.level);
  }

  void meshSplit(const SplitLeaf& leaf) {
    glm::dvec3 place(0);
    double value = 0;
    for (int i = 0; i < 8; ++i) {
      const PointId corner = pointAt(leaf.corner(i));
      place += mesher_.at(corner) / 8.0;
      value += static_cast<double>(mesher_.value(corner)) / 8;
    }
    const PointId centre = mesher_.addPoint(place, static_cast<float>(value));
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side)
        for (const Polygon& base : cutFace(leaf, axis, side)) {
          std::vector<Polygon> faces = {base};
          for (std::size_t i = 0; i < base.size(); ++i)
            faces.push_back({base[(i + 1) % base.size()], base[i], centre});
          mesher_.meshPolyhedron(faces, leaf.level);
        }
  }

  // A face cut along its hanging points; what both sides see is the same, since nothing but the
  // pattern of hanging points decides, and each pattern is cut symmetrically.
  std::vector<Polygon> cutFace(const SplitLeaf& leaf, int axis, int side) {
    const std::array<Index3, 4> corners = faceCorners(leaf, axis, side);
    std::array<PointId, 4> c{};
    std::array<std::optional<PointId>, 4> m;  // m[i] halves the side from c[i] to c[i + 1]
    std::size_t halved = 0, first = 4, whole = 4;
    for (std::size_t i = 0; i < 4; ++i) {
      c[i] = pointAt(corners[i]);
      if (const auto middle = hangingPoint(leaf, corners[i], corners[(i + 1) % 4])) {
        m[i] = pointAt(*middle);
        ++halved;
        if (first == 4) first = i;
      } else {
        whole = i;
      }
    }
    // Turned so that the pattern begins at side i.
    const auto C = [&](std::size_t i) { return c[i % 4]; };
    const auto M = [&](std::size_t i) { return *m[i % 4]; };
    const std::size_t i = first;
    switch (halved) {
      case 0:
        return {{c[0], c[1], c[2], c[3]}};
      case 1:
        return {{M(i), C(i + 1), C(i + 2)}, {M(i), C(i + 2), C(i + 3)}, {M(i), C(i + 3), C(i)}};
      case 2:
        if (m[(i + 2) % 4])
          return {{C(i), M(i), M(i + 2), C(i + 3)}, {M(i), C(i + 1), C(i + 2), M(i + 2)}};
        return cutAtCorner(m[(i + 1) % 4] ? i : (i + 3) % 4, c, m);
      case 3: {
        const std::size_t w = whole;
        return {{C(w), C(w + 1), M(w + 1), M(w + 3)},
                {M(w + 1), C(w + 2), M(w + 2)},
                {M(w + 2), C(w + 3), M(w + 3)},
                {M(w + 1), M(w + 2), M(w + 3)}};
      }
      default:
        break;
    }
    std::vector<Polygon> pieces;
    if (isFaceHalved(leaf, axis, side)) {
      Index3 middle = corners[0];
      for (int j = 1; j <= 2; ++j)
        middle[(axis + j) % 3] = leaf.lower[(axis + j) % 3] + (std::int64_t{1} << leaf.level) / 2;
      const PointId centre = pointAt(middle);
      for (std::size_t j = 0; j < 4; ++j) pieces.push_back({C(j), M(j), centre, M(j + 3)});
    } else {
      for (std::size_t j = 0; j < 4; ++j) pieces.push_back({M(j + 3), C(j), M(j)});
      pieces.push_back({M(0), M(1), M(2), M(3)});
    }
    return pieces;
  }

  // The sides i and i + 1 are halved.
  static std::vector<Polygon> cutAtCorner(std::size_t i, const std::array<PointId, 4>& c,
                                          const std::array<std::optional<PointId>, 4>& m) {
    const PointId a = *m[i], b = *m[(i + 1) % 4], opposite = c[(i + 3) % 4];
    return {{a, c[(i + 1) % 4], b},
            {a, b, opposite},
            {b, c[(i + 2) % 4], opposite},
            {c[i], a, opposite}};
  }

  bool isFaceHalved(const SplitLeaf& leaf, int axis, int side) const {
    Index3 cell = leaf.lower;
    cell[axis] = side == 0 ? leaf.lower[axis] - 1 : leaf.upper[axis];
    return levelAt(cell).value_or(leaf.level) < leaf.level;
  }

  const ReferencePyramid& pyramid_;
  const LeafLevels& leaves_;
  PolyhedronMesher mesher_;
  std::unordered_map<std::int64_t, PointId> points_;  // by place
};

}  // namespace

SplitMesh crackedMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves, double iso) {
  return LeafMesher(pyramid, leaves, iso).withCracks();
}

SplitMesh conformingSplitMesh(const ReferencePyramid& pyramid, const LeafLevels& leaves,
                              double iso) {
  return LeafMesher(pyramid, leaves, iso).withConformingSplit();
}

}  // namespace isobrick::test
