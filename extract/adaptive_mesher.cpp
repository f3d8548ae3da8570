#include "extract/adaptive_mesher.h"

#include <algorithm>
#include <array>
#include <bit>

#include "extract/kernels/marching_cubes_table.h"
#include "extract/oracles/leaf_classifier.h"
#include "extract/sample_view.h"

namespace isobrick {
namespace {

// One end of an edge: the value that rule 6 gives the lattice point, and the samples its gradient
// comes from.
struct EdgeEnd {
  float value = 0;
  int level = 0;     // of the gradient: the finest of the leaves that touch the point
  Index3 sample{0};  // index in that level
};

// A contour through a transition cell: pieces from vertex to vertex. A face has at most four
// sub-faces with two pieces each.
struct Contour {
  std::array<std::uint32_t, 48> from{};
  std::array<std::uint32_t, 48> to{};
  std::size_t size = 0;

  void add(std::uint32_t a, std::uint32_t b) {
    from[size] = a;
    to[size] = b;
    ++size;
  }
};

}  // namespace

// One brick; T is the voxel type. Cells and samples without a level are those of `level_`.
template <typename T>
class AdaptiveMesher::Brick {
 public:
  Brick(AdaptiveMesher& memory, const MeshContext& context, const BrickWork& work, MeshBatch& batch)
      : m_(memory),
        context_(context),
        batch_(batch),
        layout_(context.pyramid.layout()),
        lattice_(context.lattice()),
        level_(work.level),
        brick_(work.brick),
        cells_(layout_.brickCellBox(level_, brick_)),
        last_sample_(lattice_.samples(level_) - Index3(1)),
        classifier_(context) {}

  void run() {
    const Index3 tiles = m_.tiles_.dims();
    Index3 tile;
    for (tile.z = 0; tile.z < tiles.z; ++tile.z)
      for (tile.y = 0; tile.y < tiles.y; ++tile.y)
        for (tile.x = 0; tile.x < tiles.x; ++tile.x)
          if (m_.tiles_.isActive(tile)) meshTile(tile);
  }

 private:
  void meshTile(const Index3& tile) {
    tile_.first = cells_.first + tile * layout_.tileCells();
    tile_.count = glm::min(Index3(layout_.tileCells()), cells_.end() - tile_.first);
    if (!overlapsQueryBox(context_, level_, tile_)) return;
    if (!classify()) return;
    resolveCorners();
    Index3 cell;
    for (cell.z = tile_.first.z; cell.z < tile_.end().z; ++cell.z)
      for (cell.y = tile_.first.y; cell.y < tile_.end().y; ++cell.y)
        for (cell.x = tile_.first.x; cell.x < tile_.end().x; ++cell.x)
          if (stateOf(cell) == CellState::kLeaf &&
              overlapsQueryBox(context_, level_, {cell, Index3(1)}))
            meshCell(cell);
  }

  // States of the tile's cells and of all that touch them. False where the tile has no leaf.
  bool classify() {
    if (!classifier_.mayHoldLeaf(level_, tile_)) return false;
    all_leaves_ = classifier_.areAllLeaves(level_, tile_);
    if (all_leaves_) return true;
    classifier_.classify(level_, {tile_.first - Index3(1), tile_.count + Index3(2)}, states_);
    return std::find(states_.begin(), states_.end(), CellState::kLeaf) != states_.end();
  }
  CellState stateOf(const Index3& cell) const {
    if (all_leaves_) return CellState::kLeaf;  // beyond the volume too, which changes nothing
    return states_[static_cast<std::size_t>(
        linearIndex(cell - tile_.first + Index3(1), tile_.count + Index3(2)))];
  }

  // Rule 6 for every corner of a leaf of the tile.
  void resolveCorners() {
    const Index3 dims = tile_.count + Index3(1);
    corners_.resize(static_cast<std::size_t>(elementCount(dims)));
    std::size_t at = 0;
    Index3 sample;
    for (sample.z = tile_.first.z; sample.z <= tile_.end().z; ++sample.z)
      for (sample.y = tile_.first.y; sample.y <= tile_.end().y; ++sample.y)
        for (sample.x = tile_.first.x; sample.x <= tile_.end().x; ++sample.x)
          resolveCorner(sample, corners_[at++]);
  }

