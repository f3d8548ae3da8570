#include "isobrick/extract/uniform_mesher.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "isobrick/extract/kernels/contour.h"
#include "isobrick/extract/kernels/marching_cubes_table.h"
#include "isobrick/extract/missing_vertex.h"
#include "isobrick/extract/sample_view.h"

namespace isobrick {
namespace {

// Edges that a cell is the first to touch when cells come x first, then y, then z: those away from
// the cells before it. Bit 0, 1, 2 of the index: the cell is the first along x, y, z.
constexpr std::array<std::uint16_t, 8> makeFirstTouches() {
  std::array<std::uint16_t, 8> masks{};
  for (int first = 0; first < 8; ++first)
    for (int e = 0; e < kCellEdges; ++e) {
      const CellEdge& edge = kCellEdgeTable[static_cast<std::size_t>(e)];
      const int at[3] = {edge.x, edge.y, edge.z};
      bool is_new = true;
      for (int axis = 0; axis < 3; ++axis)
        if (axis != edge.axis && at[axis] == 0 && (first >> axis & 1) == 0) is_new = false;
      if (is_new)
        masks[static_cast<std::size_t>(first)] =
            static_cast<std::uint16_t>(masks[static_cast<std::size_t>(first)] | 1 << e);
    }
  return masks;
}
constexpr std::array<std::uint16_t, 8> kFirstTouches = makeFirstTouches();

}  // namespace

// The sweep over one brick; T is the voxel type. Local coordinates count from the brick's first
// cell.
template <typename T>
class UniformMesher::Sweep {
 public:
  Sweep(UniformMesher& memory, const MeshContext& context, const BrickWork& work,
        const BrickSamples& samples, MeshBatch& batch)
      : m_(memory),
        context_(context),
        work_(work),
        batch_(batch),
        cells_(context.pyramid.layout().brickCellBox(work.level, work.brick)),
        view_(context.lattice(), work.level, samples.box, samples.data<T>()),
        inset_(cells_.first - samples.box.first),
        nx_(cells_.count.x),
        ny_(cells_.count.y),
        nz_(cells_.count.z),
        tile_cells_(context.pyramid.layout().tileCells()) {
    for (int axis = 0; axis < 3; ++axis)
      for (std::int64_t i = 0; i <= cells_.count[axis]; ++i)
        positions_[axis].push_back(static_cast<double>(
            context.lattice().position(work.level, axis, cells_.first[axis] + i)));
  }

  void run() {
    resizeMemory();
    findActiveRows();
    for (std::int64_t k = 0; k < nz_; ++k) {
      if (!layerIsActive(k)) continue;
      if (k == 0 || !layerIsActive(k - 1)) computeSigns(k);
      computeSigns(k + 1);
      for (std::int64_t j = 0; j < ny_; ++j)
        if (rowIsActive(j, k)) {
          forgetEdgesOfInactiveRows(j, k);
          meshRow(j, k);
        }
    }
  }

 private:
  void resizeMemory() {
    const auto samples = static_cast<std::size_t>((nx_ + 1) * (ny_ + 1));
    for (auto& slice : m_.signs_) slice.resize(samples);
    for (auto& slice : m_.x_edges_) slice.resize(samples);
    for (auto& slice : m_.y_edges_) slice.resize(samples);
    m_.z_edges_.resize(samples);
    m_.columns_.resize(static_cast<std::size_t>(nx_ + 1));
    // Eight patterns are looked at together.
    m_.patterns_.assign(static_cast<std::size_t>(nx_ + 7) / 8 * 8, 0);
  }

  void findActiveRows() {
    const Index3 tiles = m_.tiles_.dims();
    m_.active_rows_.assign(static_cast<std::size_t>(tiles.y * tiles.z), 0);
    Index3 tile;
    for (tile.z = 0; tile.z < tiles.z; ++tile.z)
      for (tile.y = 0; tile.y < tiles.y; ++tile.y)
        for (tile.x = 0; tile.x < tiles.x; ++tile.x)
          if (m_.tiles_.isActive(tile))
            m_.active_rows_[static_cast<std::size_t>(tile.z * tiles.y + tile.y)] = 1;
  }
  bool rowIsActive(std::int64_t j, std::int64_t k) const {
    const std::int64_t row = k / tile_cells_ * m_.tiles_.dims().y + j / tile_cells_;
    return m_.active_rows_[static_cast<std::size_t>(row)] != 0;
  }
  bool layerIsActive(std::int64_t k) const {
    const auto first = m_.active_rows_.begin() + k / tile_cells_ * m_.tiles_.dims().y;
    return std::find(first, first + m_.tiles_.dims().y, 1) != first + m_.tiles_.dims().y;
  }

