#include "isobrick/viewer/window/named_views.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "isobrick/storage/error.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

class NamedViewsTest : public testing::Test {
 protected:
  std::string views() const { return (folder_ / "scan.views").string(); }

  // A picture that is red on the left and blue on the right.
  static Image picture() {
    Image image{4, 2, std::vector<float>(24, 0.0f)};
    for (int y = 0; y < 2; ++y)
      for (int x = 0; x < 4; ++x) image.rgb[image.offsetOf(x, y) + (x < 2 ? 0u : 2u)] = 1.0f;
    return image;
  }
  static SavedView viewAt(double isovalue) {
    SavedView view;
    view.state.surfaces.front().isovalue = isovalue;
    return view;
  }
  static void waitFor(NamedViews& views, std::size_t count) {
    for (int i = 0; i < 2000 && views.views().size() < count; ++i) {
      views.update();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ASSERT_EQ(views.views().size(), count);
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

TEST_F(NamedViewsTest, ComeBackWithTheirPicturesInTheOrderOfTheirNames) {
  {
    NamedViews first;
    first.open(views());
    first.save("skull", viewAt(700.0), picture());
    first.save("bone", viewAt(900.0), picture());
    first.save("skull", viewAt(800.0), picture());
    ASSERT_EQ(first.views().size(), 2u);
  }
  NamedViews second;
  second.open(views());
  waitFor(second, 2);
  EXPECT_EQ(second.error(), "");
  EXPECT_EQ(second.views()[0].name, "bone");
  EXPECT_EQ(second.views()[1].name, "skull");
  EXPECT_EQ(second.read("skull").state.surfaces.front().isovalue, 800.0);
  const PictureBytes& thumbnail = second.views()[0].thumbnail;
  ASSERT_EQ(thumbnail.width, 4);
  ASSERT_EQ(thumbnail.height, 2);
  EXPECT_EQ(thumbnail.rgba[thumbnail.offsetOf(1, 1)], 255);
  EXPECT_EQ(thumbnail.rgba[thumbnail.offsetOf(2, 1) + 2], 255);
  EXPECT_EQ(thumbnail.rgba[thumbnail.offsetOf(2, 1)], 0);
  EXPECT_NE(second.views()[0].number, second.views()[1].number);
  EXPECT_EQ(second.nextTo(""), "bone");
  EXPECT_EQ(second.nextTo("bone"), "skull");
  EXPECT_EQ(second.nextTo("skull"), "bone");
}

TEST_F(NamedViewsTest, AreNotLostForTheirPictureOrWhileTheFolderIsRead) {
  NamedViews some;
  some.open(views());
  some.save("a", viewAt(1.0), picture());
  some.save("b", viewAt(2.0), picture());
  std::ofstream(fs::path(views()) / "a.png") << "no picture";
  fs::remove(fs::path(views()) / "b.png");
  NamedViews others;
  others.open(views());
  others.save("c", viewAt(3.0), picture());  // the list may come now or later
  waitFor(others, 3);
  EXPECT_EQ(others.views()[0].thumbnail.width, 0);
  EXPECT_EQ(others.views()[1].thumbnail.width, 0);
  EXPECT_EQ(others.views()[2].thumbnail.width, 4);
}

TEST_F(NamedViewsTest, GoWithBothTheirFiles) {
  NamedViews some;
  some.open(views());
  some.save("a", viewAt(1.0), picture());
  EXPECT_EQ(some.freeName(), "view 1");
  some.save("view 1", viewAt(1.0), picture());
  EXPECT_EQ(some.freeName(), "view 2");
  some.remove("a");
  some.remove("view 1");
  EXPECT_TRUE(some.views().empty());
  EXPECT_TRUE(fs::is_empty(views()));
  EXPECT_EQ(some.nextTo("a"), "");
}

TEST_F(NamedViewsTest, NamesThatAreNoFilesAreRefused) {
  NamedViews some;
  some.open(views());
  for (const std::string name : {"", ".hidden", "a/b", "../a", "a\nb"})
    EXPECT_THROW(some.save(name, viewAt(1.0), picture()), Error) << name;
  EXPECT_THROW(some.save(std::string(101, 'a'), viewAt(1.0), picture()), Error);
  EXPECT_EQ(badViewName("Schädel, 3/4"), badViewName("a/b"));
  EXPECT_EQ(badViewName("Schädel von vorn"), "");
}

TEST_F(NamedViewsTest, AFolderThatCannotBeMadeIsNamed) {
  fs::create_directories(folder_);
  std::ofstream(views()) << "a file";
  NamedViews some;
  some.open(views());
  try {
    some.save("a", viewAt(1.0), picture());
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(views()), std::string::npos) << error.what();
  }
  EXPECT_TRUE(some.views().empty());
}

}  // namespace
}  // namespace isobrick