  void resolveCorner(const Index3& sample, EdgeEnd& corner) {
    if (all_leaves_) {
      corner = {ownView().value(sample), level_, sample};
      return;
    }
    bool touches_leaf = false, touches_finer = false, touches_coarser = false;
    for (int n = 0; n < 8; ++n) {
      const CellState state = stateOf(sample - Index3(n & 1, n >> 1 & 1, n >> 2));
      touches_leaf = touches_leaf || state == CellState::kLeaf;
      touches_finer = touches_finer || state == CellState::kFiner;
      touches_coarser = touches_coarser || state == CellState::kCoarser;
    }
    if (!touches_leaf) return;  // of no leaf of this level: never asked for
    if (touches_finer) {
      // The finest of the touching leaves decides.
      const Index3 fine = glm::min(2L * sample, lattice_.samples(level_ - 1) - Index3(1));
      corner = {fineView(fine).value(fine), level_ - 1, fine};
      return;
    }
    corner = {touches_coarser ? hangingOrOwnValue(sample) : ownView().value(sample), level_,
              sample};
  }

  // The value of a sample that touches a coarser leaf: its own on the coarser lattice, else
  // interpolated on the coarser edge or face on which it hangs.
  float hangingOrOwnValue(const Index3& sample) {
    int odd[2];
    int odd_axes = 0;
    for (int axis = 0; axis < 3; ++axis)
      if (!isOnCoarserLattice(axis, sample[axis])) odd[odd_axes++] = axis;
    if (odd_axes == 0) return ownView().value(sample);
    const auto alongFirst = [&](Index3 at) {
      const int axis = odd[0];
      --at[axis];
      const auto low = static_cast<double>(ownView().value(at));
      at[axis] += 2;
      return hangingValue(low, static_cast<double>(ownView().value(at)),
                          hangingWeight(level_, axis, sample[axis]));
    };
    if (odd_axes == 1) return static_cast<float>(alongFirst(sample));
    Index3 low = sample, high = sample;
    --low[odd[1]];
    ++high[odd[1]];
    return static_cast<float>(hangingValue(alongFirst(low), alongFirst(high),
                                           hangingWeight(level_, odd[1], sample[odd[1]])));
  }
  bool isOnCoarserLattice(int axis, std::int64_t i) const {
    return i % 2 == 0 || i == last_sample_[axis];
  }
  // Where sample `i` of `level`, an odd one, lies between its neighbours: 1/2, but for a thin last
  // cell.
  double hangingWeight(int level, int axis, std::int64_t i) const {
    const auto low = static_cast<double>(lattice_.position(level, axis, i - 1));
    const auto middle = static_cast<double>(lattice_.position(level, axis, i));
    const auto high = static_cast<double>(lattice_.position(level, axis, i + 1));
    return (middle - low) / (high - low);
  }

  const EdgeEnd& corner(const Index3& sample) const {
    return corners_[static_cast<std::size_t>(
        linearIndex(sample - tile_.first, tile_.count + Index3(1)))];
  }

  void meshCell(const Index3& cell) {
    unsigned pattern = 0;
    for (unsigned c = 0; c < 8; ++c)
      if (isInside(corner(cell + Index3(c & 1, c >> 1 & 1, c >> 2)).value)) pattern |= 1u << c;
    if (pattern == 0 || pattern == 255) return;
    ++batch_.cells;

    const MarchingCubesCase& mc = marchingCubesTable()[pattern];
    std::uint32_t vertex[kCellEdges];
    for (std::uint32_t rest = mc.crossed_edges; rest != 0; rest &= rest - 1) {
      const int e = std::countr_zero(rest);
      const CellEdge& edge = kCellEdgeTable[static_cast<std::size_t>(e)];
      vertex[e] = leafEdgeVertex(cell + Index3(edge.x, edge.y, edge.z), edge.axis);
    }
    bool has_transition = false;
    bool is_transition[6];
    for (int face = 0; face < 6; ++face) {
      Index3 neighbour = cell;
      neighbour[face / 2] += face % 2 == 0 ? -1 : 1;
      is_transition[face] = stateOf(neighbour) == CellState::kFiner;
      has_transition = has_transition || is_transition[face];
    }
    if (has_transition) {
      meshTransitionCell(cell, is_transition, vertex);
      return;
    }
    for (std::size_t t = 0; t < 3u * mc.triangle_count; t += 3)
      addTriangle(vertex[mc.edges[t]], vertex[mc.edges[t + 1]], vertex[mc.edges[t + 2]]);
  }