  // An edge on the border of a row of tiles gets its vertex from the row before, in y or z. Where
  // that row is inactive, the slots still hold numbers of another layer or brick. By its range no
  // surface comes out of it; a file may say what it likes, so the slots are emptied.
  void forgetEdgesOfInactiveRows(std::int64_t j, std::int64_t k) {
    const bool at_row = j > 0 && j % tile_cells_ == 0, at_layer = k > 0 && k % tile_cells_ == 0;
    if (!at_row && !at_layer) return;
    const bool has_below = at_row && !rowIsActive(j - 1, k);
    const bool has_before = at_layer && !rowIsActive(j, k - 1);
    const bool has_corner = (at_row || at_layer) && !rowIsActive(std::max(j - 1, std::int64_t{0}),
                                                                 std::max(k - 1, std::int64_t{0}));
    const auto low = static_cast<std::size_t>(k & 1);
    if (has_below) {
      forgetRow(m_.z_edges_, j);
      forgetRow(m_.x_edges_[1 - low], j);
    }
    if (has_before) {
      forgetRow(m_.y_edges_[low], j);
      forgetRow(m_.x_edges_[low], j + 1);
    }
    if (has_corner) forgetRow(m_.x_edges_[low], j);
  }
  void forgetRow(std::vector<std::uint32_t>& slice, std::int64_t j) const {
    std::fill_n(slice.begin() + j * (nx_ + 1), nx_ + 1, kNoVertex);
  }

  // Signs of sample slice `k`, all rows (their cost is small beside the branches to skip some).
  void computeSigns(std::int64_t k) {
    std::uint8_t* out = m_.signs_[static_cast<std::size_t>(k & 1)].data();
    for (std::int64_t j = 0; j <= ny_; ++j, out += nx_ + 1) {
      const T* row = view_.at(view_.offset(cells_.first + Index3(0, j, k)));
      for (std::int64_t i = 0; i <= nx_; ++i)
        out[i] = static_cast<float>(row[i]) >= context_.isovalue ? 1 : 0;
    }
  }

  void meshRow(std::int64_t j, std::int64_t k) {
    const std::uint8_t* s0 = m_.signs_[static_cast<std::size_t>(k & 1)].data() + j * (nx_ + 1);
    const std::uint8_t* s1 =
        m_.signs_[static_cast<std::size_t>((k + 1) & 1)].data() + j * (nx_ + 1);
    const std::int64_t up = nx_ + 1;
    std::uint8_t* columns = m_.columns_.data();
    for (std::int64_t i = 0; i <= nx_; ++i)
      columns[i] =
          static_cast<std::uint8_t>(s0[i] | s0[i + up] << 2 | s1[i] << 4 | s1[i + up] << 6);
    std::uint8_t* patterns = m_.patterns_.data();
    for (std::int64_t i = 0; i < nx_; ++i)
      patterns[i] = static_cast<std::uint8_t>(columns[i] | columns[i + 1] << 1);
    for (std::int64_t i = 0; i < nx_; i += 8) {
      std::uint64_t eight;
      std::memcpy(&eight, patterns + i, 8);
      if (eight == 0 || eight == ~std::uint64_t{0}) continue;
      const std::int64_t end = std::min(i + 8, nx_);
      for (std::int64_t at = i; at < end; ++at)
        if (patterns[at] != 0 && patterns[at] != 255) meshCell(at, j, k, patterns[at]);
    }
  }

