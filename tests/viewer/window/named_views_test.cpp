#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/window/output_files.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

class NamedViewsTest : public testing::Test {
 protected:
  std::string views() const { return (folder_ / "scan.views").string(); }

  static SavedView viewAt(double isovalue) {
    SavedView view;
    view.state.surfaces.front().isovalue = isovalue;
    return view;
  }
  static void waitFor(NamedViews& views, std::size_t count) {
    for (int i = 0; i < 2000 && views.names().size() < count; ++i) {
      views.update();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ASSERT_EQ(views.names().size(), count);
  }

  const test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.path();
};

TEST_F(NamedViewsTest, LieBesideTheVolume) {
  fs::create_directories(folder_ / "series");
  std::ofstream(folder_ / "ct.nii.gz") << "x";
  EXPECT_EQ(viewsFolderOf((folder_ / "ct.nii.gz").string()), (folder_ / "ct.views").string());
  EXPECT_EQ(viewsFolderOf((folder_ / "series/").string()), (folder_ / "series.views").string());
  EXPECT_EQ(viewsFolderOf("https://host/a/ct.isb?key=1"), "ct.views");
  EXPECT_EQ(viewsFolderOf("phantom:head:64"), "head-64.views");
}

TEST_F(NamedViewsTest, ComeBackInTheOrderOfTheirNames) {
  const std::vector<std::string> both{"bone", "skull"};
  {
    NamedViews first;
    first.open(views());
    first.save("skull", viewAt(700.0));
    first.save("bone", viewAt(900.0));
    first.save("skull", viewAt(800.0));
    EXPECT_EQ(first.names(), both);
  }
  NamedViews second;
  second.open(views());
  waitFor(second, 2);
  EXPECT_EQ(second.error(), "");
  EXPECT_EQ(second.names(), both);
  EXPECT_EQ(second.read("skull").state.surfaces.front().isovalue, 800.0);
  EXPECT_EQ(second.nextTo(""), "bone");
  EXPECT_EQ(second.nextTo("bone"), "skull");
  EXPECT_EQ(second.nextTo("skull"), "bone");
}

TEST_F(NamedViewsTest, AreNotLostWhileTheFolderIsRead) {
  NamedViews some;
  some.open(views());
  some.save("a", viewAt(1.0));
  some.save("b", viewAt(2.0));
  NamedViews others;
  others.open(views());
  others.save("c", viewAt(3.0));  // the list may come now or later
  waitFor(others, 3);
  EXPECT_EQ(others.names(), (std::vector<std::string>{"a", "b", "c"}));
}

TEST_F(NamedViewsTest, GoWithTheirFiles) {
  NamedViews some;
  some.open(views());
  some.save("a", viewAt(1.0));
  EXPECT_EQ(some.freeName(), "view 1");
  some.save("view 1", viewAt(1.0));
  EXPECT_EQ(some.freeName(), "view 2");
  some.remove("a");
  some.remove("view 1");
  EXPECT_TRUE(some.names().empty());
  EXPECT_TRUE(fs::is_empty(views()));
  EXPECT_EQ(some.nextTo("a"), "");
}

TEST_F(NamedViewsTest, NamesThatAreNoFilesAreRefused) {
  NamedViews some;
  some.open(views());
  for (const std::string name : {"", ".hidden", "a/b", "../a", "a\nb"})
    EXPECT_THROW(some.save(name, viewAt(1.0)), Error) << name;
  EXPECT_THROW(some.save(std::string(101, 'a'), viewAt(1.0)), Error);
  EXPECT_EQ(badViewName("Schädel, 3/4"), badViewName("a/b"));
  EXPECT_EQ(badViewName("Schädel von vorn"), "");
}

TEST_F(NamedViewsTest, AFolderThatCannotBeMadeIsNamed) {
  fs::create_directories(folder_);
  std::ofstream(views()) << "a file";
  NamedViews some;
  some.open(views());
  try {
    some.save("a", viewAt(1.0));
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(views()), std::string::npos) << error.what();
  }
  EXPECT_TRUE(some.names().empty());
}

}  // namespace
}  // namespace isobrick
