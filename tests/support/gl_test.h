// Tests that need an OpenGL context: a card's, or Mesa's in software.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/egl_context.h"
#include "tests/support/requirement.h"

namespace isobrick::test {

// The context is current from setUp() until the members of the test are gone.
class GlTest : public ::testing::Test {
 protected:
  virtual void setUp() = 0;

 private:
  void SetUp() final {
    try {
      egl_ = std::make_unique<EglContext>();
    } catch (const Error& error) {
      SKIP_UNLESS_REQUIRED(error.what());
    }
    current_ = std::make_unique<EglContext::CurrentScope>(*egl_);
    setUp();
  }

  std::unique_ptr<EglContext> egl_;
  std::unique_ptr<EglContext::CurrentScope> current_;
};

}  // namespace isobrick::test
