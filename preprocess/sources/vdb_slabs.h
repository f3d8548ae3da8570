// The bytes of an OpenVDB file, and the voxels of a tree that does not fit into memory. Private to
// vdb_source.cpp.
#pragma once

#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <cstdint>
#include <istream>
#include <streambuf>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/brick_layout.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {

// A file that reports its progress, and throws after a request to stop: the exception comes out of
// OpenVDB's call through the stream. Skipping a few bytes, as in each of a million leaves, costs
// nothing; seeking beyond the end fails.
class WatchedFile final : public std::streambuf {
 public:
  // They outlive it.
  WatchedFile(const InputFile& file, const OpenOptions& options) : file_(file), options_(options) {}

 protected:
  int_type underflow() override {
    if (gptr() == egptr()) {
      options_.checkCancel();
      begin_ += static_cast<std::uint64_t>(egptr() - eback());
      if (buffer_.empty()) buffer_.resize(kBufferBytes);
      const std::size_t got = file_.readAt(begin_, buffer_.data(), buffer_.size());
      setg(buffer_.data(), buffer_.data(), buffer_.data() + got);
      if (got == 0) return traits_type::eof();
      options_.report("loading grid",
                      static_cast<double>(begin_) / static_cast<double>(file_.size()));
    }
    return traits_type::to_int_type(*gptr());
  }
  pos_type seekoff(off_type by, std::ios_base::seekdir from, std::ios_base::openmode) override {
    const auto here = static_cast<off_type>(begin_) + (gptr() - eback());
    const auto size = static_cast<off_type>(file_.size());
    const off_type base = from == std::ios_base::beg ? 0 : from == std::ios_base::cur ? here : size;
    off_type to = 0;
    if (__builtin_add_overflow(by, base, &to) || to < 0 || to > size) return pos_type(off_type(-1));
    const off_type in_buffer = to - static_cast<off_type>(begin_);
    if (in_buffer >= 0 && in_buffer <= egptr() - eback()) {
      setg(eback(), eback() + in_buffer, egptr());
    } else {
      begin_ = static_cast<std::uint64_t>(to);
      setg(buffer_.data(), buffer_.data(), buffer_.data());
    }
    return to;
  }
  pos_type seekpos(pos_type to, std::ios_base::openmode mode) override {
    return seekoff(to, std::ios_base::beg, mode);
  }

 private:
  static constexpr std::size_t kBufferBytes = std::size_t{256} << 10;
  const InputFile& file_;
  const OpenOptions& options_;
  std::vector<char> buffer_;
  std::uint64_t begin_ = 0;  // of the buffer, in the file
};

// Memory as a file that is read.
class MemoryStreamBuffer final : public std::streambuf {
 public:
  void show(const char* data, std::size_t bytes) {
    char* const begin = const_cast<char*>(data);  // never written to
    setg(begin, begin, begin + bytes);
  }

 protected:
  pos_type seekoff(off_type by, std::ios_base::seekdir from, std::ios_base::openmode) override {
    const off_type at = by + (from == std::ios_base::beg   ? 0
                              : from == std::ios_base::cur ? gptr() - eback()
                                                           : egptr() - eback());
    if (at < 0 || at > egptr() - eback()) return pos_type(off_type(-1));
    setg(eback(), eback() + at, egptr());
    return at;
  }
  pos_type seekpos(pos_type at, std::ios_base::openmode mode) override {
    return seekoff(at, std::ios_base::beg, mode);
  }
};

// The places of a tree's leaves in its file, and the values of its tiles: some 10 bytes a leaf, a
// tenth of the tree itself without its voxels.
template <typename Tree>
class VdbSlabs {
  using Value = typename Tree::ValueType;

 public:
  using Leaf = typename Tree::LeafNodeType;
  using LowerNode = typename Tree::RootNodeType::ChildNodeType::ChildNodeType;
  static constexpr std::int64_t kLeafVoxels = Leaf::DIM, kNodeVoxels = LowerNode::DIM;