  bool isInside(float value) const { return value >= context_.isovalue; }

  void addTriangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (context_.frame.mirrored()) std::swap(b, c);
    batch_.triangles.insert(batch_.triangles.end(), {a, b, c});
  }

  // The vertex on an edge of a leaf of this level.
  std::uint32_t leafEdgeVertex(const Index3& base, int axis) {
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    bool shared = isOnBrickBorder(b, base[b]) || isOnBrickBorder(c, base[c]);
    bool touches_coarser = false;
    for (int n = 0; n < 4 && !all_leaves_; ++n) {
      Index3 around = base;
      around[b] -= n & 1;
      around[c] -= n >> 1;
      const CellState state = stateOf(around);
      touches_coarser = touches_coarser || state == CellState::kCoarser;
      shared = shared || state != CellState::kLeaf;
    }
    Index3 low = base, high = base;
    ++high[axis];
    if (touches_coarser && isOnCoarserLattice(b, base[b]) && isOnCoarserLattice(c, base[c])) {
      // Half of a coarser leaf's edge: that edge's crossing, from its two ends (rule 8).
      low[axis] = base[axis] / 2 * 2;
      high[axis] = std::min(low[axis] + 2, last_sample_[axis]);
      return vertexOn(level_, low, high, axis, {ownView().value(low), level_, low},
                      {ownView().value(high), level_, high}, true);
    }
    return vertexOn(level_, low, high, axis, corner(low), corner(high), shared);
  }

  bool isOnBrickBorder(int axis, std::int64_t i) const {
    return i == cells_.first[axis] || i == cells_.first[axis] + cells_.count[axis];
  }

  // The vertex between two samples of `level`, made where the brick does not have it yet.
  std::uint32_t vertexOn(int level, const Index3& low_sample, const Index3& high_sample, int axis,
                         const EdgeEnd& low, const EdgeEnd& high, bool shared) {
    const Index3 base = lattice_.position(level, low_sample);
    const EdgeKey key = makeEdgeKey(base, axis);
    bool inserted = false;
    const std::uint32_t number = m_.vertices_.findOrInsert(
        key, static_cast<std::uint32_t>(batch_.positions.size()), &inserted);
    if (!inserted) return number;
    const double t = crossingParameter(context_.isovalue, low.value, high.value);
    glm::dvec3 index(base);
    const auto from = static_cast<double>(base[axis]);
    const auto to = static_cast<double>(lattice_.position(level, axis, high_sample[axis]));
    index[axis] = from + t * (to - from);
    batch_.positions.push_back(context_.frame.position(index));
    batch_.normals.push_back(context_.frame.normal(gradientAt(gradientOf(low), gradientOf(high), t),
                                                   axis, isInside(low.value)));
    if (shared) batch_.shared.push_back({number, key});
    return number;
  }
  glm::dvec3 gradientOf(const EdgeEnd& end) {
    return (end.level == level_ ? ownView() : fineView(end.sample)).gradient(end.sample);
  }

  // Rule 10: the contour follows the fine side's polyline on every transition face, and every loop
  // becomes a fan.
  void meshTransitionCell(const Index3& cell, const bool (&is_transition)[6],
                          const std::uint32_t (&vertex)[kCellEdges]) {
    ++batch_.transition_cells;
    Contour contour;
    for (int face = 0; face < 6; ++face) {
      if (is_transition[face])
        addTransitionFace(cell, face / 2, face % 2, vertex, contour);
      else
        addPlainFace(cell, face / 2, face % 2, vertex, contour);
    }
    std::array<bool, 48> used{};
    std::array<std::uint32_t, 48> loop;
    for (std::size_t start = 0; start < contour.size; ++start) {
      std::size_t length = 0;
      for (std::size_t at = start; !used[at];) {
        used[at] = true;
        loop[length++] = contour.from[at];
        for (std::size_t next = 0; next < contour.size; ++next)
          if (contour.from[next] == contour.to[at]) {
            at = next;
            break;
          }
      }
      if (length > 0) addFan(cell, loop.data(), length);
    }
  }

