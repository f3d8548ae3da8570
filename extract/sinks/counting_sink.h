// A sink that keeps nothing.
#pragma once

#include "isobrick/extract/sinks/vertex_numbering.h"

namespace isobrick {

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
