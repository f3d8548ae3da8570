// A sink that keeps nothing but a number by which meshes can be compared.
#pragma once

#include <cstdint>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/checksum.h"

namespace isobrick::test {

// The checksum of all batches, bit by bit, in their order. For one mesh.
class HashingSink : public TriangleSink {
 public:
  void accept(const MeshBatch& batch) override {
    const auto add = [this](const auto& values) {
      if (!values.empty()) hash_.add(values.data(), values.size() * sizeof values[0]);
    };
    hash_.add(&batch.level, sizeof batch.level);
    hash_.add(&batch.origin, sizeof batch.origin);
    add(batch.positions);
    add(batch.normals);
    add(batch.triangles);
    triangles_ += batch.triangles.size() / 3;
  }
  std::uint64_t value() const { return hash_.value(); }
  std::uint64_t triangles() const { return triangles_; }

 private:
  RunningChecksum hash_;
  std::uint64_t triangles_ = 0;
};

}  // namespace isobrick::test