  void addPlainFace(const Index3& cell, int axis, int side,
                    const std::uint32_t (&vertex)[kCellEdges], Contour& contour) {
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    Index3 at[4];
    bool inside[4];
    for (int i = 0; i < 4; ++i) {
      at[i] = Index3(0);
      at[i][axis] = side;
      at[i][b] = kFaceLoop[side][i].b;
      at[i][c] = kFaceLoop[side][i].c;
      inside[i] = isInside(corner(cell + at[i]).value);
    }
    const auto vertexBetween = [&](int i, int j) {
      const Index3 low = glm::min(at[i], at[j]);
      const int along = at[i][b] != at[j][b] ? b : c;
      return vertex[edgeNumber(along, static_cast<int>(low.x), static_cast<int>(low.y),
                               static_cast<int>(low.z))];
    };
    forEachFaceSegment(inside, [&](int i, int j) {
      contour.add(vertexBetween((i + 3) % 4, i), vertexBetween(j, (j + 1) % 4));
    });
  }

  // The fine side of one face: 2x2 sub-faces, fewer where the cell is too thin to be halved, on a
  // lattice of 3x3 points whose values the face's four corners determine (rule 6).
  void addTransitionFace(const Index3& cell, int axis, int side,
                         const std::uint32_t (&vertex)[kCellEdges], Contour& contour) {
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    const Index3 fine_last = lattice_.samples(level_ - 1) - Index3(1);
    const int parts_b = 2 * cell[b] + 2 <= fine_last[b] ? 2 : 1;
    const int parts_c = 2 * cell[c] + 2 <= fine_last[c] ? 2 : 1;

    // Point (i, j), 0 .. parts: an index in the finer level, and its value.
    const auto sampleAt = [&](int i, int j) {
      Index3 fine = 2L * cell;
      fine[axis] = std::min(2 * (cell[axis] + side), fine_last[axis]);
      fine[b] += i;
      fine[c] += j;
      return fine;
    };
    const auto cornerAt = [&](int i, int j) {  // 0 or 1 each
      Index3 at = cell;
      at[axis] += side;
      at[b] += i;
      at[c] += j;
      return static_cast<double>(corner(at).value);
    };
    // One interpolation order for both sides of the face: the lower axis first.
    const auto valueAt = [&](int i, int j) {
      const bool middle_b = parts_b == 2 && i == 1, middle_c = parts_c == 2 && j == 1;
      const int corner_b = i == 0 ? 0 : 1, corner_c = j == 0 ? 0 : 1;
      const auto alongB = [&](int at_c) {
        return hangingValue(cornerAt(0, at_c), cornerAt(1, at_c),
                            hangingWeight(level_ - 1, b, 2 * cell[b] + 1));
      };
      const auto alongC = [&](int at_b) {
        return hangingValue(cornerAt(at_b, 0), cornerAt(at_b, 1),
                            hangingWeight(level_ - 1, c, 2 * cell[c] + 1));
      };
      if (middle_b && middle_c)
        return static_cast<float>(
            b < c
                ? hangingValue(alongB(0), alongB(1), hangingWeight(level_ - 1, c, 2 * cell[c] + 1))
                : hangingValue(alongC(0), alongC(1),
                               hangingWeight(level_ - 1, b, 2 * cell[b] + 1)));
      if (middle_b) return static_cast<float>(alongB(corner_c));
      if (middle_c) return static_cast<float>(alongC(corner_b));
      return static_cast<float>(cornerAt(corner_b, corner_c));
    };
    float value[3][3];
    for (int j = 0; j <= parts_c; ++j)
      for (int i = 0; i <= parts_b; ++i) value[j][i] = valueAt(i, j);

    // The vertex on the fine edge between two neighbouring points.
    const auto vertexBetween = [&](int i0, int j0, int i1, int j1) {
      const int i = std::min(i0, i1), j = std::min(j0, j1);
      const bool along_b = i0 != i1;
      const bool on_cell_edge = along_b ? j == 0 || j == parts_c : i == 0 || i == parts_b;
      if (on_cell_edge) {
        int at[3] = {0, 0, 0};
        at[axis] = side;
        at[along_b ? c : b] = along_b ? (j == 0 ? 0 : 1) : (i == 0 ? 0 : 1);
        return vertex[edgeNumber(along_b ? b : c, at[0], at[1], at[2])];
      }
      const Index3 low = sampleAt(i, j);
      const Index3 high = sampleAt(i + (along_b ? 1 : 0), j + (along_b ? 0 : 1));
      return vertexOn(level_ - 1, low, high, along_b ? b : c, {value[j][i], level_ - 1, low},
                      {value[j + (along_b ? 0 : 1)][i + (along_b ? 1 : 0)], level_ - 1, high},
                      true);
    };
    for (int sub_c = 0; sub_c < parts_c; ++sub_c)
      for (int sub_b = 0; sub_b < parts_b; ++sub_b) {
        int i[4], j[4];
        bool inside[4];
        for (int n = 0; n < 4; ++n) {
          i[n] = sub_b + kFaceLoop[side][n].b;
          j[n] = sub_c + kFaceLoop[side][n].c;
          inside[n] = isInside(value[j[n]][i[n]]);
        }
        const auto between = [&](int m, int n) { return vertexBetween(i[m], j[m], i[n], j[n]); };
        forEachFaceSegment(inside, [&](int m, int n) {
          contour.add(between((m + 3) % 4, m), between(n, (n + 1) % 4));
        });
      }
  }

