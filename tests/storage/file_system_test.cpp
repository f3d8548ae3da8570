// Names that std::filesystem throws for: no exception but Error leaves the library.
#include "isobrick/storage/file_system.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_writer.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

class FileSystem : public testing::Test {
 protected:
  FileSystem() {
    std::ofstream(folder_.file("file")) << "12345";
    std::filesystem::create_directory_symlink("loop", folder_.file("loop"));
    std::filesystem::create_symlink("nowhere", folder_.file("link"));
  }
  const TemporaryFolder folder_;
  // The root user gets these errors, too.
  const std::string loop_ = folder_.file("loop"), too_long_ = folder_.file(std::string(300, 'a')),
                    below_file_ = folder_.file("file/below");
};

TEST_F(FileSystem, QuestionsHaveAnAnswerForEveryName) {
  for (const std::string& name : {loop_, too_long_, below_file_, std::string()}) {
    EXPECT_FALSE(isPresent(name)) << name;
    EXPECT_FALSE(isRegularFile(name)) << name;
    EXPECT_FALSE(isFolder(name)) << name;
    EXPECT_FALSE(isSpecialFile(name)) << name;
    EXPECT_FALSE(isSameFile(name, name)) << name;
    EXPECT_FALSE(holdsNothingBut(name, [](const FolderMember&) { return true; })) << name;
    EXPECT_TRUE(visitFolder(name, [](const FolderMember&) { return true; })) << name;
    EXPECT_THROW(fileBytes(name), Error) << name;
  }
  EXPECT_TRUE(makeFolders(below_file_));
  EXPECT_TRUE(makeFolders(too_long_));
  EXPECT_TRUE(isNameTaken(folder_.file("link")));
  EXPECT_TRUE(isLink(loop_));
  EXPECT_FALSE(isNameTaken(too_long_));
  EXPECT_EQ(fileBytes(folder_.file("file")), 5u);
}

TEST_F(FileSystem, MembersOfAFolderMayLeadNowhere) {
  std::set<std::string> files, others;
  EXPECT_FALSE(visitFolder(folder_.path(), [&](const FolderMember& member) {
    (member.isRegularFile() ? files : others).insert(member.name());
    EXPECT_FALSE(member.isFolder());
    return true;
  }));
  EXPECT_EQ(files, std::set<std::string>{"file"});
  EXPECT_EQ(others, (std::set<std::string>{"link", "loop"}));
}

TEST_F(FileSystem, AFolderThatIsGoneIsAnError) {
  const std::filesystem::path before = std::filesystem::current_path();
  const std::string gone = folder_.file("gone");
  std::filesystem::create_directory(gone);
  std::filesystem::current_path(gone);
  std::filesystem::remove(gone);
  EXPECT_THROW(absolutePath("scan.isb"), Error);
  EXPECT_EQ(canonicalPath("scan.isb"), "scan.isb");
  std::filesystem::current_path(before);
}

// Without its ending, the name of the temporary file, it would be short enough.
TEST_F(FileSystem, APyramidOfATooLongNameIsRefused) {
  PyramidSpec spec;
  spec.voxels = {4, 4, 4};
  EXPECT_THROW(
      PyramidWriter(folder_.file(std::string(250, 'a')), spec, "", false, nullptr, std::nullopt),
      Error);
  EXPECT_THROW(PyramidWriter(loop_ + "/scan.isb", spec, "", false, nullptr, std::nullopt), Error);
}

}  // namespace
}  // namespace isobrick::test
