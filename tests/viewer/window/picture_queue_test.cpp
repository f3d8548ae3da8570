// Pictures beside the window, with a renderer that draws nothing.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <glm/geometric.hpp>
#include <thread>

#include "isobrick/viewer/window/output_files.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/null_renderer.h"

namespace isobrick {
namespace {

class PictureQueueTest : public ::testing::Test {
 protected:
  PictureQueueTest() {
    path_ = test::buildField(folder_, Index3(60), [](const glm::dvec3& p) {
      return 25.0 - glm::distance(p, glm::dvec3(30.0));
    });
    opened_ = openPyramid(path_, std::uint64_t{64} << 20);
  }
  // A window's session at rest.
  std::unique_ptr<ViewSession> window(const SessionOptions& options) {
    auto session =
        std::make_unique<ViewSession>(opened_.file, opened_.histogram, renderer_, options);
    session->apply(InputEvent::resized(200, 100), 0.0, false);
    session->show(state());
    while (!session->settled()) {
      session->update(clock_ += 0.1);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return session;
  }
  ViewState state() const {
    ViewVolume volume;
    volume.voxels = Index3(60);
    ViewState state = firstView(volume, 2.0);
    state.surfaces[0].isovalue = 5.0;
    return state;
  }
  // Until the order has ended; the most bytes of chunks that the renderer had.
  PictureQueue::Outcome draw(PictureQueue& queue, std::uint64_t& most) {
    queue.add({opened_, state(), 300, 200, folder_.file("a.png"), false});
    for (;;) {
      UploadAllowance allowance;
      if (auto ended = queue.update(clock_ += 0.1, renderer_, allowance)) return *ended;
      most = std::max(most, renderer_.bytesKept());
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  test::TemporaryFolder folder_;
  std::string path_;
  OpenedVolume opened_;
  NullRenderer renderer_;
  double clock_ = 0.0;
};

TEST_F(PictureQueueTest, PicturesAndTheWindowShareTheBudget) {
  const auto alone = window({2});
  const std::uint64_t whole = renderer_.bytesKept();
  alone->suspend();
  std::uint64_t most = 0;
  const SessionOptions scarce{2, 2 * whole - 1};
  const auto with_less = window(scarce);
  PictureQueue refusing(scarce);
  const PictureQueue::Outcome refused = draw(refusing, most);
  EXPECT_NE(refused.error.find("--gpu-memory"), std::string::npos) << refused.error;
  EXPECT_NE(refused.error.find("a.png"), std::string::npos) << refused.error;
  EXPECT_LT(most, 2 * whole);
  EXPECT_FALSE(std::filesystem::exists(folder_.file("a.png")));
  EXPECT_EQ(renderer_.bytesKept(), whole);  // the window has lost nothing
  with_less->suspend();

  const SessionOptions enough{2, 4 * whole};  // with what is shown until it is there
  const auto with_more = window(enough);
  PictureQueue drawing(enough);
  EXPECT_EQ(draw(drawing, most).error, "");
  EXPECT_TRUE(std::filesystem::exists(folder_.file("a.png")));
}

}  // namespace
}  // namespace isobrick
