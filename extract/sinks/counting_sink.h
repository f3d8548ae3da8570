// A sink that keeps nothing.
#pragma once

#include "isobrick/extract/sinks/vertex_numbering.h"

namespace isobrick {

// Counts triangles and distinct vertices in 64 bits.
class CountingSink : public TriangleSink {
 public:
  void accept(const MeshBatch& batch) override {
    triangles_ += batch.triangles.size() / 3;
    numbering_.number(batch, numbers_, is_new_);
  }
  std::uint64_t triangles() const { return triangles_; }
  std::uint64_t vertices() const { return numbering_.count(); }

 private:
  std::uint64_t triangles_ = 0;
  VertexNumbering numbering_;
  std::vector<std::uint64_t> numbers_;
  std::vector<bool> is_new_;
};

}  // namespace isobrick
