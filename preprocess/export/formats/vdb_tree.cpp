#include "isobrick/preprocess/export/formats/vdb_tree.h"

#include <openvdb/io/Compression.h>
#include <openvdb/io/io.h>
#include <tbb/concurrent_queue.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <mutex>
#include <ostream>
#include <streambuf>
#include <utility>

#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/index_loop.h"

namespace isobrick {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;
using LowerNode = openvdb::FloatTree::RootNodeType::ChildNodeType::ChildNodeType;
using Half = openvdb::io::RealToHalf<float>::HalfT;
using openvdb::Coord;

constexpr std::int64_t kLeafVoxels = Leaf::DIM;
constexpr std::int64_t kNodeVoxels = LowerNode::DIM;
// Voxels that are read at a time: a node of floats, or nodes side by side along x. As rows these
// are 512 bytes each, whatever the type.
constexpr std::int64_t kReadBytes = kNodeVoxels * kNodeVoxels * kNodeVoxels * 4;
// A leaf in the file, packed not at all: its mask, the way it is packed, its values.
constexpr std::size_t kMostLeafBytes = sizeof(Leaf::NodeMaskType) + 32 + Leaf::SIZE * sizeof(float);
// The memory of a thread: voxels as they come, and a node's leaves as they go.
constexpr std::uint64_t kThreadBytes =
    kReadBytes + LowerNode::NUM_VALUES * kMostLeafBytes + (std::uint64_t{2} << 20);
// A leaf without values with its entry in the node above, and malloc's overhead.
constexpr std::uint64_t kBytesPerLeaf = 128;

// The greatest multiple of `step` that is not above `index`.
std::int64_t floorTo(std::int64_t index, std::int64_t step) {
  return index >= 0 ? index / step * step : -((-index + step - 1) / step) * step;
}

Index3 floorEach(const Index3& v) {
  return {floorTo(v.x, kNodeVoxels), floorTo(v.y, kNodeVoxels), floorTo(v.z, kNodeVoxels)};
}

Coord coordOf(const Index3& v) {
  return {static_cast<std::int32_t>(v.x), static_cast<std::int32_t>(v.y),
          static_cast<std::int32_t>(v.z)};
}

// Memory behind a stream, kept from node to node.
class ByteBuffer final : public std::streambuf {
 public:
  std::vector<char> bytes;

 private:
  std::streamsize xsputn(const char* data, std::streamsize count) override {
    bytes.insert(bytes.end(), data, data + count);
    return count;
  }
  int_type overflow(int_type c) override {
    bytes.push_back(traits_type::to_char_type(c));
    return c;
  }
};

// Nodes side by side along x, from their voxels to leaves and tiles, with buffers that are kept.
class NodeRow {
 public:
  struct Tile {
    Coord at;
    float value;
    bool is_active;
  };

  // They outlive it.
  NodeRow(const VolumeSource& source, const VdbGridPlan& plan, std::uint32_t compression,
          const std::string& path)
      : path_(path),
        source_(source),
        plan_(plan),
        compression_(compression),
        scratch_(Coord(0), plan.background) {
    for (std::size_t byte = 0; byte < half_of_byte_.size(); ++byte)
      half_of_byte_[byte] = Half(static_cast<float>(source.info().voxel_type == VoxelType::kInt8
                                                        ? static_cast<std::int8_t>(byte)
                                                        : static_cast<int>(byte)));
    openvdb::io::setDataCompression(out_, compression);
    openvdb::io::setGridBackgroundValuePtr(out_, &plan_.background);
    out_.exceptions(std::ios::failbit | std::ios::badbit);
  }

  // The `nodes` nodes from the one with its lowest corner at `corner`, in coordinates of the grid;
  // the values of their leaves go into `leaves`.
  void make(const Index3& corner, std::int64_t nodes, VdbPackedLeaves& leaves) {
    const Index3 begin = glm::max(corner - plan_.first, Index3(0));
    const Index3 end =
        glm::min(corner - plan_.first + Index3(nodes, 1, 1) * kNodeVoxels, source_.info().voxels);
    box_ = {begin, end - begin};
    stored_.resize(static_cast<std::size_t>(box_.size()) * voxelBytes(source_.info().voxel_type));
    source_.readBox(box_, stored_.data());
    visitVoxelType(source_.info().voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      for (std::int64_t i = 0; i < nodes; ++i)
        makeNode<T>(corner + Index3(i * kNodeVoxels, 0, 0), leaves);
    });
  }

