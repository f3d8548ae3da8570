#include "isobrick/viewer/render/gl_chunks.h"

#include <algorithm>
#include <cassert>
#include <cstddef>

namespace isobrick {

GlChunks::GlChunks(GlDevice& device, bool staged) : device_(device) {
  if (staged) staging_.emplace();
  if (staging_ && !staging_->isThere()) staging_.reset();
}

ChunkId GlChunks::reserve(const SurfaceChunk& chunk) {
  KeptChunk kept;
  kept.bytes = chunk.bytes();
  kept.vertices = static_cast<std::uint32_t>(chunk.vertices.size());
  kept.indices = static_cast<std::uint32_t>(chunk.triangles.size());
  kept.transition_indices = static_cast<std::uint32_t>(chunk.transition_indices);
  kept.origin = chunk.origin;
  kept.lower = chunk.origin + glm::dvec3(chunk.lower);
  kept.upper = chunk.origin + glm::dvec3(chunk.upper);
  kept.level = chunk.level;
  kept.surface = chunk.surface;
  device_.forgetErrors();  // throws after a loss
  kept.place = arenas_.take(static_cast<std::size_t>(kept.bytes), device_);
  bytes_kept_ += kept.bytes;
  chunks_.emplace(++last_, kept);
  return last_;
}

// Bytes of a chunk as runs in memory: f(first byte, offset from the chunk's first, count), until it
// is false.
template <typename F>
bool GlChunks::forParts(const SurfaceChunk& chunk, std::size_t begin, std::size_t bytes, F&& f) {
  const std::size_t vertex_bytes = chunk.vertices.size() * sizeof(SurfaceVertex);
  const std::size_t end = begin + bytes;
  const auto* const vertices = reinterpret_cast<const std::byte*>(chunk.vertices.data());
  const auto* const triangles = reinterpret_cast<const std::byte*>(chunk.triangles.data());
  if (begin < vertex_bytes && !f(vertices + begin, begin, std::min(end, vertex_bytes) - begin))
    return false;
  const std::size_t first = std::max(begin, vertex_bytes);
  return first >= end || f(triangles + (first - vertex_bytes), first, end - first);
}

void GlChunks::fill(const KeptChunk& kept, const SurfaceChunk& chunk, std::size_t begin,
                    std::size_t bytes) {
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte();
  forParts(chunk, begin, bytes, [&](const std::byte* data, std::size_t offset, std::size_t count) {
    const auto to = static_cast<GLintptr>(first + offset);
    const auto size = static_cast<GLsizeiptr>(count);
    if (staging_) {  // a card takes a third of the time for a buffer of its own and a copy of it
      const GlBuffer copied = GlBuffer::make();
      glNamedBufferStorage(*copied, size, data, 0);
      glCopyNamedBufferSubData(*copied, buffer, 0, to, size);
    } else {
      glNamedBufferSubData(buffer, to, size, data);
    }
    return true;
  });
}

bool GlChunks::uploadPiece(ChunkId id, const SurfaceChunk& chunk, std::size_t begin,
                           std::size_t bytes) {
  const KeptChunk& kept = chunks_.at(id);
  if (!staging_) {
    fill(kept, chunk, begin, bytes);
    return true;
  }
  // If the second of two parts finds no room, the first comes again.
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte();
  return forParts(chunk, begin, bytes,
                  [&](const std::byte* data, std::size_t offset, std::size_t count) {
                    return staging_->copy(data, count, buffer, first + offset);
                  });
}

void GlChunks::endUploads() {
  if (staging_) staging_->endFrame();
}

ChunkId GlChunks::upload(const SurfaceChunk& chunk) {
  const ChunkId id = reserve(chunk);
  fill(chunks_.at(id), chunk, 0, static_cast<std::size_t>(chunk.bytes()));
  return id;
}

void GlChunks::release(ChunkId chunk) noexcept {
  const auto found = chunks_.find(chunk);
  assert(found != chunks_.end());
  bytes_kept_ -= found->second.bytes;
  arenas_.give(found->second.place);
  chunks_.erase(found);
}

SurfaceChunk GlChunks::download(ChunkId id) const {
  const KeptChunk& kept = chunks_.at(id);
  SurfaceChunk chunk;
  chunk.origin = kept.origin;
  chunk.lower = glm::vec3(kept.lower - kept.origin);
  chunk.upper = glm::vec3(kept.upper - kept.origin);
  chunk.level = kept.level;
  chunk.surface = kept.surface;
  chunk.transition_indices = kept.transition_indices;
  chunk.vertices.resize(kept.vertices);
  chunk.triangles.resize(kept.indices);
  if (kept.bytes == 0) return chunk;
  const GLuint buffer = arenas_.buffer(kept.place.arena);
  const std::size_t first = kept.place.firstByte(), vertex_bytes = kept.vertexBytes();
  glGetNamedBufferSubData(buffer, static_cast<GLintptr>(first),
                          static_cast<GLsizeiptr>(vertex_bytes), chunk.vertices.data());
  glGetNamedBufferSubData(buffer, static_cast<GLintptr>(first + vertex_bytes),
                          static_cast<GLsizeiptr>(kept.bytes - vertex_bytes),
                          chunk.triangles.data());
  return chunk;
}

}  // namespace isobrick
