// Events on their way to the panel, whatever number of them comes between two frames.
#include "isobrick/viewer/window/input_router.h"

#include <gtest/gtest.h>
#include <imgui.h>

#include <array>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/window/gl_target.h"
#include "tests/support/field_pyramid.h"
#include "tests/support/null_renderer.h"
#include "tests/support/requirement.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

InputEvent keyEvent(InputEvent::Kind kind, Key key, bool control) {
  InputEvent event;
  event.kind = kind;
  event.key = key;
  event.control = control;
  return event;
}

InputEvent held(Key key, bool control) {
  InputEvent event = keyEvent(InputEvent::Kind::kKeyPress, key, control);
  event.repeated = true;
  return event;
}

InputEvent textEvent(char letter) {
  InputEvent event;
  event.kind = InputEvent::Kind::kText;
  event.character = static_cast<unsigned char>(letter);
  return event;
}

class InputRouterTest : public testing::Test {
 protected:
  void SetUp() override {
    try {
      target_ = std::make_unique<EglTarget>(300, 200, 1.0);
    } catch (const Error& error) {
      SKIP_UNLESS_REQUIRED(error.what());
    }
    panel_ = std::make_unique<ViewPanel>(1.0, *target_);
    router_ = std::make_unique<InputRouter>(*target_);
  }

  void type(Key key, bool control = false, bool control_after = false) {
    router_->add({keyEvent(InputEvent::Kind::kKeyPress, key, control),
                  keyEvent(InputEvent::Kind::kKeyRelease, key, control_after)});
  }
  // A frame with a field that has the keyboard.
  void frame() {
    router_->take(0.0);
    addWishes(router_->pass(*panel_, nullptr, seconds_ += 1.0), wishes_);
    ImGui::Begin("field");
    if (seconds_ == 1.0) ImGui::SetKeyboardFocusHere();
    ImGui::InputText("##text", text_.data(), text_.size());
    ImGui::End();
    panel_->draw();
  }
  // One with the question.
  void questionFrame() {
    router_->take(0.0);
    addWishes(router_->pass(*panel_, nullptr, seconds_ += 1.0), wishes_);
    addWishes(panel_->build(nullptr, {frames_, "", "", {}, "", recent_, "", "", question_, views_},
                            router_->areas(nullptr)),
              wishes_);
    panel_->draw();
  }
  int framesUntilAllWasTaken() {
    int frames = 0;
    for (; !router_->empty(); ++frames) frame();
    for (int i = 0; i < 3; ++i) frame();
    return frames;
  }
  std::string text() const { return text_.data(); }

  std::unique_ptr<EglTarget> target_;
  std::unique_ptr<ViewPanel> panel_;
  std::unique_ptr<InputRouter> router_;
  std::array<char, 64> text_{"old"};
  double seconds_ = 0.0;
  Wishes wishes_;
  std::optional<UserQuestion> question_;
  const std::deque<FrameTimes> frames_{};
  const std::vector<std::string> recent_{};
  NamedViews views_;
};

// In a frame of a second somebody types all of this.
TEST_F(InputRouterTest, NoKeyIsLostInASlowFrame) {
  for (int i = 0; i < 3; ++i) frame();
  type(Key::kEnd);
  for (const char letter : std::string(" words")) router_->add({textEvent(letter)});
  for (int i = 0; i < 3; ++i) type(Key::kBackspace);
  framesUntilAllWasTaken();
  EXPECT_EQ(text(), "old wo");
  type(Key::kLeft);
  type(Key::kBackspace);
  framesUntilAllWasTaken();
  EXPECT_EQ(text(), "old o");
}

// Ctrl counts where the key went down, not at the end of the frame.
TEST_F(InputRouterTest, ControlIsThatOfItsKey) {
  for (int i = 0; i < 3; ++i) frame();
  type(Key::kA, true, false);
  router_->add({textEvent('n')});
  type(Key::kX);
  router_->add({textEvent('x')});
  framesUntilAllWasTaken();
  EXPECT_EQ(text(), "nx");
}

