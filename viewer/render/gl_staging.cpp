#include "isobrick/viewer/render/gl_staging.h"

#include <cstring>
#include <memory>

namespace isobrick {
namespace {
// The most bytes that one frame uploads.
constexpr std::size_t kStagingBytes = std::size_t{16} << 20;
}  // namespace

GlStaging::GlStaging() : buffer_(GlBuffer::make()), ring_(kStagingBytes) {
  constexpr GLbitfield kAccess = GL_MAP_WRITE_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
  glNamedBufferStorage(*buffer_, kStagingBytes, nullptr, kAccess);
  map_ = static_cast<std::byte*>(glMapNamedBufferRange(*buffer_, 0, kStagingBytes, kAccess));
  while (glGetError() != GL_NO_ERROR) {
  }
}

bool GlStaging::copy(const void* data, std::size_t bytes, GLuint buffer, std::size_t offset) {
  const std::optional<std::size_t> place = ring_.take(bytes);
  if (!place) return false;
  std::memcpy(map_ + *place, data, bytes);
  glCopyNamedBufferSubData(*buffer_, buffer, static_cast<GLintptr>(*place),
                           static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(bytes));
  return true;
}

void GlStaging::endFrame() {
  if (!ring_.isOpen()) return;
  const auto fence = std::make_shared<GlFence>(GlFence::make());
  ring_.close([fence] { return fence->isPassed(); });
}

}  // namespace isobrick
