// OpenGL objects that free themselves. Made and destroyed where their context is current.
#pragma once

#include <epoxy/gl.h>

#include <utility>

namespace isobrick {

// Owns one object of the kind that `Traits` makes and deletes; 0 is none.
template <typename Traits>
class GlHandle {
 public:
  GlHandle() = default;
  explicit GlHandle(GLuint id) : id_(id) {}
  GlHandle(GlHandle&& other) noexcept : id_(std::exchange(other.id_, 0)) {}
  GlHandle& operator=(GlHandle&& other) noexcept {
    std::swap(id_, other.id_);
    return *this;
  }
  ~GlHandle() {
    if (id_ != 0) Traits::destroy(id_);
  }

  template <typename... Arguments>
  static GlHandle make(Arguments... arguments) {
    return GlHandle(Traits::create(arguments...));
  }
  GLuint operator*() const { return id_; }

 private:
  GLuint id_ = 0;
};

struct GlBufferTraits {
  static GLuint create() {
    GLuint id = 0;
    glCreateBuffers(1, &id);
    return id;
  }
  static void destroy(GLuint id) { glDeleteBuffers(1, &id); }
};
struct GlVertexArrayTraits {
  static GLuint create() {
    GLuint id = 0;
    glCreateVertexArrays(1, &id);
    return id;
  }
  static void destroy(GLuint id) { glDeleteVertexArrays(1, &id); }
};
struct GlTextureTraits {
  static GLuint create(GLenum target) {
    GLuint id = 0;
    glCreateTextures(target, 1, &id);
    return id;
  }
  static void destroy(GLuint id) { glDeleteTextures(1, &id); }
};
struct GlRenderbufferTraits {
  static GLuint create() {
    GLuint id = 0;
    glCreateRenderbuffers(1, &id);
    return id;
  }
  static void destroy(GLuint id) { glDeleteRenderbuffers(1, &id); }
};
struct GlFramebufferTraits {
  static GLuint create() {
    GLuint id = 0;
    glCreateFramebuffers(1, &id);
    return id;
  }
  static void destroy(GLuint id) { glDeleteFramebuffers(1, &id); }
};
struct GlProgramTraits {
  static void destroy(GLuint id) { glDeleteProgram(id); }
};

// A moment in the stream of commands, to be waited for.
class GlFence {
 public:
  GlFence() = default;
  GlFence(GlFence&& other) noexcept : sync_(std::exchange(other.sync_, nullptr)) {}
  GlFence& operator=(GlFence&& other) noexcept {
    std::swap(sync_, other.sync_);
    return *this;
  }
  ~GlFence() {
    if (sync_ != nullptr) glDeleteSync(sync_);
  }

  static GlFence make() {
    GlFence fence;
    fence.sync_ = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
    return fence;
  }
  // Waits until all commands before it are done; returns at once if there is no fence.
  void wait() const {
    constexpr GLuint64 kSecond = 1'000'000'000;
    if (sync_ != nullptr) glClientWaitSync(sync_, GL_SYNC_FLUSH_COMMANDS_BIT, kSecond);
  }
  // Whether they are done; true as well after the loss of the context.
  bool isPassed() const {
    return sync_ == nullptr ||
           glClientWaitSync(sync_, GL_SYNC_FLUSH_COMMANDS_BIT, 0) != GL_TIMEOUT_EXPIRED;
  }

 private:
  GLsync sync_ = nullptr;
};

using GlBuffer = GlHandle<GlBufferTraits>;
using GlVertexArray = GlHandle<GlVertexArrayTraits>;
using GlTexture = GlHandle<GlTextureTraits>;
using GlRenderbuffer = GlHandle<GlRenderbufferTraits>;
using GlFramebuffer = GlHandle<GlFramebufferTraits>;
using GlProgram = GlHandle<GlProgramTraits>;

}  // namespace isobrick
