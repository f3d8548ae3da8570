// The draw calls of the chunks of a frame: one for an arena and a surface.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <vector>

#include "isobrick/viewer/render/gl_chunks.h"
#include "isobrick/viewer/render/gl_handle.h"
#include "isobrick/viewer/render/scene_view.h"

namespace isobrick {

// What a frame took, for reports and tests.
struct DrawCounts {
  std::uint64_t calls = 0;   // of surfaces
  std::uint64_t chunks = 0;  // that may be seen
  std::uint64_t culled = 0;  // that are not
};

// The commands lie in a buffer of the card, so that a surface may be drawn several times.
class ChunkDraws {
 public:
  // `bounds_flight`: of a rasteriser in software.
  explicit ChunkDraws(bool bounds_flight);

  // For the frame's chunks that may be inside of the planes, with the colours of their surfaces.
  void collect(const GlChunks& chunks, const SceneView& view, const LatticePlanes& planes);
  // All of a surface, by the program that is in use; `wireframe`: by one that reads vertices and
  // indices itself. Adds to the counts.
  void draw(const GlChunks& chunks, int surface, bool wireframe);

  // Where the surface may be seen in the picture.
  BufferBox pixelsOf(const SceneView& view, int surface) const;

  const DrawCounts& counts() const { return counts_; }
  void resetCounts() { counts_ = {}; }

 private:
  // As the shader's attributes 2 to 4.
  struct Instance {
    glm::vec4 offset{0.0f};  // of the chunk from the snapped eye; w: 1 if coloured by value
    glm::vec4 color{0.0f};   // linear, with opacity
    std::uint32_t first_index = 0, first_word = 0;  // in units of 4 bytes
  };
  // As OpenGL reads them.
  struct Command {
    std::uint32_t count = 0, instances = 1, first_index = 0;
    std::int32_t base_vertex = 0;
    std::uint32_t base_instance = 0;
  };
  struct WireCommand {
    std::uint32_t count = 0, instances = 1, first = 0, base_instance = 0;
  };
  struct Call {
    int surface = 0;
    std::size_t arena = 0;
    std::size_t first = 0, count = 0;  // commands
    std::uint32_t indices = 0;
  };
  void add(const KeptChunk& chunk, std::uint32_t begin, std::uint32_t end, const glm::vec3& color,
           bool by_value, const SceneView& view);
  void boundFlight(std::uint32_t indices);

  const bool bounds_flight_;
  std::vector<const KeptChunk*> seen_;
  std::vector<Instance> instances_;
  std::vector<Command> commands_;
  std::vector<WireCommand> wire_commands_;
  std::vector<Call> calls_;
  GlBuffer instance_buffer_, command_buffer_, wire_buffer_;
  GlVertexArray array_, wire_array_;
  GlFence last_flight_;
  std::uint32_t in_flight_ = 0;  // indices drawn since then
  DrawCounts counts_;
};

}  // namespace isobrick
