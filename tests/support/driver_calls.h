// Calls of OpenGL that a driver in software takes as they are, and a card's calls undefined or
// takes long for. libepoxy's functions are pointers, which are right only once a function was
// called: draw a picture, and read it, first.
#pragma once

#include <epoxy/gl.h>

#include <string>
#include <vector>

namespace isobrick::test {

// While it lives, every draw call is looked at: a sampler that compares has to find depths that are
// compared, and another one none of these, even if the shader asks neither. One at a time.
class SamplersOfDraws {
 public:
  SamplersOfDraws()
      : arrays_before_(epoxy_glDrawArrays), elements_before_(epoxy_glMultiDrawElementsIndirect) {
    draws_ = this;
    epoxy_glDrawArrays = [](auto... arguments) {
      draws_->look();
      draws_->arrays_before_(arguments...);
    };
    epoxy_glMultiDrawElementsIndirect = [](auto... arguments) {
      draws_->look();
      draws_->elements_before_(arguments...);
    };
  }
  ~SamplersOfDraws() {
    epoxy_glDrawArrays = arrays_before_;
    epoxy_glMultiDrawElementsIndirect = elements_before_;
  }
  SamplersOfDraws(const SamplersOfDraws&) = delete;
  SamplersOfDraws& operator=(const SamplersOfDraws&) = delete;

  int seen() const { return seen_; }                                        // samplers that compare
  const std::vector<std::string>& undefined() const { return undefined_; }  // the names of others

 private:
  void look() {
    GLint current = 0, uniforms = 0;
    glGetIntegerv(GL_CURRENT_PROGRAM, &current);
    const auto program = static_cast<GLuint>(current);
    glGetProgramiv(program, GL_ACTIVE_UNIFORMS, &uniforms);
    for (GLint i = 0; i < uniforms; ++i) {
      char name[80];
      GLint size = 0, unit = 0, texture = 0, compares = GL_NONE;
      GLenum type = 0;
      glGetActiveUniform(program, static_cast<GLuint>(i), sizeof name, nullptr, &size, &type, name);
      if (type != GL_SAMPLER_2D && type != GL_SAMPLER_2D_SHADOW) continue;
      glGetUniformiv(program, glGetUniformLocation(program, name), &unit);
      glGetIntegeri_v(GL_TEXTURE_BINDING_2D, static_cast<GLuint>(unit), &texture);
      if (texture != 0)
        glGetTextureParameteriv(static_cast<GLuint>(texture), GL_TEXTURE_COMPARE_MODE, &compares);
      seen_ += type == GL_SAMPLER_2D_SHADOW ? 1 : 0;
      if ((type == GL_SAMPLER_2D_SHADOW) != (compares == GL_COMPARE_REF_TO_TEXTURE))
        undefined_.emplace_back(name);
    }
  }

  inline static SamplersOfDraws* draws_ = nullptr;
  decltype(epoxy_glDrawArrays) arrays_before_;
  decltype(epoxy_glMultiDrawElementsIndirect) elements_before_;
  int seen_ = 0;
  std::vector<std::string> undefined_;
};

// While it lives, notes what is read back. One at a time.
class ReadsBack {
 public:
  ReadsBack() : buffer_before_(epoxy_glGetNamedBufferSubData), pixels_before_(epoxy_glReadPixels) {
    reads_ = this;
    epoxy_glGetNamedBufferSubData = [](GLuint buffer, auto... rest) {
      GLint flags = 0;
      glGetNamedBufferParameteriv(buffer, GL_BUFFER_STORAGE_FLAGS, &flags);
      ++reads_->buffers_;
      reads_->of_card_ += (flags & GL_CLIENT_STORAGE_BIT) == 0 ? 1 : 0;
      reads_->buffer_before_(buffer, rest...);
    };
    epoxy_glReadPixels = [](auto... arguments) {
      ++reads_->pixels_;
      reads_->pixels_before_(arguments...);
    };
  }
  ~ReadsBack() {
    epoxy_glGetNamedBufferSubData = buffer_before_;
    epoxy_glReadPixels = pixels_before_;
  }
  ReadsBack(const ReadsBack&) = delete;
  ReadsBack& operator=(const ReadsBack&) = delete;

  // Calls: for parts of buffers; for those of them that do not lie with the processor; for pixels.
  int buffers() const { return buffers_; }
  int buffersOfCard() const { return of_card_; }
  int pixels() const { return pixels_; }

 private:
  inline static ReadsBack* reads_ = nullptr;
  decltype(epoxy_glGetNamedBufferSubData) buffer_before_;
  decltype(epoxy_glReadPixels) pixels_before_;
  int buffers_ = 0, of_card_ = 0, pixels_ = 0;
};

}  // namespace isobrick::test
