// Volumes opened in the background, with a builder that does what the test wants.
#include "isobrick/viewer/session/volume_opener.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/storage/pyramid_file.h"
#include "tests/support/field_pyramid.h"

namespace isobrick {
namespace {

class VolumeOpenerTest : public ::testing::Test {
 protected:
  VolumeOpenerTest() {
    path_ =
        test::buildField(folder_, Index3(20), [](const glm::dvec3& p) { return glm::length(p); });
    pyramid_ = std::make_shared<const Pyramid>(path_);
  }
  static VolumeOpener::Outcome outcomeOf(VolumeOpener& opener) {
    while (true) {
      if (auto outcome = opener.poll()) return std::move(*outcome);
      std::this_thread::yield();
    }
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<const Pyramid> pyramid_;
  std::string path_;
};

TEST_F(VolumeOpenerTest, APyramidIsOpenedAsItIs) {
  VolumeOpener opener(
      [](const auto&, const auto&, const auto&) -> std::string { throw Error("built"); }, 1 << 20);
  opener.open(path_);
  const VolumeOpener::Outcome outcome = outcomeOf(opener);
  ASSERT_TRUE(outcome.volume) << outcome.error;
  EXPECT_EQ(outcome.volume->source, path_);
  EXPECT_EQ(outcome.volume->pyramid, path_);
  EXPECT_EQ(outcome.volume->file->spec().voxels, Index3(20));
  EXPECT_EQ(outcome.volume->histogram.greatest, pyramid_->valueRange().max);
  EXPECT_GT(outcome.volume->histogram.total(), 0u);
  EXPECT_FALSE(opener.status().busy);
}

TEST_F(VolumeOpenerTest, AVolumeIsBuiltWithProgress) {
  std::atomic<bool> seen{false};
  VolumeOpener opener(
      [&](const std::string& input, const BuildListener& listener, const CancelFlag&) {
        EXPECT_EQ(input, "scan.nrrd");
        listener.progress("bricks", 0.25);
        while (!seen) std::this_thread::yield();
        return path_;
      },
      1 << 20);
  EXPECT_FALSE(opener.status().busy);
  opener.open("scan.nrrd");
  while (opener.status().phase != "bricks") std::this_thread::yield();
  const VolumeOpener::Status status = opener.status();
  EXPECT_TRUE(status.busy);
  EXPECT_EQ(status.source, "scan.nrrd");
  EXPECT_EQ(status.share, 0.25);
  seen = true;
  const VolumeOpener::Outcome outcome = outcomeOf(opener);
  ASSERT_TRUE(outcome.volume) << outcome.error;
  EXPECT_EQ(outcome.volume->source, "scan.nrrd");
  EXPECT_EQ(outcome.volume->pyramid, path_);
}

TEST_F(VolumeOpenerTest, TheUserChoosesFromSeveralVolumes) {
  const std::vector<std::string> choices{"1 'overview'", "2 'thin slices'"};
  std::atomic<std::size_t> chosen{99};
  VolumeOpener opener(
      [&](const std::string&, const BuildListener& listener, const CancelFlag&) {
        chosen = listener.choose("it holds 2 series", choices);
        return path_;
      },
      1 << 20);
  opener.open("scans");
  while (opener.status().choices.empty()) std::this_thread::yield();
  EXPECT_EQ(opener.status().choices, choices);
  EXPECT_EQ(opener.status().refusal, "it holds 2 series");
  opener.choose(2);  // there is none
  opener.choose(1);
  EXPECT_TRUE(outcomeOf(opener).volume);
  EXPECT_EQ(chosen, 1u);
  EXPECT_TRUE(opener.status().choices.empty());

  opener.open("scans");
  while (opener.status().choices.empty()) std::this_thread::yield();
  opener.cancel();
  while (opener.status().busy) std::this_thread::yield();
  EXPECT_FALSE(opener.poll());
  EXPECT_TRUE(opener.status().choices.empty());
}

TEST_F(VolumeOpenerTest, WhatFailsIsToldAndTheNextGoesOn) {
  VolumeOpener opener(
      [](const auto&, const auto&, const auto&) -> std::string { throw Error("no volume"); },
      1 << 20);
  opener.open("rubbish");
  VolumeOpener::Outcome outcome = outcomeOf(opener);
  EXPECT_FALSE(outcome.volume);
  EXPECT_EQ(outcome.source, "rubbish");
  EXPECT_EQ(outcome.error, "no volume");
  const std::string false_name = folder_.file("false.isb");
  std::ofstream(false_name) << "no pyramid";
  opener.open(false_name);
  outcome = outcomeOf(opener);
  EXPECT_FALSE(outcome.volume);
  EXPECT_NE(outcome.error.find("false.isb"), std::string::npos);
  opener.open(path_);
  EXPECT_TRUE(outcomeOf(opener).volume);
}

TEST_F(VolumeOpenerTest, ANewerOpeningAndAHandEndABuild) {
  std::atomic<int> begun{0}, ended{0};
  const auto build = [&](const std::string&, const BuildListener&,
                         const CancelFlag& cancel) -> std::string {
    ++begun;
    while (!cancel.requested()) std::this_thread::yield();
    ++ended;
    throw Cancelled();
  };
  {
    VolumeOpener opener(build, 1 << 20);
    opener.open("first");
    while (begun < 1) std::this_thread::yield();
    opener.open(path_);
    EXPECT_EQ(outcomeOf(opener).source, path_);
    EXPECT_EQ(ended, 1);
    opener.open("second");
    while (begun < 2) std::this_thread::yield();
    opener.cancel();
    while (opener.status().busy) std::this_thread::yield();
    EXPECT_FALSE(opener.poll());
    opener.open("third");
    while (begun < 3) std::this_thread::yield();
  }
  EXPECT_EQ(ended, 3);  // the last one by the destructor
}

TEST_F(VolumeOpenerTest, PyramidsAreToldByTheirFirstBytesOrTheirName) {
  EXPECT_TRUE(isPyramidFile(path_));
  const std::string other = folder_.file("other name");
  std::filesystem::copy_file(path_, other);
  EXPECT_TRUE(isPyramidFile(other));
  std::ofstream(folder_.file("text.nrrd")) << "NRRD0004";
  EXPECT_FALSE(isPyramidFile(folder_.file("text.nrrd")));
  EXPECT_FALSE(isPyramidFile(folder_.path()));
  EXPECT_FALSE(isPyramidFile(folder_.file("missing.isb")));
  // Reading its first bytes would wait for ever.
  ASSERT_EQ(mkfifo(folder_.file("pipe").c_str(), 0600), 0);
  EXPECT_FALSE(isPyramidFile(folder_.file("pipe")));
}

}  // namespace
}  // namespace isobrick
