#include "isobrick/viewer/render/chunk_draws.h"

#include <algorithm>
#include <limits>
#include <tuple>
#include <utility>

#include "isobrick/extract/color_map.h"

namespace isobrick {
namespace {

constexpr std::uint32_t kIndicesInFlight = 3 << 12;  // drawn and not flushed

template <typename T>
void fillBuffer(const GlBuffer& buffer, const std::vector<T>& values) {
  glNamedBufferData(*buffer, static_cast<GLsizeiptr>(values.size() * sizeof(T)), values.data(),
                    GL_STREAM_DRAW);
}

}  // namespace

ChunkDraws::ChunkDraws(bool bounds_flight)
    : bounds_flight_(bounds_flight),
      instance_buffer_(GlBuffer::make()),
      command_buffer_(GlBuffer::make()),
      wire_buffer_(GlBuffer::make()),
      array_(GlVertexArray::make()),
      wire_array_(GlVertexArray::make()) {
  glVertexArrayAttribFormat(*array_, 0, 3, GL_FLOAT, GL_FALSE, offsetof(SurfaceVertex, position));
  static_assert(offsetof(SurfaceVertex, value) == offsetof(SurfaceVertex, normal) + 6);
  glVertexArrayAttribFormat(*array_, 1, 4, GL_SHORT, GL_TRUE, offsetof(SurfaceVertex, normal));
  for (const GLuint attribute : {0u, 1u}) {
    glVertexArrayAttribBinding(*array_, attribute, 0);
    glEnableVertexArrayAttrib(*array_, attribute);
  }
  for (const GlVertexArray* array : {&array_, &wire_array_}) {
    glVertexArrayAttribFormat(**array, 2, 4, GL_FLOAT, GL_FALSE, offsetof(Instance, offset));
    glVertexArrayAttribFormat(**array, 3, 4, GL_FLOAT, GL_FALSE, offsetof(Instance, color));
    glVertexArrayAttribIFormat(**array, 4, 2, GL_UNSIGNED_INT, offsetof(Instance, first_index));
    for (const GLuint attribute : {2u, 3u, 4u}) {
      glVertexArrayAttribBinding(**array, attribute, 1);
      glEnableVertexArrayAttrib(**array, attribute);
    }
    glVertexArrayVertexBuffer(**array, 1, *instance_buffer_, 0, sizeof(Instance));
    glVertexArrayBindingDivisor(**array, 1, 1);
  }
}

void ChunkDraws::collect(const GlChunks& chunks, const SceneView& view,
                         const LatticePlanes& planes) {
  const SceneFrame& frame = view.frame;
  seen_.clear();
  instances_.clear();
  commands_.clear();
  wire_commands_.clear();
  calls_.clear();
  for (const ChunkId id : frame.chunks) {
    const KeptChunk& chunk = chunks.at(id);
    if (chunk.indices == 0) continue;
    const auto surface = static_cast<std::size_t>(chunk.surface);
    if (surface >= frame.surfaces.size() || !(frame.surfaces[surface].opacity > 0.0)) continue;
    if (mayBeInside(planes, chunk.lower, chunk.upper))
      seen_.push_back(&chunk);
    else
      ++counts_.culled;
  }
  counts_.chunks += seen_.size();
  std::stable_sort(seen_.begin(), seen_.end(), [](const KeptChunk* a, const KeptChunk* b) {
    return std::tuple(a->surface, a->place.arena) < std::tuple(b->surface, b->place.arena);
  });
  for (const KeptChunk* chunk : seen_) {
    const SurfaceLook& look = frame.surfaces[static_cast<std::size_t>(chunk->surface)];
    const glm::vec3 color =
        frame.color_by_level ? levelColor(frame.first_level + chunk->level) : look.color;
    const std::uint32_t highlighted = frame.transition_color ? chunk->transition_indices : 0;
    add(*chunk, 0, chunk->indices - highlighted, color, true, view);
    if (highlighted > 0)
      add(*chunk, chunk->indices - highlighted, chunk->indices, *frame.transition_color, false,
          view);
  }
  if (commands_.empty()) return;
  fillBuffer(instance_buffer_, instances_);
  if (frame.wireframe)
    fillBuffer(wire_buffer_, wire_commands_);
  else
    fillBuffer(command_buffer_, commands_);
}

// Indices from `begin` to `end` of the chunk, in parts if the flight is bounded.
void ChunkDraws::add(const KeptChunk& chunk, std::uint32_t begin, std::uint32_t end,
                     const glm::vec3& srgb, bool by_value, const SceneView& view) {
  if (begin == end) return;
  const auto opacity =
      static_cast<float>(view.frame.surfaces[static_cast<std::size_t>(chunk.surface)].opacity);
  const std::uint32_t most =
      bounds_flight_ ? kIndicesInFlight : std::numeric_limits<std::uint32_t>::max();
  const glm::vec4 offset(view.snapped.offsetOf(chunk.origin), by_value ? 1.0f : 0.0f);
  const glm::vec4 color(linearColor(srgb), opacity);
  const std::uint32_t first_word = chunk.firstVertex() * (sizeof(SurfaceVertex) / 4);
  for (std::uint32_t first = begin, count = 0; first < end; first += count) {
    count = std::min(end - first, most);
    const std::uint32_t first_index = chunk.firstIndex() + first;
    const auto instance = static_cast<std::uint32_t>(instances_.size());
    instances_.push_back({offset, color, first_index, first_word});
    commands_.push_back(
        {count, 1, first_index, static_cast<std::int32_t>(chunk.firstVertex()), instance});
    wire_commands_.push_back({count, 1, 0, instance});
    const bool joins = !calls_.empty() && calls_.back().surface == chunk.surface &&
                       calls_.back().arena == chunk.place.arena &&
                       calls_.back().indices <= most - count;
    if (!joins) calls_.push_back({chunk.surface, chunk.place.arena, commands_.size() - 1, 0, 0});
    ++calls_.back().count;
    calls_.back().indices += count;
  }
}

BufferBox ChunkDraws::pixelsOf(const SceneView& view, int surface) const {
  BufferBox pixels;
  for (const KeptChunk* chunk : seen_) {
    if (chunk->surface != surface) continue;
    auto corners = cornersOf({chunk->lower, chunk->upper});
    for (glm::dvec3& corner : corners) corner = view.frame.lattice.toWorld(corner);
    pixels.include(view.pixelsOf(corners));
  }
  return pixels;
}

void ChunkDraws::draw(const GlChunks& chunks, int surface, bool wireframe) {
  glBindVertexArray(wireframe ? *wire_array_ : *array_);
  glBindBuffer(GL_DRAW_INDIRECT_BUFFER, wireframe ? *wire_buffer_ : *command_buffer_);
  const auto place = [](std::size_t first, std::size_t size) {
    return reinterpret_cast<const void*>(first * size);
  };
  for (const Call& call : calls_) {
    if (call.surface != surface) continue;
    const GLuint buffer = chunks.arenas().buffer(call.arena);
    const auto count = static_cast<GLsizei>(call.count);
    if (wireframe) {
      glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, buffer);
      glMultiDrawArraysIndirect(GL_TRIANGLES, place(call.first, sizeof(WireCommand)), count, 0);
    } else {
      glVertexArrayVertexBuffer(*array_, 0, buffer, 0, sizeof(SurfaceVertex));
      glVertexArrayElementBuffer(*array_, buffer);
      glMultiDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT, place(call.first, sizeof(Command)),
                                  count, 0);
    }
    ++counts_.calls;
    boundFlight(call.indices);
  }
}

// Mesa's rasteriser in software sets all triangles up before it draws them, half a kilobyte each,
// in scenes of 36 MiB of which it keeps two and more: several times the memory of the chunks. An
// early flush needs less of it, and its triangles are drawn while the next ones are set up.
void ChunkDraws::boundFlight(std::uint32_t indices) {
  in_flight_ += indices;
  if (!bounds_flight_ || in_flight_ < kIndicesInFlight) return;
  in_flight_ = 0;
  const GlFence before = std::exchange(last_flight_, GlFence::make());
  glFlush();
  before.wait();
}

}  // namespace isobrick
