#include "tests/support/pyramid_verdict.h"

#include <gtest/gtest.h>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/every_brick.h"

namespace isobrick::test {

Verdict judge(const std::string& path) {
  Verdict verdict;
  try {
    const Pyramid pyramid(path);
    forAllBricks(pyramid, [&](int level, const Index3& brick) {
      const auto damage = verifyBrick(pyramid, level, brick);
      if (!damage) return;
      verdict.damaged.push_back(pyramid.parts().brickRow(level, brick));
      EXPECT_EQ(damage->level, level);
      EXPECT_EQ(damage->brick, brick);
      EXPECT_FALSE(damage->what.empty());
      // The caller adds the brick and the file.
      EXPECT_EQ(damage->what.find(brickName(level, brick)), std::string::npos) << damage->what;
      EXPECT_EQ(damage->what.find(path), std::string::npos) << damage->what;
    });
    verdict.rest = verifyRest(pyramid);
  } catch (const Error& error) {
    verdict.open_error = error.what();
    // One line that names the file.
    EXPECT_NE(verdict.open_error.find(path), std::string::npos) << verdict.open_error;
    EXPECT_EQ(verdict.open_error.find('\n'), std::string::npos) << verdict.open_error;
  }
  return verdict;
}

}  // namespace isobrick::test
