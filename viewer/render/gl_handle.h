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

using GlBuffer = GlHandle<GlBufferTraits>;
using GlVertexArray = GlHandle<GlVertexArrayTraits>;
using GlTexture = GlHandle<GlTextureTraits>;
using GlRenderbuffer = GlHandle<GlRenderbufferTraits>;
using GlFramebuffer = GlHandle<GlFramebufferTraits>;
using GlProgram = GlHandle<GlProgramTraits>;

}  // namespace isobrick