  // The nodes that belong into the tree; forgotten by that.
  void moveInto(openvdb::FloatTree& tree) {
    for (const Tile& tile : tiles_) tree.addTile(1, tile.at, tile.value, tile.is_active);
    for (std::unique_ptr<Leaf>& leaf : leaves_) tree.addLeaf(leaf.release());
    tiles_.clear();
    leaves_.clear();
  }
  std::size_t leafCount() const { return leaves_.size(); }

 private:
  // The coordinates along an axis at which a leaf has voxels of the box.
  std::pair<std::int64_t, std::int64_t> leafRange(const Index3& node, int axis) const {
    const std::int64_t low = box_.first[axis] + plan_.first[axis];
    const std::int64_t high = box_.end()[axis] + plan_.first[axis];
    return {std::max(node[axis], floorTo(low, kLeafVoxels)),
            std::min(node[axis] + kNodeVoxels, high)};
  }

  // Leaves in the order in which the file has them.
  template <typename T>
  void makeNode(const Index3& node, VdbPackedLeaves& leaves) {
    packed_.bytes.clear();
    const auto x = leafRange(node, 0), y = leafRange(node, 1), z = leafRange(node, 2);
    Index3 leaf;
    for (leaf.x = x.first; leaf.x < x.second; leaf.x += kLeafVoxels)
      for (leaf.y = y.first; leaf.y < y.second; leaf.y += kLeafVoxels)
        for (leaf.z = z.first; leaf.z < z.second; leaf.z += kLeafVoxels) makeLeaf<T>(leaf);
    if (!packed_.bytes.empty()) leaves.put(coordOf(node), packed_.bytes);
  }

  template <typename T>
  void makeLeaf(const Index3& corner) {
    float* const values = scratch_.buffer().data();
    copyLeaf(reinterpret_cast<const T*>(stored_.data()), corner - plan_.first, values);
    if (plan_.tolerance > 0)
      for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) values[i] = plan_.valueOf(values[i]);
    if (plan_.saves_half && sizeof(T) > 1)
      for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) plan_.refuseBeyondHalf(values[i], path_);
    const float first = values[0];
    if (std::all_of(values, values + Leaf::SIZE, [&](float v) { return v == first; })) {
      // Nothing but a tile in the node above; the background is not even that.
      if (first != plan_.background)
        tiles_.push_back({coordOf(corner), first, plan_.isActive(first)});
      return;
    }
    const Leaf::NodeMaskType mask = activeOnes(values);
    if (plan_.grid_class == openvdb::GRID_LEVEL_SET) {
      scratch_.setValueMask(mask);
      scratch_.writeBuffers(out_, plan_.saves_half);
    } else {
      writeActive(mask, values);
    }
    leaves_.push_back(
        std::make_unique<Leaf>(openvdb::PartialCreate(), coordOf(corner), plan_.background, false));
    leaves_.back()->setValueMask(mask);
  }

  Leaf::NodeMaskType activeOnes(const float* values) const {
    Leaf::NodeMaskType mask;
    const float background = plan_.background;  // nothing that is written can be this one
    std::array<std::uint8_t, Leaf::SIZE> is_active;
    if (plan_.grid_class == openvdb::GRID_LEVEL_SET)
      for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) is_active[i] = plan_.isActive(values[i]);
    else
      for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) is_active[i] = values[i] != background;
    for (openvdb::Index i = 0; i < Leaf::SIZE; i += 8) {
      std::uint64_t bytes = 0;
      std::memcpy(&bytes, is_active.data() + i, sizeof bytes);
      constexpr std::uint64_t kGather = 0x0102040810204080;  // bit 8 i to bit 56 + i
      mask.getWord<std::uint8_t>(i / 8) = static_cast<std::uint8_t>(bytes * kGather >> 56);
    }
    return mask;
  }

  // Writes the same as Leaf::writeBuffers(), without its look at every value: here all inactive
  // values are the background, and only the others are stored.
  void writeActive(const Leaf::NodeMaskType& mask, const float* values) {
    mask.save(out_);
    out_.put(static_cast<char>(openvdb::io::NO_MASK_OR_INACTIVE_VALS));
    openvdb::Index count = 0;
    for (auto on = mask.beginOn(); on; ++on) active_[count++] = values[on.pos()];
    if (!plan_.saves_half) return openvdb::io::writeData(out_, active_.data(), count, compression_);
    if (voxelBytes(source_.info().voxel_type) == 1)
      for (openvdb::Index i = 0; i < count; ++i)
        halves_[i] = half_of_byte_[static_cast<std::uint8_t>(static_cast<int>(active_[i]))];
    else
      for (openvdb::Index i = 0; i < count; ++i) halves_[i] = Half(active_[i]);
    openvdb::io::writeData(out_, halves_.data(), count, compression_);
  }

  // The values of the leaf whose lowest corner is voxel `low`, in OpenVDB's order: z fastest.
  // Voxels beyond the volume are background.
  template <typename T>
  void copyLeaf(const T* from, const Index3& low, float* out) const {
    const std::int64_t row = box_.count.x, slice = box_.count.x * box_.count.y;
    if (glm::all(glm::greaterThanEqual(low, box_.first)) &&
        glm::all(glm::lessThanEqual(low + Index3(kLeafVoxels), box_.end()))) {
      // Almost all leaves: loops of a known length, and the order in which they are written.
      from += linearIndex(low - box_.first, box_.count);
      for (std::int64_t x = 0; x < kLeafVoxels; ++x)
        for (std::int64_t y = 0; y < kLeafVoxels; ++y)
          for (std::int64_t z = 0; z < kLeafVoxels; ++z)
            *out++ = static_cast<float>(from[z * slice + y * row + x]);
      return;
    }
    std::fill_n(out, Leaf::SIZE, plan_.background);
    const Index3 begin = glm::max(low, box_.first);
    const Index3 end = glm::min(low + Index3(kLeafVoxels), box_.end());
    for (std::int64_t z = begin.z; z < end.z; ++z)
      for (std::int64_t y = begin.y; y < end.y; ++y)
        for (std::int64_t x = begin.x; x < end.x; ++x)
          out[((x - low.x) * kLeafVoxels + (y - low.y)) * kLeafVoxels + (z - low.z)] =
              plan_.valueOf(
                  static_cast<float>(from[linearIndex(Index3(x, y, z) - box_.first, box_.count)]));
  }

  const std::string& path_;  // of the output
  const VolumeSource& source_;
  const VdbGridPlan& plan_;
  const std::uint32_t compression_;
  IndexBox box_;  // of stored_, in voxels of the source
  std::vector<std::byte> stored_;
  Leaf scratch_;  // the current leaf
  std::array<float, Leaf::SIZE> active_;
  std::array<Half, Leaf::SIZE> halves_;
  std::array<Half, 256> half_of_byte_;
  ByteBuffer packed_;
  std::ostream out_{&packed_};  // into packed_
  std::vector<Tile> tiles_;
  std::vector<std::unique_ptr<Leaf>> leaves_;
};