  // `places`: the bytes at which the leaves of the tree begin in `file`, in its order, and the last
  // one's end. `stream` says how they are packed. The file outlives the slabs; the tree need not.
  VdbSlabs(const Tree& tree, std::vector<std::uint64_t> places,
           const openvdb::io::StreamMetadata& stream, const InputFile& file)
      : places_(std::move(places)), stream_(stream), file_(file), background_(tree.background()) {
    stream_.setSeekable(false);  // then the masks are read again, and need not be kept
    stream_.setBackgroundPtr(&background_);
    takeCoarseTiles(tree);
    takeNodes(tree);
  }
  VdbSlabs(const VdbSlabs&) = delete;
  VdbSlabs& operator=(const VdbSlabs&) = delete;

  std::uint64_t bytes() const {
    std::uint64_t bytes = places_.capacity() * sizeof(std::uint64_t) +
                          nodes_.capacity() * sizeof(Node) + coarse_tiles_.capacity() * sizeof(Box);
    for (const Node& node : nodes_) bytes += node.tiles.capacity() * sizeof(Tile);
    return bytes;
  }

  // The values of `box`, in coordinates of the grid, x fastest, on all threads. Throws what OpenVDB
  // and the stream throw for leaves that are damaged; `checkCancel` may throw too.
  template <typename CheckCancel>
  void read(const IndexBox& box, Value* out, const CheckCancel& checkCancel) const {
    isolatedFor(std::int64_t{0}, box.count.z, [&](std::int64_t z) {
      const std::int64_t slice = box.count.x * box.count.y;
      std::fill_n(out + z * slice, slice, background_);
    });
    for (const Box& tile : coarse_tiles_) fill(box, out, tile.box, tile.value);
    isolatedFor(std::size_t{0}, nodes_.size(), [&](std::size_t i) {
      const Node& node = nodes_[i];
      if (!meet(box, {node.first, Index3(kNodeVoxels)})) return;
      checkCancel();
      for (const Tile& tile : node.tiles)
        fill(box, out, {node.first + placeInNode(tile.child) * kLeafVoxels, Index3(kLeafVoxels)},
             tile.value);
      readLeaves(node, box, out);
    });
  }

 private:
  static constexpr std::int64_t kNodeLeaves = kNodeVoxels / kLeafVoxels;  // along an axis

  struct Tile {
    std::uint16_t child;
    Value value;
  };
  struct Node {
    Index3 first;                             // its lowest corner
    typename LowerNode::NodeMaskType leaves;  // which children are leaves
    std::size_t first_leaf;                   // of them, in places_
    std::vector<Tile> tiles;                  // of the others that are not the background
  };
  struct Box {
    IndexBox box;
    Value value;
  };

  static Index3 indexOf(const openvdb::Coord& at) { return {at.x(), at.y(), at.z()}; }
  static bool meet(const IndexBox& a, const IndexBox& b) {
    return glm::all(glm::lessThan(a.first, b.end())) && glm::all(glm::lessThan(b.first, a.end()));
  }
  // For a child, in leaves: z fastest.
  static Index3 placeInNode(openvdb::Index child) {
    return {child / (kNodeLeaves * kNodeLeaves), child / kNodeLeaves % kNodeLeaves,
            child % kNodeLeaves};
  }

  // For the root and the nodes below it.
  void takeCoarseTiles(const Tree& tree) {
    auto at = tree.cbeginValueAll();
    at.setMaxDepth(Tree::DEPTH - 3);
    for (; at; ++at) {
      if (at.getValue() == background_) continue;
      openvdb::CoordBBox box;
      at.getBoundingBox(box);
      coarse_tiles_.push_back(
          {{indexOf(box.min()), indexOf(box.max()) + Index3(1) - indexOf(box.min())},
           at.getValue()});
    }
  }

