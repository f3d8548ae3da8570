// The card behind a context: its name, what it can do at most and what is done with less than
// usual, the faults that it reports; and what draws on this machine, for people who wonder.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
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

// Made and used on the thread on which its context is current.
class GlDevice {
 public:
  // With the limits that the context has, or with these. Throws Error if they are too narrow.
  explicit GlDevice(const std::optional<GlLimits>& limits = std::nullopt);

  // Errors of earlier calls are none of the next ones, but for a loss, which it throws as
  // RendererLost.
  void forgetErrors();
  // Throws what the calls since forgetErrors() reported: RendererLost, NoGraphicsMemory with these
  // words, or Error.
  void checkErrors(const std::string& if_no_memory);
  // The driver was reset. Stays true.
  bool isLost();

  // For instance "llvmpipe (LLVM 15.0.6, 256 bits)".
  const std::string& name() const { return name_; }
  // For instance "4.5 (Core Profile) Mesa 22.3.6", and "Mesa/X.org".
  const std::string& version() const { return version_; }
  const std::string& vendor() const { return vendor_; }
  bool isSoftware() const { return is_software_; }
  const GlLimits& limits() const { return limits_; }

 private:
  std::string name_, version_, vendor_;
  GlLimits limits_;
  bool is_software_ = false;
  bool is_lost_ = false;
};

struct GraphicsReport {
  std::string device;        // "llvmpipe (LLVM 15.0.6, 256 bits)"
  std::string vendor;        // of the driver
  std::string version;       // of OpenGL and of the driver
  bool is_software = false;  // the processor draws
  std::string place;         // that it was found at: one of `places`

  struct Place {
    std::string name;   // as ISOBRICK_GRAPHICS takes it
    std::string about;  // the driver's words; may be empty
  };
  std::vector<Place> places;  // in the order in which they are tried

  std::vector<GlLimits::Row> limits;
  std::vector<std::string> switched_off;  // for the limits of this card; a line each
};

// Of pictures without a window. A window has the device of its display. Throws Error if nothing
// draws here.
GraphicsReport graphicsReport();

}  // namespace isobrick
