#include "tests/support/mesh_checker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <sstream>
#include <stdexcept>

namespace isobrick::test {

namespace {

constexpr std::size_t kMaxExamples = 8;

// Union-find over 0 .. size-1.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t size) : parent_(size) {
    for (std::size_t i = 0; i < size; ++i) parent_[i] = static_cast<std::uint32_t>(i);
  }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) {
      parent_[i] = parent_[parent_[i]];
      i = parent_[i];
    }
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    // The smaller becomes the root: deterministic, and good enough in practice.
    if (a < b) parent_[b] = a;
    if (b < a) parent_[a] = b;
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// Items with a small integer key, grouped by key with one counting pass: group k is
// items[begin[k] .. begin[k+1]).
template <typename Item>
struct Groups {
  std::vector<std::uint32_t> begin;
  std::vector<Item> items;

  std::span<Item> of(std::size_t key) {
    return std::span<Item>(items).subspan(begin[key], begin[key + 1] - begin[key]);
  }
};

// `visit(add)` calls add(key, item) for all items; it is called twice.
template <typename Item, typename Visit>
Groups<Item> groupByKey(std::size_t keys, Visit&& visit) {
  Groups<Item> groups;
  groups.begin.assign(keys + 1, 0);
  visit([&](std::uint32_t key, const Item&) { ++groups.begin[key + 1]; });
  for (std::size_t k = 0; k < keys; ++k) groups.begin[k + 1] += groups.begin[k];
  groups.items.resize(groups.begin[keys]);
  std::vector<std::uint32_t> fill(groups.begin.begin(), groups.begin.end() - 1);
  visit([&](std::uint32_t key, const Item& item) { groups.items[fill[key]++] = item; });
  return groups;
}

// One of a triangle's three edges, filed under its smaller vertex.
struct HalfEdge {
  std::uint32_t larger = 0;  // the larger vertex
  std::uint32_t corner = 0;  // index into `triangles` of the vertex that it starts from
};

std::uint32_t nextCorner(std::uint32_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }

template <typename Position>
class Checker {
 public:
  Checker(std::span<const Position> positions, std::span<const std::uint32_t> triangles,
          const MeshCheckOptions& options)
      : positions_(positions), triangles_(triangles), options_(options) {
    if (triangles.size() >= std::numeric_limits<std::uint32_t>::max() ||
        positions.size() >= std::numeric_limits<std::uint32_t>::max()) {
      throw std::invalid_argument("mesh checker: more than 2^32 vertices or corners");
    }
  }

  MeshReport run() {
    report_.vertices = static_cast<std::int64_t>(positions_.size());
    report_.triangles = static_cast<std::int64_t>(triangles_.size() / 3);
    if (!checkIndices()) return report_;
    checkVertices();
    checkAreas();
    checkDuplicateTriangles();
    checkEdges();
    countDuplicatePositions();
    if (report_.ok()) {
      const std::int64_t twice = 2 * report_.components - report_.euler - report_.border_loops;
      if (twice % 2 == 0) report_.genus = twice / 2;
    }
    return report_;
  }

 private:
  glm::dvec3 at(std::uint32_t vertex) const { return glm::dvec3(positions_[vertex]); }

  // Calls write(stream) for one of the first few faults.
  template <typename Write>
  void example(Write&& write) {
    if (report_.examples.size() >= kMaxExamples) return;
    std::ostringstream text;
    text.precision(9);
    write(text);
    report_.examples.push_back(text.str());
  }
  void describeVertex(std::ostream& out, std::uint32_t v) const {
    const glm::dvec3 p = at(v);
    out << v << " (" << p.x << ", " << p.y << ", " << p.z << ")";
  }
  void describeTriangle(std::ostream& out, std::size_t corner) const {
    out << "triangle " << corner / 3 << ":";
    for (std::size_t i = 0; i < 3; ++i) {
      out << " ";
      describeVertex(out, triangles_[corner + i]);
    }
  }

  bool isUsable(std::size_t first) const {
    const std::uint32_t a = triangles_[first], b = triangles_[first + 1], c = triangles_[first + 2];
    return a != b && b != c && c != a;
  }
  // f(first): index of the triangle's first corner; triangles that repeat an index are left out.
  template <typename F>
  void forEachTriangle(F&& f) const {
    for (std::size_t first = 0; first + 2 < triangles_.size(); first += 3) {
      if (isUsable(first)) f(first);
    }
  }

