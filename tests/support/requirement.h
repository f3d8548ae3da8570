// Where the machine lacks what a test needs (a GPU driver, the right to mount) the test is skipped;
// but not where everything is required: CI sets CI=true or ISOBRICK_REQUIRE_ALL=1, and there it
// fails, so that nothing hides behind a skip for ever.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

namespace isobrick::test {

// Any value but "", "0" and "false" sets a variable.
inline bool environmentSays(const char* name) {
  const char* const value = std::getenv(name);
  const std::string text = value == nullptr ? "" : value;
  return !text.empty() && text != "0" && text != "false";
}

// A number that the environment gives, or another.
inline int environmentOr(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text != nullptr ? std::atoi(text) : otherwise;
}

inline bool everythingIsRequired() {
  return environmentSays("CI") || environmentSays("ISOBRICK_REQUIRE_ALL");
}

}  // namespace isobrick::test

// Ends the test (or SetUp) that it stands in: skipped, or failed where everything is required.
#define SKIP_UNLESS_REQUIRED(reason)                                   \
  do {                                                                 \
    if (isobrick::test::everythingIsRequired())                        \
      GTEST_FAIL() << (reason) << "; and nothing may be skipped here"; \
    GTEST_SKIP() << (reason);                                          \
  } while (false)
