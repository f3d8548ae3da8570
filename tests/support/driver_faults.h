// An OpenGL driver that reports a fault at a chosen moment. libepoxy's functions are pointers,
// which are right only once a function was called: draw a picture, and read it, first.
#pragma once

#include <epoxy/gl.h>

namespace isobrick::test {

// While it lives, the next glGetError() after fail() reports `error`, and the next
// glGetGraphicsResetStatus() after reset() a reset. One at a time.
class DriverFaults {
 public:
  DriverFaults() : error_before_(epoxy_glGetError), reset_before_(epoxy_glGetGraphicsResetStatus) {
    faults_ = this;
    epoxy_glGetError = [] {
      const GLenum error = faults_->error_;
      faults_->error_ = GL_NO_ERROR;
      return error != GL_NO_ERROR ? error : faults_->error_before_();
    };
    epoxy_glGetGraphicsResetStatus = [] {
      if (faults_->asks_until_reset_ > 0 && --faults_->asks_until_reset_ == 0) {
        faults_->error_ = 0x0507;  // GL_CONTEXT_LOST, of the next call
        ++faults_->resets_;
        return GLenum{GL_GUILTY_CONTEXT_RESET};
      }
      return GLenum{GL_NO_ERROR};
    };
  }
  ~DriverFaults() {
    epoxy_glGetError = error_before_;
    epoxy_glGetGraphicsResetStatus = reset_before_;
  }
  DriverFaults(const DriverFaults&) = delete;
  DriverFaults& operator=(const DriverFaults&) = delete;

  void fail(GLenum error) { error_ = error; }
  // At the `asks`-th question from now on.
  void reset(int asks = 1) { asks_until_reset_ = asks; }
  int resets() const { return resets_; }

 private:
  inline static DriverFaults* faults_ = nullptr;
  decltype(epoxy_glGetError) error_before_;
  decltype(epoxy_glGetGraphicsResetStatus) reset_before_;
  GLenum error_ = GL_NO_ERROR;
  int asks_until_reset_ = 0, resets_ = 0;
};

// While it lives, the first `times` frames of at least so many pixels' width end with `error`: each
// blits its samples after all that it draws.
class FailingDraws {
 public:
  FailingDraws(GLenum error, int times, int least_width = 0)
      : error_(error),
        left_(times),
        least_width_(least_width),
        get_before_(epoxy_glGetError),
        blit_before_(epoxy_glBlitNamedFramebuffer) {
    draws_ = this;
    epoxy_glGetError = [] {
      if (draws_->is_due_) {
        draws_->is_due_ = false;
        return draws_->error_;
      }
      return draws_->get_before_();
    };
    epoxy_glBlitNamedFramebuffer = [](GLuint from, GLuint to, GLint left, GLint bottom, GLint right,
                                      auto... rest) {
      if (draws_->left_ > 0 && right - left >= draws_->least_width_) {
        --draws_->left_;
        ++draws_->failures_;
        draws_->is_due_ = true;
      }
      draws_->blit_before_(from, to, left, bottom, right, rest...);
    };
  }
  ~FailingDraws() {
    epoxy_glGetError = get_before_;
    epoxy_glBlitNamedFramebuffer = blit_before_;
  }
  FailingDraws(const FailingDraws&) = delete;
  FailingDraws& operator=(const FailingDraws&) = delete;

  int failures() const { return failures_; }

 private:
  inline static FailingDraws* draws_ = nullptr;
  GLenum error_;
  int left_, least_width_, failures_ = 0;
  bool is_due_ = false;
  decltype(epoxy_glGetError) get_before_;
  decltype(epoxy_glBlitNamedFramebuffer) blit_before_;
};

}  // namespace isobrick::test
