// The chunks of surfaces that a card keeps.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <unordered_map>

#include "isobrick/viewer/render/gl_arenas.h"
#include "isobrick/viewer/render/gl_device.h"
#include "isobrick/viewer/render/gl_staging.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {

// A chunk in an arena: its vertices, then its indices.
struct KeptChunk {
  GlArenas::Place place;
  std::uint64_t bytes = 0;
  std::uint32_t vertices = 0, indices = 0, transition_indices = 0;
  glm::dvec3 origin{0.0};
  glm::dvec3 lower{0.0}, upper{0.0};  // of the vertices, in the lattice
  int level = 0, surface = 0;

  std::size_t vertexBytes() const { return vertices * sizeof(SurfaceVertex); }
  // In their arena's buffer.
  std::uint32_t firstVertex() const { return static_cast<std::uint32_t>(place.begin); }
  std::uint32_t firstIndex() const {
    return static_cast<std::uint32_t>((place.firstByte() + vertexBytes()) / sizeof(std::uint32_t));
  }
};

// ChunkStore's functions have its meaning here.
class GlChunks {
 public:
  // `staged`: pieces go through a ring that stays mapped, if the driver has the memory for it.
  GlChunks(GlDevice& device, bool staged);

  ChunkId reserve(const SurfaceChunk& chunk);
  bool uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes);
  void endUploads();
  ChunkId upload(const SurfaceChunk& chunk);
  void release(ChunkId chunk) noexcept;
  SurfaceChunk download(ChunkId chunk) const;

  const KeptChunk& at(ChunkId chunk) const { return chunks_.at(chunk); }
  const GlArenas& arenas() const { return arenas_; }
  // Of chunks alone.
  std::uint64_t bytesKept() const { return bytes_kept_; }

 private:
  template <typename F>
  static bool forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes, F&& f);
  void fill(const KeptChunk& kept, const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes);

  GlDevice& device_;
  GlArenas arenas_;
  std::optional<GlStaging> staging_;  // none: pieces go without it
  std::unordered_map<ChunkId, KeptChunk> chunks_;
  ChunkId last_ = 0;
  std::uint64_t bytes_kept_ = 0;
};

}  // namespace isobrick
