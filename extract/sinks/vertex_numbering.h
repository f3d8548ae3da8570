// From the vertex numbers of batches to those of a mesh.
#pragma once

#include <cstdint>
#include <numeric>
#include <vector>

#include "isobrick/extract/sinks/edge_vertex_map.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Numbers vertices in the order in which they first appear; a shared vertex keeps its first number.
// Remembers only vertices that a later batch may have too: a vertex whose batches are known is
// forgotten with the last of them, so that of a large mesh only its front is held.
class VertexNumbering {
 public:
  // Gives the batch its first_vertex and its known vertices.
  void place(PlacedBatch& placed) {
    placed.first_vertex = count_;
    placed.known.clear();
    for (const MeshBatch::SharedVertex& shared : placed.batch.shared) {
      bool inserted = false;
      const std::uint64_t fresh = count_ + shared.vertex - placed.known.size();
      const std::uint64_t batches_left = shared.batches == 0 ? kNever : shared.batches - 1u;
      const std::uint64_t entry =
          shared_.findOrInsert(shared.key, fresh | batches_left << kNumberBits, &inserted);
      if (inserted) continue;
      placed.known.push_back({shared.vertex, entry & ((std::uint64_t{1} << kNumberBits) - 1)});
      if (entry >> kNumberBits == 1)
        shared_.erase(shared.key);
      else if (entry >> kNumberBits != kNever)
        *shared_.find(shared.key) -= std::uint64_t{1} << kNumberBits;
    }
    count_ += placed.batch.positions.size() - placed.known.size();
  }

  // Begins a new mesh; keeps the memory.
  void clear() {
    shared_.clear();
    count_ = 0;
  }

  // Vertices so far.
  std::uint64_t count() const { return count_; }
  // Vertices that are remembered.
  std::size_t remembered() const { return shared_.size(); }

 private:
  // A number and, above it, how many batches are still to list the vertex.
  static constexpr int kNumberBits = 56;
  static constexpr std::uint64_t kNever = 255;  // forgotten
  EdgeVertexMap<std::uint64_t> shared_;
  std::uint64_t count_ = 0;
};

// Calls f(begin, end, number) for every run of vertices [begin, end) of the batch that are new, the
// first of which has the number `number`.
template <typename F>
void forEachNewRun(const PlacedBatch& placed, F&& f) {
  std::size_t begin = 0;
  std::uint64_t number = placed.first_vertex;
  const auto run = [&](std::size_t end) {
    if (end > begin) f(begin, end, number);
    number += end - begin;
  };
  for (const KnownVertex& known : placed.known) {
    run(known.vertex);
    begin = known.vertex + 1;
  }
  run(placed.batch.positions.size());
}

// Fills placed.numbers: of every vertex of the batch, for meshes whose numbers have 32 bits.
inline void findNumbers(PlacedBatch& placed) {
  placed.numbers.resize(placed.batch.positions.size());
  forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t number) {
    std::iota(placed.numbers.begin() + static_cast<std::ptrdiff_t>(begin),
              placed.numbers.begin() + static_cast<std::ptrdiff_t>(end),
              static_cast<std::uint32_t>(number));
  });
  for (const KnownVertex& known : placed.known)
    placed.numbers[known.vertex] = static_cast<std::uint32_t>(known.number);
}

}  // namespace isobrick
