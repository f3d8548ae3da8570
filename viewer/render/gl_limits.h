// What a graphics card can do at most, and what is done with less than usual.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace isobrick {

// The defaults are what OpenGL 4.5 promises at least; of texture, picture and samples they are what
// today's cards have.
struct GlLimits {
  int texture_size = 16384;         // GL_MAX_TEXTURE_SIZE: values or pixels to a side
  int renderbuffer_size = 16384;    // GL_MAX_RENDERBUFFER_SIZE
  int viewport_width = 16384;       // GL_MAX_VIEWPORT_DIMS
  int viewport_height = 16384;      // likewise
  int samples = 4;                  // GL_MAX_SAMPLES: of a pixel
  int clip_distances = 8;           // GL_MAX_CLIP_DISTANCES: planes that cut a triangle
  int texture_units = 16;           // GL_MAX_TEXTURE_IMAGE_UNITS: of a fragment shader
  int draw_buffers = 8;             // GL_MAX_DRAW_BUFFERS
  int depth_samples = 4;            // GL_MAX_DEPTH_TEXTURE_SAMPLES
  int fragment_storage_blocks = 8;  // GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS
  int vertex_storage_blocks = 0;    // GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS
  std::int64_t storage_block_bytes = std::int64_t{1} << 27;  // GL_MAX_SHADER_STORAGE_BLOCK_SIZE
  int work_group_invocations = 1024;  // GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS

  // Those of the context that is current.
  static GlLimits read();

  // Throws Error, which names the limit, if nothing can be drawn within them.
  void require(const std::string& device) const;

  // Greatest width and height of a picture.
  int pictureSize() const;
  // Of a pixel of a picture: 4, or fewer.
  int pictureSamples() const;
  // Greatest number of values of a slice to a side; it is sampled more coarsely then.
  int sliceSize() const { return texture_size; }
  // Pixels to a side of the picture of depths that a shadow needs, of those wanted.
  int shadowSize(int wanted) const;
  // Bytes of a buffer of chunks, of those wanted, so that edges can be read from it.
  std::size_t arenaBytes(std::size_t wanted) const;
  // The edges of triangles can be drawn from a buffer of this size.
  bool drawsEdges(std::size_t buffer_bytes) const;

  // A row of a table of limits.
  struct Row {
    std::string name;         // "GL_MAX_SAMPLES"
    std::int64_t value = 0;   // of the card
    std::int64_t wanted = 0;  // with so much nothing is given up; 0: not used
    std::string with_less;    // the consequence of less
  };
  std::vector<Row> rows() const;
  // The consequences that hold on this card, a line each.
  std::vector<std::string> consequences() const;
};

}  // namespace isobrick