  void takeNodes(const Tree& tree) {
    auto at = tree.cbeginNode();
    at.setMinDepth(Tree::DEPTH - 2);
    at.setMaxDepth(Tree::DEPTH - 2);
    std::size_t leaf = 0;
    for (; at; ++at) {
      const LowerNode* found = nullptr;
      at.getNode(found);
      Node node{indexOf(found->origin()), found->getChildMask(), leaf, {}};
      leaf += node.leaves.countOn();
      for (auto tile = found->cbeginValueAll(); tile; ++tile)
        if (tile.getValue() != background_)
          node.tiles.push_back({static_cast<std::uint16_t>(tile.pos()), tile.getValue()});
      nodes_.push_back(std::move(node));
    }
  }

  // The part of `region` in the box becomes `value`.
  static void fill(const IndexBox& box, Value* out, const IndexBox& region, Value value) {
    const Index3 begin = glm::max(box.first, region.first) - box.first;
    const Index3 end = glm::min(box.end(), region.end()) - box.first;
    if (begin.x >= end.x) return;
    for (std::int64_t z = begin.z; z < end.z; ++z)
      for (std::int64_t y = begin.y; y < end.y; ++y)
        std::fill_n(out + linearIndex({begin.x, y, z}, box.count), end.x - begin.x, value);
  }

  // A plane of leaves at a time: one read, from the first to the last that the box needs.
  void readLeaves(const Node& node, const IndexBox& box, Value* out) const {
    MemoryStreamBuffer memory;
    std::istream in(&memory);
    in.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
    auto stream = std::make_shared<openvdb::io::StreamMetadata>(stream_);
    openvdb::io::setStreamMetadataPtr(in, stream);
    Leaf leaf(openvdb::Coord(0), background_);
    std::vector<char> bytes;
    std::vector<std::pair<Index3, std::size_t>> wanted;  // lowest corner, number
    constexpr auto kPlane = static_cast<openvdb::Index>(kNodeLeaves * kNodeLeaves);
    std::size_t number = node.first_leaf;
    for (openvdb::Index plane = 0; plane < LowerNode::NUM_VALUES; plane += kPlane) {
      wanted.clear();
      for (openvdb::Index child = plane; child < plane + kPlane; ++child) {
        if (!node.leaves.isOn(child)) continue;
        const Index3 first = node.first + placeInNode(child) * kLeafVoxels;
        if (meet(box, {first, Index3(kLeafVoxels)})) wanted.emplace_back(first, number);
        ++number;
      }
      if (wanted.empty()) continue;
      const std::uint64_t begin = places_[wanted.front().second];
      bytes.resize(places_[wanted.back().second + 1] - begin);
      if (file_.readAt(begin, bytes.data(), bytes.size()) < bytes.size())
        throw std::ios_base::failure("it became shorter");
      for (const auto& [first, leaf_number] : wanted) {
        const std::uint64_t place = places_[leaf_number];
        memory.show(bytes.data() + (place - begin), places_[leaf_number + 1] - place);
        leaf.setOrigin(
            {static_cast<int>(first.x), static_cast<int>(first.y), static_cast<int>(first.z)});
        leaf.readBuffers(in, stream->halfFloat());
        copyLeaf(leaf.buffer().data(), first, box, out);
      }
    }
  }

  static void copyLeaf(const Value* values, const Index3& first, const IndexBox& box, Value* out) {
    const Index3 begin = glm::max(first, box.first);
    const Index3 end = glm::min(first + Index3(kLeafVoxels), box.end());
    for (std::int64_t z = begin.z; z < end.z; ++z)
      for (std::int64_t y = begin.y; y < end.y; ++y) {
        Value* const row = out + linearIndex(Index3(begin.x, y, z) - box.first, box.count);
        const Value* const from = values + (y - first.y) * kLeafVoxels + (z - first.z);
        for (std::int64_t x = begin.x; x < end.x; ++x)
          row[x - begin.x] = from[(x - first.x) * kLeafVoxels * kLeafVoxels];
      }
  }

  std::vector<std::uint64_t> places_;
  openvdb::io::StreamMetadata stream_;
  const InputFile& file_;
  const Value background_;
  std::vector<Node> nodes_;
  std::vector<Box> coarse_tiles_;
};

}  // namespace isobrick
