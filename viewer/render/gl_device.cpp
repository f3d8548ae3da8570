#include "isobrick/viewer/render/gl_device.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <array>
#include <limits>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_debug_output.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {
namespace {

constexpr int kWantedSamples = 4;
constexpr int kWantedPlanes = 6;       // clip planes of a view
constexpr int kWantedUnits = 4;        // the shadow's texture is at the last one
constexpr int kWantedPicture = 16384;  // beyond this a picture takes several GiB
constexpr int kWantedSlice = 2048;     // of the finest slice of a window
constexpr std::int64_t kWantedStorage = std::int64_t{64} << 20;  // of lists; of chunks half of it
constexpr int kWantedLists = 2;                                  // buffers of what is seen through
constexpr int kLeastStorage = 1 << 16;  // with less not even a few rows have room
constexpr int kLeastPicture = 64;       // to a side; with less nothing can be shown

int limitOf(GLenum name) {
  GLint value = 0;
  glGetIntegerv(name, &value);
  return value;
}

constexpr GLenum kContextLost = 0x0507;  // GL_CONTEXT_LOST

std::string driverWord(GLenum name) {
  const GLubyte* const text = glGetString(name);
  return text == nullptr ? "" : reinterpret_cast<const char*>(text);
}

}  // namespace

GlLimits GlLimits::read() {
  GlLimits limits;
  limits.texture_size = limitOf(GL_MAX_TEXTURE_SIZE);
  limits.renderbuffer_size = limitOf(GL_MAX_RENDERBUFFER_SIZE);
  std::array<GLint, 2> viewport{};
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport.data());
  limits.viewport_width = viewport[0];
  limits.viewport_height = viewport[1];
  limits.samples = limitOf(GL_MAX_SAMPLES);
  limits.clip_distances = limitOf(GL_MAX_CLIP_DISTANCES);
  limits.texture_units = limitOf(GL_MAX_TEXTURE_IMAGE_UNITS);
  limits.draw_buffers = limitOf(GL_MAX_DRAW_BUFFERS);
  limits.depth_samples = limitOf(GL_MAX_DEPTH_TEXTURE_SAMPLES);
  limits.fragment_storage_blocks = limitOf(GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS);
  limits.vertex_storage_blocks = limitOf(GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS);
  GLint64 bytes = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &bytes);
  limits.storage_block_bytes = bytes;
  limits.work_group_invocations = limitOf(GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS);
  return limits;
}

void GlLimits::require(const std::string& device) const {
  const auto refuse = [&](const char* name, int has, int needed) {
    throw Error("cannot render: " + device + " has " + std::to_string(has) + " of " + name +
                ", and " + std::to_string(needed) +
                " are needed; update the graphics driver or use another card");
  };
  if (clip_distances < kWantedPlanes)
    refuse("GL_MAX_CLIP_DISTANCES", clip_distances, kWantedPlanes);
  if (texture_units < kWantedUnits)
    refuse("GL_MAX_TEXTURE_IMAGE_UNITS", texture_units, kWantedUnits);
  if (fragment_storage_blocks < kWantedLists)
    refuse("GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS", fragment_storage_blocks, kWantedLists);
  if (storage_block_bytes < kLeastStorage)
    refuse("GL_MAX_SHADER_STORAGE_BLOCK_SIZE", static_cast<int>(storage_block_bytes),
           kLeastStorage);
  if (draw_buffers < 1) refuse("GL_MAX_DRAW_BUFFERS", draw_buffers, 1);
  if (pictureSize() < kLeastPicture)
    refuse("GL_MAX_TEXTURE_SIZE, GL_MAX_RENDERBUFFER_SIZE or GL_MAX_VIEWPORT_DIMS", pictureSize(),
           kLeastPicture);
}

int GlLimits::pictureSize() const {
  return std::min({texture_size, renderbuffer_size, viewport_width, viewport_height});
}

int GlLimits::pictureSamples() const {
  return std::clamp(std::min(samples, depth_samples), 1, kWantedSamples);
}

int GlLimits::shadowSize(int wanted) const { return std::min(wanted, pictureSize()); }

std::size_t GlLimits::arenaBytes(std::size_t wanted) const {
  if (vertex_storage_blocks < 1) return wanted;  // no edges are read from it
  return std::min(wanted, static_cast<std::size_t>(std::max<std::int64_t>(storage_block_bytes, 0)));
}