// Text and different keys share a frame.
TEST_F(InputRouterTest, TypingTakesFewFrames) {
  for (int i = 0; i < 3; ++i) frame();
  for (const char letter : std::string("abcdefgh")) {
    type(static_cast<Key>(static_cast<int>(Key::kA) + letter - 'a'));
    router_->add({textEvent(letter)});
  }
  EXPECT_LE(framesUntilAllWasTaken(), 2);
}

// A slow frame has both keys: the first one ends the field, so the next one is no text.
TEST_F(InputRouterTest, AKeyAfterAFieldIsTheScenes) {
  for (int i = 0; i < 3; ++i) frame();
  type(Key::kEnter);
  type(Key::kS, true);
  framesUntilAllWasTaken();
  EXPECT_TRUE(wishes_.save_state);
  EXPECT_EQ(text(), "old");
}

// Enter would keep the picked piece, Esc end the tool, Ctrl+S save.
TEST_F(InputRouterTest, AQuestionHasAllKeys) {
  question_ = UserQuestion{"Leave?", "leave", "stay"};
  for (int i = 0; i < 2; ++i) questionFrame();
  for (const Key key : {Key::kEnter, Key::kEscape, Key::kM, Key::kHome, Key::kN}) type(key);
  type(Key::kS, true);
  type(Key::kQ, true);
  while (!router_->empty()) questionFrame();
  EXPECT_EQ(wishes_.answer, false);  // the later one
  EXPECT_TRUE(wishes_.close);        // in earnest
  EXPECT_FALSE(wishes_.save_state || wishes_.export_mesh || wishes_.first_view || wishes_.browse);
}

// The key that brought it, or came before it, is no answer, and Ctrl+Q that stays down no second
// one.
TEST_F(InputRouterTest, AKeyThatIsHeldAnswersNoQuestion) {
  router_->add({keyEvent(InputEvent::Kind::kKeyPress, Key::kEnter, false)});
  questionFrame();
  question_ = UserQuestion{"Leave?", "leave", "stay"};
  router_->add({keyEvent(InputEvent::Kind::kKeyPress, Key::kEscape, false)});
  questionFrame();
  for (int i = 0; i < 5; ++i) {
    router_->add({held(Key::kEnter, false), held(Key::kEscape, false), held(Key::kQ, true)});
    while (!router_->empty()) questionFrame();
  }
  EXPECT_FALSE(wishes_.answer);
  EXPECT_FALSE(wishes_.close);
}

// A card says some frames later what a click hit. Two clicks make a distance, also if the tool for
// angles is chosen before that.
TEST_F(InputRouterTest, EventsComeAfterTheEffectOfAClick) {
  using Kind = InputEvent::Kind;
  const test::TemporaryFolder folder;
  const auto pyramid =
      test::openField(folder, Index3(16), [](const glm::dvec3& p) { return 10.0 * p.x; });
  NullRenderer renderer;
  renderer.distance = 20.0;
  ViewSession session(pyramid, renderer, {2, std::uint64_t{1} << 30});
  session.interaction().show_panel = false;
  session.apply(InputEvent::resized(300, 200), 0.0, false);
  router_->add({InputEvent::resized(300, 200)});
  const auto frames = [&](int count) {
    for (int i = 0; i < count; ++i) {
      router_->take(0.0);
      router_->pass(*panel_, &session, seconds_ += 0.1);
      session.update(seconds_);
      session.draw();
      panel_->draw();
    }
  };
  frames(3);
  type(Key::kD);
  for (const double x : {100.0, 200.0}) {
    InputEvent event;
    event.x = x;
    event.y = 100.0;
    for (const Kind kind : {Kind::kMove, Kind::kPress, Kind::kRelease}) {
      event.kind = kind;
      router_->add({event});
    }
  }
  type(Key::kA);
  renderer.answers_late = true;
  frames(20);
  EXPECT_EQ(session.interaction().tool, Interaction::Tool::kDistance);
  EXPECT_TRUE(session.awaitsClick());
  renderer.answers_late = false;
  frames(20);
  EXPECT_EQ(session.state().measurements.size(), 1u);
  EXPECT_EQ(session.interaction().tool, Interaction::Tool::kAngle);
  EXPECT_TRUE(router_->empty());
}

}  // namespace
}  // namespace isobrick
