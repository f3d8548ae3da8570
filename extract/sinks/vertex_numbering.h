// From the vertex numbers of batches to those of a mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

class SharedVertexMap;

// Numbers vertices in the order in which they first appear; a shared vertex keeps its first number.
// Remembers only vertices that a later batch may have too: a vertex whose batches are known is
// forgotten with the last of them, so that only the front of a large mesh is held. By one thread at
// a time.
class VertexNumbering {
 public:
  VertexNumbering();
  ~VertexNumbering();
  VertexNumbering(VertexNumbering&&) noexcept;
  VertexNumbering& operator=(VertexNumbering&&) noexcept;

  // Gives the batch its first_vertex and its known vertices.
  void place(PlacedBatch& placed);

  // Begins a new mesh; keeps the memory.
  void clear();
  // Vertices that come from now on are others than those so far, whatever their keys.
  void forgetKeys();

  // Vertices so far.
  std::uint64_t count() const { return count_; }
  // Vertices that are remembered.
  std::size_t remembered() const;

 private:
  std::unique_ptr<SharedVertexMap> shared_;
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

// Fills placed.numbers for every vertex of the batch; for meshes whose numbers have 32 bits.
void findNumbers(PlacedBatch& placed);

// Counts triangles and distinct vertices in 64 bits.
class CountingSink : public TriangleSink {
 public:
  // Counts the batch.
  void place(PlacedBatch& placed) override {
    triangles_ += placed.batch.triangles.size() / 3;
    numbering_.place(placed);
  }
  // So far.
  std::uint64_t triangles() const { return triangles_; }
  // Distinct ones so far.
  std::uint64_t vertices() const { return numbering_.count(); }

 private:
  std::uint64_t triangles_ = 0;
  VertexNumbering numbering_;
};

}  // namespace isobrick
