// From the vertex numbers of batches to those of a mesh.
#pragma once

#include <cstdint>
#include <vector>

#include "isobrick/extract/edge_vertex_map.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// Numbers vertices in the order in which they first appear; a shared vertex keeps its first number.
// Remembers only the shared vertices, some hundredth to a tenth of all.
class VertexNumbering {
 public:
  // Fills `numbers` with the mesh-wide number of every vertex of the batch, and `is_new` with
  // whether it appears for the first time.
  void number(const MeshBatch& batch, std::vector<std::uint64_t>& numbers,
              std::vector<bool>& is_new) {
    numbers.resize(batch.positions.size());
    is_new.assign(batch.positions.size(), true);
    std::size_t next_shared = 0;
    for (std::size_t v = 0; v < numbers.size(); ++v) {
      bool inserted = true;
      if (next_shared < batch.shared.size() && batch.shared[next_shared].vertex == v)
        numbers[v] = shared_.findOrInsert(batch.shared[next_shared++].key, count_, &inserted);
      else
        numbers[v] = count_;
      is_new[v] = inserted;
      if (inserted) ++count_;
    }
  }

  // Vertices so far.
  std::uint64_t count() const { return count_; }

 private:
  EdgeVertexMap<std::uint64_t> shared_;
  std::uint64_t count_ = 0;
};

}  // namespace isobrick
