// Folders that others may write to: what they put where a temporary file will be is not used, and
// outputs are for those who could read the files before.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/write_journal.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace {

std::optional<uid_t> pretended_user;

}  // namespace

// Only root gives files away; so it is the process that becomes another user's.
extern "C" uid_t geteuid() noexcept {
  return pretended_user.value_or(static_cast<uid_t>(::syscall(SYS_geteuid)));
}

namespace isobrick::test {
namespace {

class SharedFolderTest : public testing::Test {
 protected:
  SharedFolderTest() { writeBytes(victim_, "precious"); }

  void expectRefused(const std::string& why) const {
    try {
      AtomicFile file(output_);
      FAIL() << "it was written";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
    EXPECT_EQ(readBytes(victim_), "precious");
    EXPECT_FALSE(std::filesystem::exists(output_));
  }
  static void writeOut(const std::string& path) {
    AtomicFile file(path);
    file.write("new", 3);
    file.commit();
  }
  static unsigned modeOf(const std::string& path) {
    struct stat status = {};
    return ::stat(path.c_str(), &status) == 0 ? status.st_mode & 0777 : 0;
  }

  const TemporaryFolder folder_;
  const std::string victim_ = folder_.file("victim"), output_ = folder_.file("a.ply");
  const std::string temporary_ = output_ + kTemporaryEnding;
};

TEST_F(SharedFolderTest, ALinkIsNotFollowed) {
  ASSERT_EQ(::symlink(victim_.c_str(), temporary_.c_str()), 0);
  expectRefused("cannot write");
}

TEST_F(SharedFolderTest, ASecondNameOfAnotherFileIsNotWrittenTo) {
  ASSERT_EQ(::link(victim_.c_str(), temporary_.c_str()), 0);
  expectRefused("second name");
}

TEST_F(SharedFolderTest, APipeIsNotWaitedFor) {
  ASSERT_EQ(::mkfifo(temporary_.c_str(), 0666), 0);
  expectRefused("not a regular file");
}

TEST_F(SharedFolderTest, AFileThatIsBeingWrittenIsNotTakenOver) {
  AtomicFile first(output_);
  first.write("first", 5);
  expectRefused("another process is writing");
  first.commit();
  EXPECT_EQ(readBytes(output_), "first");
}

TEST_F(SharedFolderTest, AnotherUsersLeftoverIsNotTakenOver) {
  writeBytes(temporary_, "");
  const std::string store = folder_.file("a.ome.zarr");
  std::filesystem::create_directory(store + kTemporaryEnding);
  pretended_user = ::geteuid() + 1;
  expectRefused("another user's");
  EXPECT_THROW(AtomicFolder{store}, Error);
  pretended_user.reset();
}

TEST_F(SharedFolderTest, AJournalIsANewFile) {
  const std::string journal = folder_.file("a.journal");
  ASSERT_EQ(::link(victim_.c_str(), (journal + ".new").c_str()), 0);
  WriteJournal(journal, "identity", {});
  EXPECT_EQ(readBytes(victim_), "precious");
  EXPECT_TRUE(WriteJournal::read(journal));
}

TEST_F(SharedFolderTest, WhatReplacesAFileIsForTheSamePeople) {
  const mode_t before = ::umask(022);
  writeOut(output_);
  EXPECT_EQ(modeOf(output_), 0644u);
  for (const mode_t mode : {0600u, 0664u, 0640u}) {
    ASSERT_EQ(::chmod(output_.c_str(), mode), 0);
    writeOut(output_);
    EXPECT_EQ(modeOf(output_), mode);
  }
  ::umask(077);
  writeOut(folder_.file("b.ply"));
  EXPECT_EQ(modeOf(folder_.file("b.ply")), 0600u);
  ::umask(before);
}

}  // namespace
}  // namespace isobrick::test
