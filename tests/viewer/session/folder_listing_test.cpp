// Folders listed, and names of any bytes made fit to be shown.
#include "isobrick/viewer/session/folder_listing.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "isobrick/storage/error.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

TEST(FolderListingTest, FoldersComeFirstAndWhatIsNeitherIsLeftOut) {
  const test::TemporaryFolder folder;
  for (const char* name : {"b.nrrd", "a##x", ".hidden", "\xff\n"})
    std::ofstream(folder.file(name)) << "x";
  std::filesystem::create_directory(folder.file("z"));
  std::filesystem::create_symlink("b.nrrd", folder.file("link"));
  std::filesystem::create_symlink("nowhere", folder.file("dangling"));
  ASSERT_EQ(mkfifo(folder.file("pipe").c_str(), 0600), 0);
  const FolderListing listing = listFolder(std::string(folder.path()) + "/", CancelFlag());
  EXPECT_EQ(listing.folder, folder.path());
  EXPECT_EQ(
      listing.entries,
      (std::vector<FolderEntry>{
          {"z", true}, {"a##x", false}, {"b.nrrd", false}, {"link", false}, {"\xff\n", false}}));
  EXPECT_FALSE(listing.cut);
}

TEST(FolderListingTest, WhatCannotBeListedIsAnError) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(listFolder(folder.file("missing"), CancelFlag()), Error);
  std::ofstream(folder.file("file")) << "x";
  EXPECT_THROW(listFolder(folder.file("file"), CancelFlag()), Error);
  CancelFlag cancel;
  cancel.request();
  EXPECT_THROW(listFolder(folder.path(), cancel), Cancelled);
}

TEST(FolderListingTest, ManyEntriesAreCut) {
  const test::TemporaryFolder folder;
  for (std::size_t i = 0; i <= kMostFolderEntries; ++i)
    std::ofstream(folder.file(std::to_string(i)));
  const FolderListing listing = listFolder(folder.path(), CancelFlag());
  EXPECT_TRUE(listing.cut);
  EXPECT_EQ(listing.entries.size(), kMostFolderEntries);
}

TEST(FolderListingTest, ShownNamesAreOneLineOfUtf8) {
  EXPECT_EQ(shownName("scan ##1.nrrd"), "scan ##1.nrrd");
  EXPECT_EQ(shownName("\xc3\xa4\xe2\x82\xac\xf0\x9f\x98\x80"),
            "\xc3\xa4\xe2\x82\xac\xf0\x9f\x98\x80");
  EXPECT_EQ(shownName("a\nb\x1b[2J\x7f"), "a?b?[2J?");
  EXPECT_EQ(shownName("\xff\xc3"), "??");
  EXPECT_EQ(shownName("\xc0\x80"), "??");            // overlong
  EXPECT_EQ(shownName("\xed\xa0\x80"), "???");       // a surrogate
  EXPECT_EQ(shownName("\xf4\x90\x80\x80"), "????");  // beyond the last character
  EXPECT_EQ(shownName("x\xe2\x80\xaey"), "x???y");   // from right to left
  EXPECT_EQ(shownName("\xc2\x85"), "??");            // a control of the second set
}

}  // namespace
}  // namespace isobrick