  void addFan(const Index3& cell, const std::uint32_t* loop, std::size_t length) {
    glm::dvec3 center(0.0), normal(0.0);
    for (std::size_t i = 0; i < length; ++i) {
      center += batch_.positions[loop[i]];
      normal += glm::dvec3(batch_.normals[loop[i]]);
    }
    center /= static_cast<double>(length);
    if (hasFlatTriangle(center, loop, length)) {
      // Every piece of the loop lies in a face of the cell, so the cell's own centre sees all of
      // them from a height.
      const glm::dvec3 low(lattice_.position(level_, cell));
      const glm::dvec3 high(lattice_.position(level_, cell + Index3(1)));
      center = context_.frame.position(0.5 * (low + high));
    }
    const double norm = std::sqrt(glm::dot(normal, normal));
    const auto number = static_cast<std::uint32_t>(batch_.positions.size());
    batch_.positions.push_back(center);
    batch_.normals.push_back(norm > 1e-6 ? glm::vec3(normal / norm) : batch_.normals[loop[0]]);
    for (std::size_t i = 0; i < length; ++i) addTriangle(number, loop[i], loop[(i + 1) % length]);
  }
  bool hasFlatTriangle(const glm::dvec3& center, const std::uint32_t* loop,
                       std::size_t length) const {
    for (std::size_t i = 0; i < length; ++i) {
      const glm::dvec3 area = glm::cross(batch_.positions[loop[i]] - center,
                                         batch_.positions[loop[(i + 1) % length]] - center);
      if (!(glm::dot(area, area) > 0)) return true;
    }
    return false;
  }

  // The brick's own samples, asked for when the first tile needs them.
  const SampleView<T>& ownView() {
    if (!own_) own_.emplace(hold(level_, brick_));
    return own_->view;
  }
  // Samples of the finer level around its sample `fine`, a point of this brick.
  const SampleView<T>& fineView(const Index3& fine) {
    const Index3 first = 2L * brick_;
    const Index3 last = glm::min(first + Index3(1), layout_.bricks(level_ - 1) - Index3(1));
    const Index3 child = glm::min(fine / layout_.brickCells(), last) - first;
    auto& slot = children_[static_cast<std::size_t>(child.x + 2 * child.y + 4 * child.z)];
    if (!slot) slot.emplace(hold(level_ - 1, first + child));
    return slot->view;
  }

  struct HeldBrick {
    BrickSamples samples;
    SampleView<T> view;
  };
  HeldBrick hold(int level, const Index3& brick) {
    BrickSamples samples = context_.samples(level, brick);
    SampleView<T> view(lattice_, level, samples.box, samples.template data<T>());
    return {std::move(samples), std::move(view)};
  }

  AdaptiveMesher& m_;
  const MeshContext& context_;
  MeshBatch& batch_;
  const BrickLayout& layout_;
  const Lattice& lattice_;
  const int level_;
  const Index3 brick_;
  const IndexBox cells_;
  const Index3 last_sample_;
  LeafClassifier classifier_;
  std::optional<HeldBrick> own_;
  std::array<std::optional<HeldBrick>, 8> children_;
  // The tile at hand.
  IndexBox tile_;
  bool all_leaves_ = false;  // then states_ is not filled
  std::vector<CellState> states_;
  std::vector<EdgeEnd> corners_;
};

void AdaptiveMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  vertices_.clear();
  if (!tiles_.load(context, work.level, work.brick)) return;
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Brick<typename decltype(tag)::Type>(*this, context, work, batch).run();
  });
}

}  // namespace isobrick
