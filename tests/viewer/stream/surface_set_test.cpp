// Chunks that come to the card piece by piece, a frame's share at a time.
#include "isobrick/viewer/stream/surface_set.h"

#include <gtest/gtest.h>

#include <deque>
#include <optional>
#include <utility>

#include "isobrick/storage/error.h"
#include "tests/support/null_renderer.h"

namespace isobrick {
namespace {

using MessageKind = StreamMessage::Kind;

class SurfaceSetTest : public ::testing::Test {
 protected:
  void addChunk(std::uint64_t request, std::size_t bytes) {
    StreamMessage message;
    message.kind = MessageKind::kChunk;
    message.request = request;
    message.chunk.triangles.resize(bytes / sizeof(std::uint32_t));
    messages_.push_back(std::move(message));
  }
  void add(MessageKind kind, std::uint64_t request) {
    StreamMessage message;
    message.kind = kind;
    message.request = request;
    message.surfaces.emplace_back();
    messages_.push_back(std::move(message));
  }
  // Every look at the clock is `seconds` after the last one.
  SurfaceSet::News look(double seconds, UploadAllowance& allowance) {
    return set_->pump(
        [&]() -> std::optional<StreamMessage> {
          if (messages_.empty()) return std::nullopt;
          StreamMessage message = std::move(messages_.front());
          messages_.pop_front();
          return message;
        },
        [&] { return clock_ += seconds; }, allowance);
  }
  // A frame with one look.
  SurfaceSet::News frame(double seconds) {
    UploadAllowance allowance;
    const SurfaceSet::News news = look(seconds, allowance);
    uploaded_ = kUploadBytes - allowance.bytes;
    return news;
  }
  std::uint64_t uploadedBy(double seconds) {
    frame(seconds);
    return uploaded_;
  }

  std::deque<StreamMessage> messages_;
  NullRenderer renderer_;
  std::optional<SurfaceSet> set_{std::in_place, renderer_, std::uint64_t{64} << 20};
  double clock_ = 0.0;
  std::uint64_t uploaded_ = 0;  // by the last frame
};

TEST_F(SurfaceSetTest, AChunkThatIsTooMuchForAFrameComesInSeveral) {
  const std::size_t bytes = 5 * kPieceBytes + 400;
  addChunk(1, bytes);
  add(MessageKind::kPassDone, 1);
  int frames = 0;
  for (bool shown = false; !shown; ++frames) {
    const SurfaceSet::News news = frame(0.0009);  // three steps
    EXPECT_LE(uploaded_, 3 * kPieceBytes);
    shown = news.shows_another;
    EXPECT_EQ(set_->shown().empty(), !shown);
    EXPECT_EQ(set_->shownBytes() + set_->incomingBytes(), bytes);
    EXPECT_EQ(renderer_.bytesKept(), bytes);
  }
  EXPECT_GE(frames, 3);
  EXPECT_EQ(renderer_.uploadedBytes(), bytes);
  EXPECT_EQ(renderer_.endedUploads(), static_cast<std::uint64_t>(frames));
  SceneFrame drawn;
  drawn.chunks = set_->shown();
  renderer_.draw(drawn);  // throws where a part is lacking
}

TEST_F(SurfaceSetTest, AFrameTakesSixteenMebibytesHoweverFastItIs) {
  for (int chunk = 0; chunk < 20; ++chunk) addChunk(1, 2'000'000);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(uploadedBy(0.0), kUploadBytes);
    EXPECT_EQ(renderer_.uploadedBytes(), (i + 1) * kUploadBytes);
  }
}

// While a frame that draws slowly waits for the surface that comes next.
TEST_F(SurfaceSetTest, AFrameThatLooksOftenTakesNoMoreThanOneThatLooksOnce) {
  for (int chunk = 0; chunk < 20; ++chunk) addChunk(1, 2'000'000);
  UploadAllowance allowance;
  for (int i = 0; i < 3; ++i) look(0.0, allowance);
  EXPECT_EQ(renderer_.uploadedBytes(), kUploadBytes);
  EXPECT_TRUE(allowance.isSpent());
  // Nor longer, but for a piece.
  allowance = {};
  for (int i = 0; i < 3; ++i) look(0.3 * kUploadSeconds, allowance);
  EXPECT_TRUE(allowance.isSpent());
  EXPECT_LE(renderer_.uploadedBytes(), kUploadBytes + 6 * kPieceBytes);
  // While it waits there is more time.
  allowance.addWaited(0.004);
  EXPECT_DOUBLE_EQ(allowance.seconds, 0.25 * kUploadSeconds);
  allowance.addWaited(1.0);
  EXPECT_DOUBLE_EQ(allowance.seconds, kUploadSeconds);
}

// A slow machine comes to an end too.
TEST_F(SurfaceSetTest, AFrameTakesOnePieceHoweverSlowItIs) {
  addChunk(1, 2 * kPieceBytes);
  EXPECT_EQ(uploadedBy(1.0), 0u);  // room was made
  EXPECT_EQ(uploadedBy(1.0), kPieceBytes);
  EXPECT_EQ(uploadedBy(1.0), kPieceBytes);
}

TEST_F(SurfaceSetTest, WhereTheRingIsFullTheRestWaitsForTheNextFrame) {
  addChunk(1, 4 * kPieceBytes);
  add(MessageKind::kPassDone, 1);
  renderer_.pieces_left = 3;
  EXPECT_EQ(uploadedBy(0.0), 3 * kPieceBytes);
  EXPECT_EQ(uploadedBy(0.0), 0u);
  EXPECT_TRUE(set_->shown().empty());
  renderer_.pieces_left = 1;
  EXPECT_TRUE(frame(0.0).shows_another);
  EXPECT_EQ(set_->shown().size(), 1u);
}

TEST_F(SurfaceSetTest, OfWhatIsGivenUpNothingStays) {
  addChunk(1, 4 * kPieceBytes);
  add(MessageKind::kDropped, 1);
  addChunk(2, kPieceBytes / 2);
  add(MessageKind::kPassDone, 2);
  renderer_.pieces_left = 2;
  frame(0.0);
  renderer_.pieces_left = 100;
  EXPECT_TRUE(frame(0.0).shows_another);
  EXPECT_EQ(renderer_.bytesKept(), kPieceBytes / 2);
}

// Each takes its time, as each is a call of the driver.
class SlowRenderer : public NullRenderer {
 public:
  explicit SlowRenderer(double& clock) : clock_(clock) {}
  void release(ChunkId chunk) noexcept override {
    NullRenderer::release(chunk);
    clock_ += 2e-6;
  }