  bool checkIndices() {
    report_.partial_triangles = triangles_.size() % 3 != 0;
    for (const std::uint32_t index : triangles_) report_.bad_indices += index >= positions_.size();
    if (report_.partial_triangles > 0 || report_.bad_indices > 0) return false;

    std::vector<bool> is_used(positions_.size());
    for (const std::uint32_t index : triangles_) is_used[index] = true;
    for (std::uint32_t v = 0; v < is_used.size(); ++v) {
      if (is_used[v]) continue;
      ++report_.unreferenced_vertices;
      example([&](std::ostream& out) {
        out << "unreferenced vertex ";
        describeVertex(out, v);
      });
    }
    for (std::size_t first = 0; first < triangles_.size(); first += 3) {
      if (isUsable(first)) continue;
      ++report_.repeated_indices;
      example([&](std::ostream& out) {
        out << "repeated index in ";
        describeTriangle(out, first);
      });
    }
    return true;
  }

  // Bit 2 * axis + side for each plane of the box that the vertex is on; where it is outside, that
  // is recorded.
  void checkVertices() {
    border_.assign(positions_.size(), 0);
    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      const glm::dvec3 p = at(v);
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        ++report_.nonfinite_vertices;
        continue;
      }
      if (!options_.box) continue;
      const glm::dvec3 q = options_.to_box_matrix * (p - options_.to_box_origin);
      bool is_outside = false;
      for (int axis = 0; axis < 3; ++axis) {
        const double below = options_.box->lower[axis] - q[axis];
        const double above = q[axis] - options_.box->upper[axis];
        is_outside = is_outside || below > options_.tolerance || above > options_.tolerance;
        const unsigned on_lower = std::abs(below) <= options_.tolerance;
        const unsigned on_upper = std::abs(above) <= options_.tolerance;
        border_[v] = static_cast<std::uint8_t>(border_[v] | on_lower << (2 * axis) |
                                               on_upper << (2 * axis + 1));
      }
      if (!is_outside) continue;
      ++report_.outside_vertices;
      example([&](std::ostream& out) {
        out << "outside the box: vertex ";
        describeVertex(out, v);
      });
    }
  }

  void checkAreas() {
    if (triangles_.empty()) return;
    report_.smallest_area = std::numeric_limits<double>::infinity();
    // Volume is summed from a vertex of the mesh, not from a far-away origin.
    const glm::dvec3 reference = at(triangles_[0]);
    forEachTriangle([&](std::size_t first) {
      const glm::dvec3 a = at(triangles_[first]) - reference;
      const glm::dvec3 b = at(triangles_[first + 1]) - reference;
      const glm::dvec3 c = at(triangles_[first + 2]) - reference;
      const glm::dvec3 ab = at(triangles_[first + 1]) - at(triangles_[first]);
      const glm::dvec3 ac = at(triangles_[first + 2]) - at(triangles_[first]);
      const double area = 0.5 * glm::length(glm::cross(ab, ac));
      report_.area += area;
      report_.volume += glm::dot(a, glm::cross(b, c)) / 6.0;
      report_.smallest_area = std::min(report_.smallest_area, area);
      if (area > 0 && std::isfinite(area)) return;
      ++report_.zero_area_triangles;
      example([&](std::ostream& out) {
        out << "zero area: ";
        describeTriangle(out, first);
      });
    });
    if (!std::isfinite(report_.smallest_area)) report_.smallest_area = 0;
  }

  void checkDuplicateTriangles() {
    struct Rest {
      std::uint32_t middle = 0, largest = 0;
    };
    auto groups = groupByKey<Rest>(positions_.size(), [&](auto&& add) {
      forEachTriangle([&](std::size_t first) {
        std::array<std::uint32_t, 3> v = {triangles_[first], triangles_[first + 1],
                                          triangles_[first + 2]};
        std::sort(v.begin(), v.end());
        add(v[0], Rest{v[1], v[2]});
      });
    });
    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      std::span<Rest> group = groups.of(v);
      auto key = [](const Rest& r) { return std::uint64_t{r.middle} << 32 | r.largest; };
      std::sort(group.begin(), group.end(),
                [&](const Rest& a, const Rest& b) { return key(a) < key(b); });
      for (std::size_t i = 1; i < group.size(); ++i) {
        if (key(group[i - 1]) != key(group[i])) continue;
        ++report_.duplicate_triangles;
        example([&](std::ostream& out) {
          out << "duplicate triangle of vertices " << v << " " << group[i].middle << " "
              << group[i].largest;
        });
      }
    }
  }

  // Edges, orientation, components, border loops, and the fans around vertices.
  void checkEdges() {
    auto groups = groupByKey<HalfEdge>(positions_.size(), [&](auto&& add) {
      forEachTriangle([&](std::size_t first) {
        for (auto corner = static_cast<std::uint32_t>(first); corner < first + 3; ++corner) {
          const std::uint32_t a = triangles_[corner];
          const std::uint32_t b = triangles_[nextCorner(corner)];
          add(std::min(a, b), HalfEdge{std::max(a, b), corner});
        }
      });
    });

    DisjointSets corners(triangles_.size());      // joined: neighbours in the fan of one vertex
    DisjointSets vertices(positions_.size());     // joined: in one component
    DisjointSets border_ends(positions_.size());  // joined: along one border loop
    std::vector<bool> is_border_end(positions_.size());

    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      std::span<HalfEdge> group = groups.of(v);
      std::sort(group.begin(), group.end(), [](const HalfEdge& a, const HalfEdge& b) {
        return a.larger != b.larger ? a.larger < b.larger : a.corner < b.corner;
      });
      for (std::size_t i = 0; i < group.size();) {
        std::size_t end = i + 1;
        while (end < group.size() && group[end].larger == group[i].larger) ++end;
        const std::span<const HalfEdge> uses = group.subspan(i, end - i);
        i = end;
        const std::uint32_t w = uses[0].larger;
        ++report_.edges;
        vertices.join(v, w);
        for (const HalfEdge& use : uses.subspan(1)) joinFans(corners, uses[0], use);
        if (uses.size() == 1) {
          checkOpenEdge(v, w);
          border_ends.join(v, w);
          is_border_end[v] = is_border_end[w] = true;
        } else {
          checkSharedEdge(v, w, uses);
        }
      }
    }
    countComponents(corners, vertices, border_ends, is_border_end);
  }

  void joinFans(DisjointSets& corners, const HalfEdge& a, const HalfEdge& b) {
    const bool same_way = triangles_[a.corner] == triangles_[b.corner];
    const std::uint32_t a_end = nextCorner(a.corner);
    const std::uint32_t b_end = nextCorner(b.corner);
    corners.join(a.corner, same_way ? b.corner : b_end);
    corners.join(a_end, same_way ? b_end : b.corner);
  }

  void checkOpenEdge(std::uint32_t v, std::uint32_t w) {
    if ((border_[v] & border_[w]) != 0) {
      ++report_.border_edges;
      return;
    }
    ++report_.open_edges;
    example([&](std::ostream& out) { describeEdge(out, "open edge ", v, w); });
  }

  void checkSharedEdge(std::uint32_t v, std::uint32_t w, std::span<const HalfEdge> uses) {
    if (uses.size() > 2) {
      ++report_.nonmanifold_edges;
      example([&](std::ostream& out) {
        out << "used by " << uses.size() << " triangles: ";
        describeEdge(out, "edge ", v, w);
      });
    } else if (triangles_[uses[0].corner] == triangles_[uses[1].corner]) {
      ++report_.misoriented_edges;
      example([&](std::ostream& out) { describeEdge(out, "misoriented edge ", v, w); });
    }
  }

  void describeEdge(std::ostream& out, const char* what, std::uint32_t v, std::uint32_t w) const {
    out << what;
    describeVertex(out, v);
    out << " - ";
    describeVertex(out, w);
  }

  void countComponents(DisjointSets& corners, DisjointSets& vertices, DisjointSets& border_ends,
                       const std::vector<bool>& is_border_end) {
    std::vector<std::uint8_t> fans(positions_.size(), 0);
    std::int64_t used_triangles = 0;
    forEachTriangle([&](std::size_t first) {
      ++used_triangles;
      for (auto corner = static_cast<std::uint32_t>(first); corner < first + 3; ++corner) {
        std::uint8_t& count = fans[triangles_[corner]];
        if (corners.find(corner) == corner && count < 255) ++count;
      }
    });
    std::int64_t used_vertices = 0;
    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      if (fans[v] == 0) continue;
      ++used_vertices;
      report_.components += vertices.find(v) == v;
      report_.border_loops += is_border_end[v] && border_ends.find(v) == v;
      if (fans[v] == 1) continue;
      ++report_.pinched_vertices;
      example([&](std::ostream& out) {
        out << "more than one fan of triangles at vertex ";
        describeVertex(out, v);
      });
    }
    report_.euler = used_vertices - report_.edges + used_triangles;
  }

  void countDuplicatePositions() {
    std::vector<std::array<double, 3>> sorted;
    sorted.reserve(positions_.size());
    for (std::uint32_t v = 0; v < positions_.size(); ++v) {
      const glm::dvec3 p = at(v);
      // A NaN would break the order; non-finite vertices are faults of their own.
      if (std::isfinite(p.x + p.y + p.z)) sorted.push_back({p.x, p.y, p.z});
    }
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t i = 1; i < sorted.size(); ++i) {
      report_.duplicate_positions += sorted[i - 1] == sorted[i];
    }
  }

  const std::span<const Position> positions_;
  const std::span<const std::uint32_t> triangles_;
  const MeshCheckOptions& options_;
  std::vector<std::uint8_t> border_;  // per vertex, see checkVertices
  MeshReport report_;
};

}  // namespace

