// A renderer that keeps what it was given, to look at it.
#pragma once

#include <map>

#include "tests/support/null_renderer.h"

namespace isobrick::test {

// Keeps what a graphics card would.
class KeepingRenderer : public NullRenderer {
 public:
  ChunkId reserve(const SurfaceChunk& chunk) override {
    const ChunkId id = NullRenderer::reserve(chunk);
    chunks_[id] = chunk;
    return id;
  }
  void release(ChunkId id) noexcept override {
    NullRenderer::release(id);
    chunks_.erase(id);
  }

  SurfaceChunk download(ChunkId id) const override { return chunks_.at(id); }

 private:
  std::map<ChunkId, SurfaceChunk> chunks_;
};

}  // namespace isobrick::test