bool GlLimits::drawsEdges(std::size_t buffer_bytes) const {
  return vertex_storage_blocks >= 1 &&
         static_cast<std::int64_t>(buffer_bytes) <= storage_block_bytes;
}

std::vector<GlLimits::Row> GlLimits::rows() const {
  const char* const smaller = "pictures are smaller";
  return {
      {"GL_MAX_TEXTURE_SIZE", texture_size, kWantedPicture,
       texture_size < kWantedSlice ? "pictures are smaller, slices and shadows coarser" : smaller},
      {"GL_MAX_RENDERBUFFER_SIZE", renderbuffer_size, kWantedPicture, smaller},
      {"GL_MAX_VIEWPORT_DIMS", std::min(viewport_width, viewport_height), kWantedPicture, smaller},
      {"GL_MAX_SAMPLES", samples, kWantedSamples, "edges are less smooth"},
      {"GL_MAX_DEPTH_TEXTURE_SAMPLES", depth_samples, kWantedSamples, "edges are less smooth"},
      {"GL_MAX_CLIP_DISTANCES", clip_distances, kWantedPlanes, "nothing is drawn"},
      {"GL_MAX_TEXTURE_IMAGE_UNITS", texture_units, kWantedUnits, "nothing is drawn"},
      {"GL_MAX_DRAW_BUFFERS", draw_buffers, 1, "nothing is drawn"},
      {"GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS", fragment_storage_blocks, kWantedLists,
       "nothing is drawn"},
      {"GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS", vertex_storage_blocks, 1,
       "edges of triangles are not drawn"},
      {"GL_MAX_SHADER_STORAGE_BLOCK_SIZE", storage_block_bytes, kWantedStorage,
       "edges of large surfaces are not drawn, and what is seen through takes longer"},
      {"GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS", work_group_invocations, 0, "not used"},
  };
}

std::vector<std::string> GlLimits::consequences() const {
  std::vector<std::string> lines;
  for (const Row& row : rows())
    if (row.value < row.wanted)
      lines.push_back(row.with_less + " (" + row.name + ": " + std::to_string(row.value) + ")");
  return lines;
}

GlDevice::GlDevice(const std::optional<GlLimits>& limits)
    : name_(driverWord(GL_RENDERER)),
      version_(driverWord(GL_VERSION)),
      vendor_(driverWord(GL_VENDOR)),
      limits_(limits ? *limits : GlLimits::read()) {
  hearCurrentDriver();
  limits_.require(name_);
  for (const char* rasteriser : {"llvmpipe", "softpipe"})  // also below Vulkan
    is_software_ = is_software_ || name_.find(rasteriser) != std::string::npos;
}

// Those of a panel among them. A driver may report a loss once, or for ever.
void GlDevice::forgetErrors() {
  constexpr int kMostKinds = 16;
  GLenum error = GL_NO_ERROR;
  for (int i = 0; i < kMostKinds && (error = glGetError()) != GL_NO_ERROR; ++i)
    is_lost_ = is_lost_ || error == kContextLost;
  if (is_lost_) throw RendererLost();
}

void GlDevice::checkErrors(const std::string& if_no_memory) {
  const GLenum error = glGetError();
  if (error == GL_NO_ERROR) return;
  is_lost_ = is_lost_ || error == kContextLost;
  forgetErrors();
  if (isLost()) throw RendererLost();
  if (error == GL_OUT_OF_MEMORY) throw NoGraphicsMemory(if_no_memory);
  throw Error("cannot draw: " + name_ + " reports the OpenGL error " + std::to_string(error) +
              "; please report it, with the version of the driver");
}

// The driver reports a reset until it is over, so the first report counts.
bool GlDevice::isLost() {
  is_lost_ = is_lost_ || glGetGraphicsResetStatus() != GL_NO_ERROR;
  return is_lost_;
}

GraphicsReport graphicsReport() {
  const EglContext context;
  const EglContext::CurrentScope current(context);
  const GlDevice device;
  GraphicsReport report;
  report.device = device.name();
  report.vendor = device.vendor();
  report.version = device.version();
  report.is_software = device.isSoftware();
  report.place = context.placeName();
  for (const EglPlace& place : eglPlaces()) report.places.push_back({place.name, place.about});
  report.limits = device.limits().rows();
  report.switched_off = device.limits().consequences();
  return report;
}

}  // namespace isobrick