MeshCheckOptions boxOptions(const glm::dvec3& lower, const glm::dvec3& upper) {
  MeshCheckOptions options;
  options.box = MeshBox{lower, upper};
  return options;
}

MeshCheckOptions indexOptions(const Index3& voxels) {
  return boxOptions(glm::dvec3(0), glm::dvec3(voxels - Index3(1)));
}

MeshCheckOptions volumeOptions(const GridGeometry& geometry, const Index3& voxels) {
  MeshCheckOptions options = indexOptions(voxels);
  options.to_box_matrix = glm::inverse(geometry.indexToWorldMatrix());
  options.to_box_origin = geometry.origin;
  return options;
}

bool MeshReport::ok() const {
  return partial_triangles == 0 && bad_indices == 0 && repeated_indices == 0 && open_edges == 0 &&
         misoriented_edges == 0 && nonmanifold_edges == 0 && pinched_vertices == 0 &&
         duplicate_triangles == 0 && zero_area_triangles == 0 && unreferenced_vertices == 0 &&
         nonfinite_vertices == 0 && outside_vertices == 0;
}

std::string MeshReport::summary() const {
  std::ostringstream out;
  out.precision(9);
  out << (ok() ? "OK" : "NOT OK") << ": " << vertices << " vertices, " << edges << " edges, "
      << triangles << " triangles\n";
  auto fault = [&](std::int64_t count, const char* what) {
    if (count > 0) out << "  FAULT " << count << " " << what << "\n";
  };
  fault(partial_triangles, "index list is no multiple of 3; nothing else was checked");
  fault(bad_indices, "indices past the last vertex; nothing else was checked");
  fault(repeated_indices, "triangles that repeat an index");
  fault(open_edges, "open edges away from the border");
  fault(misoriented_edges, "edges used twice the same way");
  fault(nonmanifold_edges, "edges in more than two triangles");
  fault(pinched_vertices, "vertices with more than one fan of triangles");
  fault(duplicate_triangles, "duplicate triangles");
  fault(zero_area_triangles, "triangles of zero or non-finite area");
  fault(unreferenced_vertices, "unreferenced vertices");
  fault(nonfinite_vertices, "vertices that are not finite");
  fault(outside_vertices, "vertices outside the box");
  for (const std::string& line : examples) out << "    " << line << "\n";
  out << "  area " << area << ", volume " << volume << ", smallest triangle " << smallest_area
      << "\n  euler " << euler << ", components " << components << ", genus ";
  if (genus) {
    out << *genus;
  } else {
    out << "-";
  }
  out << ", border loops " << border_loops << " (" << border_edges << " edges)"
      << ", duplicate positions " << duplicate_positions << "\n";
  return out.str();
}

MeshReport checkMesh(std::span<const glm::vec3> positions, std::span<const std::uint32_t> triangles,
                     const MeshCheckOptions& options) {
  return Checker<glm::vec3>(positions, triangles, options).run();
}

MeshReport checkMesh(std::span<const glm::dvec3> positions,
                     std::span<const std::uint32_t> triangles, const MeshCheckOptions& options) {
  return Checker<glm::dvec3>(positions, triangles, options).run();
}

}  // namespace isobrick::test