// The most memory of a tree's nodes, those above leaves among them.
std::uint64_t mostNodeBytes(const VolumeInfo& info) {
  const Index3 leaves = info.voxels / kLeafVoxels + Index3(2);  // some reach over both ends
  return static_cast<std::uint64_t>(elementCount(leaves)) * kBytesPerLeaf * 8 / 7;
}

Error tooManyLeaves(const VolumeSource& source, const std::string& path) {
  const std::uint64_t most = mostNodeBytes(source.info()) + kThreadBytes + source.bufferBytes();
  return unwritable(path, "the nodes of its tree take up to ", (most >> 20) + 1,
                    " MiB, which is more than is allowed; write a coarser level or a box, or store "
                    "less with a background and a tolerance",
                    Remedy::kAllowMoreMemory);
}

// What the memory is for: so many rows of nodes at once, and leaves of the tree.
struct TreeBudget {
  std::uint64_t rows = 1, leaves = 0;
};
TreeBudget budgetFor(const VolumeInfo& info, std::uint64_t memory_bytes) {
  const auto threads =
      static_cast<std::uint64_t>(std::max(1, tbb::this_task_arena::max_concurrency()));
  // More threads only if that leaves room for all nodes.
  const std::uint64_t left = memory_bytes - std::min(memory_bytes, mostNodeBytes(info));
  TreeBudget budget;
  budget.rows = std::clamp(left / kThreadBytes, std::uint64_t{1}, threads);
  const std::uint64_t taken = budget.rows * kThreadBytes;
  budget.leaves = (memory_bytes - std::min(memory_bytes, taken)) / kBytesPerLeaf * 7 / 8;
  return budget;  // an eighth is for the nodes above leaves
}

// Bytes one after the other, as far as any file goes.
constexpr std::int64_t kMostFileBytes = std::int64_t{1} << 62;

}  // namespace

void VdbGridPlan::refuseBeyondHalf(float value, const std::string& path) const {
  constexpr float kFirstInfinite = 65520;  // as a half; lower values are rounded to 65504
  if (!(std::abs(value) >= kFirstInfinite) || std::isinf(value)) return;
  throw unwritable(path, "the value ", numberText(static_cast<double>(value)),
                   " is beyond half floats, which end at 65504", Remedy::kWholeFloats);
}