  void meshCell(std::int64_t i, std::int64_t j, std::int64_t k, std::uint8_t pattern) {
    const MarchingCubesCase& mc = table_[pattern];
    const std::uint16_t first_touch = kFirstTouches[static_cast<std::size_t>(
        (i == 0 ? 1 : 0) | (j == 0 ? 2 : 0) | (k == 0 ? 4 : 0))];
    std::uint32_t vertex[kCellEdges];
    std::uint32_t greatest = 0;
    for (std::uint32_t rest = mc.crossed_edges; rest != 0; rest &= rest - 1) {
      const int e = std::countr_zero(rest);
      const CellEdge& edge = kCellEdgeTable[static_cast<std::size_t>(e)];
      const Index3 at(i + edge.x, j + edge.y, k + edge.z);
      auto& slice = edge.axis == 0   ? m_.x_edges_[static_cast<std::size_t>(at.z & 1)]
                    : edge.axis == 1 ? m_.y_edges_[static_cast<std::size_t>(at.z & 1)]
                                     : m_.z_edges_;
      std::uint32_t& slot = slice[static_cast<std::size_t>(at.y * (nx_ + 1) + at.x)];
      if ((first_touch >> e & 1) != 0) slot = makeVertex(at, edge.axis);
      vertex[e] = slot;
      greatest = std::max(greatest, slot);
    }
    if (greatest == kNoVertex) failMissingVertex(context_, work_);
    ++batch_.cells;
    for (int t = 0; t < 3 * mc.triangle_count; t += 3) {
      const std::uint32_t a = vertex[mc.edges[static_cast<std::size_t>(t)]];
      std::uint32_t b = vertex[mc.edges[static_cast<std::size_t>(t + 1)]];
      std::uint32_t c = vertex[mc.edges[static_cast<std::size_t>(t + 2)]];
      if (context_.frame.mirrored()) std::swap(b, c);
      batch_.triangles.insert(batch_.triangles.end(), {a, b, c});
    }
  }

  // The vertex on the edge along `axis` from local sample `at`.
  std::uint32_t makeVertex(const Index3& at, int axis) {
    const Index3 local = at + inset_;
    const std::int64_t offset = linearIndex(local, view_.box().count);
    const std::int64_t step = view_.stride(axis);
    const auto low = static_cast<float>(*view_.at(offset));
    const auto high = static_cast<float>(*view_.at(offset + step));
    const double t = crossingParameter(context_.isovalue, low, high);
    glm::dvec3 index(positions_[0][static_cast<std::size_t>(at.x)],
                     positions_[1][static_cast<std::size_t>(at.y)],
                     positions_[2][static_cast<std::size_t>(at.z)]);
    const double from = index[axis];
    const double to = positions_[axis][static_cast<std::size_t>(at[axis] + 1)];
    index[axis] = from + t * (to - from);
    Index3 next = local;
    ++next[axis];
    const glm::dvec3 gradient = gradientAt(view_.gradientAtLocal(local, offset),
                                           view_.gradientAtLocal(next, offset + step), t);
    const auto number = static_cast<std::uint32_t>(batch_.positions.size());
    batch_.positions.push_back(context_.frame.position(index));
    batch_.normals.push_back(context_.frame.normal(gradient, axis, low >= context_.isovalue));
    bool shared = false;
    for (int a = 0; a < 3; ++a)
      shared = shared || (a != axis && (at[a] == 0 || at[a] == cells_.count[a]));
    if (shared) {
      const Index3 base(static_cast<std::int64_t>(positions_[0][static_cast<std::size_t>(at.x)]),
                        static_cast<std::int64_t>(positions_[1][static_cast<std::size_t>(at.y)]),
                        static_cast<std::int64_t>(positions_[2][static_cast<std::size_t>(at.z)]));
      batch_.shared.push_back({number, makeEdgeKey(base, axis)});
    }
    return number;
  }

  UniformMesher& m_;
  const MeshContext& context_;
  const BrickWork& work_;
  MeshBatch& batch_;
  const IndexBox cells_;
  const SampleView<T> view_;
  const Index3 inset_;  // of the first cell's lowest corner in the stored samples
  const std::int64_t nx_, ny_, nz_;
  const std::int64_t tile_cells_;
  const std::array<MarchingCubesCase, 256>& table_ = marchingCubesTable();
  std::vector<double> positions_[3];  // voxel index of the local samples
};

void UniformMesher::mesh(const MeshContext& context, const BrickWork& work, MeshBatch& batch) {
  if (!tiles_.load(context, work.level, work.brick)) return;
  const BrickSamples samples = context.samples(work.level, work.brick);
  visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    Sweep<typename decltype(tag)::Type>(*this, context, work, samples, batch).run();
  });
}

}  // namespace isobrick
