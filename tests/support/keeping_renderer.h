// A renderer that keeps what it was given, to look at it.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <map>
#include <vector>

#include "isobrick/viewer/render/null_renderer.h"

namespace isobrick::test {

// Keeps what a graphics card would.
class KeepingRenderer : public NullRenderer {
 public:
  ChunkId upload(const SurfaceChunk& chunk) override {
    const ChunkId id = NullRenderer::upload(chunk);
    chunks_[id] = chunk;
    return id;
  }
  void release(ChunkId id) override {
    NullRenderer::release(id);
    chunks_.erase(id);
  }

  // Chunks as one mesh in voxels: the same position is the same vertex, and positions are the same
  // to the bit on both sides of a brick.
  void join(const std::vector<ChunkId>& chunks, std::vector<glm::dvec3>& positions,
            std::vector<std::uint32_t>& triangles) const {
    std::map<std::array<double, 3>, std::uint32_t> numbers;
    for (const ChunkId id : chunks) {
      const SurfaceChunk& chunk = chunks_.at(id);
      for (const std::uint32_t v : chunk.triangles) {
        const glm::dvec3 at = chunk.origin + glm::dvec3(chunk.vertices[v].position);
        const auto [entry, fresh] =
            numbers.try_emplace({at.x, at.y, at.z}, static_cast<std::uint32_t>(positions.size()));
        if (fresh) positions.push_back(at);
        triangles.push_back(entry->second);
      }
    }
  }

 private:
  std::map<ChunkId, SurfaceChunk> chunks_;
};

}  // namespace isobrick::test