 private:
  double& clock_;
};

TEST_F(SurfaceSetTest, ChunksGoAFramesShareAtATime) {
  SlowRenderer slow(clock_);
  set_.emplace(slow, std::uint64_t{64} << 20);
  constexpr std::size_t kChunks = 15'000;
  for (std::size_t i = 0; i < kChunks; ++i) addChunk(1, 4);
  add(MessageKind::kPassDone, 1);
  while (set_->shown().empty()) frame(0.0);
  addChunk(2, 4);
  add(MessageKind::kPassDone, 2);
  std::size_t frames = 0;
  do {
    const double begin = clock_;
    frame(0.0);
    EXPECT_LE(clock_ - begin, kUploadSeconds + 1e-4);
    ++frames;
  } while (set_->isReleasing() || !messages_.empty());
  EXPECT_GE(frames, 10u);
  EXPECT_EQ(set_->shown().size(), 1u);
  EXPECT_EQ(slow.kept().size(), 1u);
  set_.reset();
}

// An error of the card that is neither want of memory nor a loss is shown, and no half surface.
TEST_F(SurfaceSetTest, AFailureOfTheCardIsShown) {
  class FailingRenderer : public NullRenderer {
    ChunkId reserve(const SurfaceChunk& chunk) override {
      if (kept().size() == 1) throw Error("the card reports error 1282");
      return NullRenderer::reserve(chunk);
    }
  } failing;
  set_.emplace(failing, std::uint64_t{64} << 20);
  for (int i = 0; i < 3; ++i) addChunk(1, 400);
  add(MessageKind::kPassDone, 1);
  const SurfaceSet::News news = frame(0.0);
  EXPECT_TRUE(news.failed);
  EXPECT_FALSE(news.over_budget);
  EXPECT_EQ(set_->error(), "the card reports error 1282");
  EXPECT_TRUE(set_->shown().empty());
  EXPECT_TRUE(failing.kept().empty());
  set_.reset();
}

TEST_F(SurfaceSetTest, OfAPartNothingStaysWhereAllEnds) {
  addChunk(1, 4 * kPieceBytes);
  renderer_.pieces_left = 1;
  frame(0.0);
  EXPECT_EQ(renderer_.kept().size(), 1u);
  set_.reset();
  EXPECT_TRUE(renderer_.kept().empty());
}

}  // namespace
}  // namespace isobrick
