// The list of what was opened last, also one that somebody else wrote.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "isobrick/viewer/session/folder_listing.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

using Paths = std::vector<std::string>;

TEST(RecentFilesTest, TheLatestComesFirstAndOnce) {
  Paths recent = withRecent({}, "/a");
  recent = withRecent(recent, "/b");
  EXPECT_EQ(recent, (Paths{"/b", "/a"}));
  EXPECT_EQ(withRecent(recent, "/a"), (Paths{"/a", "/b"}));
  for (int i = 0; i < 100; ++i) recent = withRecent(recent, "/" + std::to_string(i));
  EXPECT_EQ(recent.size(), kMostRecentFiles);
  EXPECT_EQ(recent.front(), "/99");
}

TEST(RecentFilesTest, WhatALineCannotHoldIsNotKept) {
  for (const std::string& path :
       {std::string(), std::string("relative"), std::string("/two\nlines"), std::string("/\x1b[2J"),
        std::string("/nul\0byte", 9), std::string("/del\x7f"), "/" + std::string(5000, 'x')})
    EXPECT_EQ(withRecent({"/a"}, path), Paths{"/a"}) << path;
  EXPECT_EQ(withRecent({}, "/\xff\xfe").size(), 1u);  // names are bytes
}

TEST(RecentFilesTest, TextComesBackAndHostileTextIsLeftOut) {
  const Paths recent{"/a b", "/\xc3\xa4"};
  EXPECT_EQ(recentFromText(recentToText(recent)), recent);
  EXPECT_EQ(recentFromText("relative\n\n/a\n/a\n/\x01\n/b"), (Paths{"/a", "/b"}));
  std::string many;
  for (int i = 0; i < 1000; ++i) many += "/" + std::to_string(i) + "\n";
  EXPECT_EQ(recentFromText(many).size(), kMostRecentFiles);
}

TEST(RecentFilesTest, TheFileIsReadAgain) {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("new/folder/recent");
  EXPECT_EQ(readRecentFiles(path), Paths{});
  writeRecentFiles(path, {"/a", "/b"});
  EXPECT_EQ(readRecentFiles(path), (Paths{"/a", "/b"}));
  // Of a file without end a part is read, of a pipe nothing.
  std::ofstream(path) << "/a\n" << std::string(1 << 20, '/') << "\n/b";
  EXPECT_EQ(readRecentFiles(path), Paths{"/a"});
  ASSERT_EQ(mkfifo(folder.file("pipe").c_str(), 0600), 0);
  EXPECT_EQ(readRecentFiles(folder.file("pipe")), Paths{});
  std::ofstream(folder.file("file")) << "x";
  writeRecentFiles(folder.file("file/below/recent"), {"/a"});  // cannot be: nothing happens
  EXPECT_EQ(test::readBytes(folder.file("file")), "x");
}

TEST(RecentFilesTest, TheListLiesInTheFolderForStates) {
  setenv("XDG_STATE_HOME", "/states", 1);
  EXPECT_EQ(recentFilesPath(), "/states/isobrick/recent");
  setenv("XDG_STATE_HOME", "relative", 1);
  setenv("HOME", "/home/somebody", 1);
  EXPECT_EQ(recentFilesPath(), "/home/somebody/.local/state/isobrick/recent");
  unsetenv("HOME");
  unsetenv("XDG_STATE_HOME");
  EXPECT_EQ(recentFilesPath(), "");
}

}  // namespace
}  // namespace isobrick