VdbPackedLeaves::VdbPackedLeaves(const std::string& folder)
    : file_({kMostFileBytes, 1, 1}, 1, ScratchVolume::Place::kFile, folder) {}

void VdbPackedLeaves::put(const Coord& node, const std::vector<char>& bytes) {
  Run run{0, bytes.size()};
  {
    const std::lock_guard lock(mutex_);
    run.first = end_;
    end_ += run.bytes;
    runs_[node] = run;
  }
  file_.write({Index3(static_cast<std::int64_t>(run.first), 0, 0),
               Index3(static_cast<std::int64_t>(run.bytes), 1, 1)},
              bytes.data());
}

void VdbPackedLeaves::appendTo(std::ostream& out, const openvdb::FloatTree& tree,
                               const ExportOptions& options,
                               const std::function<void(double)>& tick) const {
  constexpr std::uint64_t kStepBytes = std::uint64_t{1} << 20;
  std::vector<char> bytes(kStepBytes);
  std::uint64_t done = 0;
  auto node = tree.cbeginNode();
  constexpr openvdb::Index kLowerNodes = openvdb::FloatTree::DEPTH - 2;
  node.setMinDepth(kLowerNodes);
  node.setMaxDepth(kLowerNodes);
  for (; node; ++node) {
    const auto found = runs_.find(node.getBoundingBox().min());
    if (found == runs_.end()) continue;  // nothing but tiles
    const Run& run = found->second;
    for (std::uint64_t at = 0; at < run.bytes;) {
      checkCancel(options);
      const std::uint64_t step = std::min(run.bytes - at, kStepBytes);
      file_.read({Index3(static_cast<std::int64_t>(run.first + at), 0, 0),
                  Index3(static_cast<std::int64_t>(step), 1, 1)},
                 bytes.data());
      out.write(bytes.data(), static_cast<std::streamsize>(step));
      at += step;
      done += step;
      tick(static_cast<double>(done) / static_cast<double>(end_));
    }
  }
}

void makeVdbTree(const VolumeSource& source, const VdbGridPlan& plan, std::uint32_t compression,
                 const std::string& path, const ExportOptions& options,
                 const std::function<void(double)>& tick, openvdb::FloatGrid& grid,
                 VdbPackedLeaves& leaves) {
  const VolumeInfo& info = source.info();
  const std::int64_t nodes_per_read =
      kReadBytes / (kNodeVoxels * kNodeVoxels * kNodeVoxels *
                    static_cast<std::int64_t>(voxelBytes(info.voxel_type)));
  TreeBudget budget = budgetFor(info, options.memory_bytes);
  const Index3 low = floorEach(plan.first);
  const Index3 nodes = BrickLayout::ceilDivide(plan.first + info.voxels - low, kNodeVoxels);
  const Index3 reads((nodes.x + nodes_per_read - 1) / nodes_per_read, nodes.y, nodes.z);
  const std::int64_t read_count = elementCount(reads);
  std::vector<std::unique_ptr<NodeRow>> rows;
  tbb::concurrent_bounded_queue<NodeRow*> idle;
  while (rows.size() < budget.rows) {
    rows.push_back(std::make_unique<NodeRow>(source, plan, compression, path));
    idle.push(rows.back().get());
  }

  std::int64_t next = 0, done = 0;
  using tbb::filter_mode;
  const auto number = [&](tbb::flow_control& flow) -> std::int64_t {
    if (next == read_count) flow.stop();
    return next++;
  };
  const auto make = [&](std::int64_t read) {
    checkCancel(options);
    NodeRow* row = nullptr;
    idle.pop(row);
    const Index3 at = indexAt(read, reads) * Index3(nodes_per_read, 1, 1);
    row->make(low + at * kNodeVoxels, std::min(nodes_per_read, nodes.x - at.x), leaves);
    return row;
  };
  const auto take = [&](NodeRow* row) {
    if (row->leafCount() > budget.leaves) throw tooManyLeaves(source, path);
    budget.leaves -= row->leafCount();
    row->moveInto(grid.tree());
    tick(static_cast<double>(++done) / static_cast<double>(read_count));
    idle.push(row);
  };
  tbb::parallel_pipeline(
      budget.rows, tbb::make_filter<void, std::int64_t>(filter_mode::serial_in_order, number) &
                       tbb::make_filter<std::int64_t, NodeRow*>(filter_mode::parallel, make) &
                       tbb::make_filter<NodeRow*, void>(filter_mode::serial_out_of_order, take));
}

}  // namespace isobrick
