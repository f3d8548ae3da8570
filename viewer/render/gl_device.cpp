#include "isobrick/viewer/render/gl_device.h"

#include <epoxy/gl.h>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/render/gl_debug_output.h"
#include "isobrick/viewer/stream/chunk_store.h"

namespace isobrick {
namespace {
constexpr GLenum kContextLost = 0x0507;  // GL_CONTEXT_LOST

std::string driverWord(GLenum name) {
  const GLubyte* const text = glGetString(name);
  return text == nullptr ? "" : reinterpret_cast<const char*>(text);
}
}  // namespace

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

}  // namespace isobrick
