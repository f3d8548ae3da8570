// What the user would lose is asked about first.
#include "isobrick/viewer/session/wish_guard.h"

#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

class WishGuardTest : public ::testing::Test {
 protected:
  Wishes pass(bool save, bool close, std::optional<bool> answer = {}) {
    Wishes wishes;
    wishes.save_state = save;
    wishes.close = close;
    wishes.answer = answer;
    wishes.screenshot = true;  // one that loses nothing
    const Wishes granted = guard_.pass(wishes, stakes_);
    EXPECT_TRUE(granted.screenshot);
    return granted;
  }

  WishGuard guard_;
  Stakes stakes_;
};

TEST_F(WishGuardTest, WithoutAStakeNothingIsAsked) {
  EXPECT_TRUE(pass(true, false).save_state);
  EXPECT_TRUE(pass(false, true).close);
  EXPECT_FALSE(guard_.question());
}

TEST_F(WishGuardTest, AnotherViewIsReplacedAfterAYesAlone) {
  stakes_.other_view = "scan.view.json";
  for (const bool yes : {false, true}) {
    EXPECT_FALSE(pass(true, false).save_state);
    ASSERT_TRUE(guard_.question());
    EXPECT_NE(guard_.question()->text.find("scan.view.json"), std::string::npos);
    EXPECT_FALSE(pass(true, false).save_state);  // held keys are no answer
    EXPECT_EQ(pass(false, false, yes).save_state, yes);
    EXPECT_FALSE(guard_.question());
    EXPECT_FALSE(pass(false, false, true).save_state);  // it was answered
  }
}

TEST_F(WishGuardTest, LeavingWaitsForPicturesToo) {
  stakes_.unwritten_pictures = 1;
  EXPECT_FALSE(pass(false, true).close);
  ASSERT_TRUE(guard_.question());
  EXPECT_EQ(guard_.question()->text, "A picture is not written yet. Leave without it?");
  stakes_.unwritten_pictures = 0;  // it is there
  EXPECT_TRUE(pass(false, false).close);
  stakes_ = {2, 1};
  EXPECT_FALSE(pass(false, true).close);
  EXPECT_EQ(guard_.question()->text, "3 files are not written yet. Leave without them?");
}

TEST_F(WishGuardTest, LeavingWaitsForMeshes) {
  stakes_.unwritten_meshes = 2;
  EXPECT_FALSE(pass(false, true).close);
  ASSERT_TRUE(guard_.question());
  EXPECT_NE(guard_.question()->text.find("2 meshes"), std::string::npos);
  EXPECT_FALSE(pass(false, false, false).close);
  EXPECT_FALSE(guard_.question());
  EXPECT_FALSE(pass(false, true).close);
  EXPECT_TRUE(pass(false, true).close);  // twice: in earnest
  EXPECT_FALSE(pass(false, true).close);
  stakes_.unwritten_meshes = 0;  // the last one is there
  EXPECT_TRUE(pass(false, false).close);
}

TEST(OwnViewFileTest, AFileIsOnesOwnUntilSomebodyElseWritesIt) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("scan.view.json");
  OwnViewFile own;
  EXPECT_FALSE(own.isOther(path));
  std::ofstream(path) << "by a hand";
  EXPECT_TRUE(own.isOther(path));
  own.noteWritten(path);
  EXPECT_FALSE(own.isOther(path));
  EXPECT_TRUE(own.isOther(folder.path()));
  std::ofstream(path) << "by another one";
  EXPECT_TRUE(own.isOther(path));
  own.noteWritten(path);
  own.forget();
  EXPECT_TRUE(own.isOther(path));
}

}  // namespace
}  // namespace isobrick
