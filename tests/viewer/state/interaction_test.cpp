// Events and states, replayed with exact expectations.
#include "isobrick/viewer/state/interaction.h"

#include <gtest/gtest.h>

#include <glm/geometric.hpp>
#include <random>

#include "isobrick/viewer/state/view_keys.h"

namespace isobrick {
namespace {

using Kind = InputEvent::Kind;

InputEvent at(Kind kind, double x, double y, MouseButton button = MouseButton::kLeft) {
  InputEvent event;
  event.kind = kind;
  event.x = x;
  event.y = y;
  event.button = button;
  return event;
}

InputEvent key(Key key, bool shift = false, bool control = false) {
  InputEvent event;
  event.kind = Kind::kKeyPress;
  event.key = key;
  event.shift = shift;
  event.control = control;
  return event;
}

class InteractionTest : public ::testing::Test {
 protected:
  InteractionTest() {
    volume_.voxels = {101, 101, 101};
    volume_.least_value = 0.0;
    volume_.greatest_value = 1000.0;
    state_ = firstView(volume_, 2.0);
    send(at(Kind::kResize, 800, 400));
  }

  Wishes send(const InputEvent& event, bool on_panel = false) {
    return applyEvent(event, seconds_ += 0.01, on_panel, volume_, interaction_, state_);
  }
  // A click at the place, as a user does it.
  Wishes click(double x, double y) {
    send(at(Kind::kMove, x, y));
    const Wishes wishes = send(at(Kind::kPress, x, y));
    send(at(Kind::kRelease, x, y));
    return wishes;
  }

  ViewVolume volume_;
  ViewState state_;
  Interaction interaction_;
  double seconds_ = 0.0;
};

TEST_F(InteractionTest, LeftDragTurnsByItsLengthInThePicture) {
  const ViewCamera before = state_.camera;
  send(at(Kind::kMove, 100, 100));
  EXPECT_EQ(state_.camera, before);  // no button is down
  send(at(Kind::kPress, 100, 100));
  send(at(Kind::kMove, 200, 100));
  send(at(Kind::kMove, 200, 120));
  EXPECT_DOUBLE_EQ(state_.camera.azimuth, before.azimuth - 60.0);
  EXPECT_DOUBLE_EQ(state_.camera.elevation, before.elevation + 12.0);
  EXPECT_EQ(state_.camera.pivot, before.pivot);
  send(at(Kind::kRelease, 200, 120));
  const ViewCamera after = state_.camera;
  send(at(Kind::kMove, 0, 0));
  EXPECT_EQ(state_.camera, after);
}

TEST_F(InteractionTest, MiddleAndShiftLeftDragsAreTheSamePan) {
  const ViewState start = state_;
  send(at(Kind::kMove, 10, 10));
  send(at(Kind::kPress, 10, 10, MouseButton::kMiddle));
  send(at(Kind::kMove, 50, 60));
  send(at(Kind::kRelease, 50, 60, MouseButton::kMiddle));
  const ViewCamera middle = state_.camera;
  EXPECT_NE(middle.pivot, start.camera.pivot);
  EXPECT_EQ(middle.azimuth, start.camera.azimuth);
  state_ = start;
  send(at(Kind::kMove, 10, 10));
  InputEvent press = at(Kind::kPress, 10, 10);
  press.shift = true;
  send(press);
  send(at(Kind::kMove, 50, 60));
  EXPECT_EQ(state_.camera, middle);
}

TEST_F(InteractionTest, WheelZoomsAndWithControlChangesTheRadius) {
  const ViewState start = state_;
  send(at(Kind::kMove, 700, 100));
  InputEvent wheel = at(Kind::kWheel, 700, 100);
  wheel.amount = 2.0;
  send(wheel);
  EXPECT_LT(state_.camera.distance, start.camera.distance);
  EXPECT_NE(state_.camera.pivot, start.camera.pivot);
  EXPECT_EQ(state_.focus, start.focus);
  state_ = start;
  wheel.control = true;
  send(wheel);
  EXPECT_EQ(state_.camera, start.camera);
  EXPECT_DOUBLE_EQ(state_.focus.radius, start.focus.radius * 1.12 * 1.12);
}

TEST_F(InteractionTest, WhatBeganOnAPanelStaysThere) {
  const ViewState start = state_;
  send(at(Kind::kMove, 10, 10), true);
  send(at(Kind::kPress, 10, 10), true);
  send(at(Kind::kMove, 500, 300), false);
  EXPECT_EQ(state_, start);
  send(at(Kind::kRelease, 500, 300), false);
  InputEvent wheel = at(Kind::kWheel, 0, 0);
  wheel.amount = 1.0;
  send(wheel, true);
  send(key(Key::kW), true);
  EXPECT_EQ(state_, start);
  // And what began in the picture stays there when it comes over a panel.
  send(at(Kind::kPress, 500, 300), false);
  send(at(Kind::kMove, 510, 300), true);
  EXPECT_NE(state_.camera.azimuth, start.camera.azimuth);
}

// Both clicks are noticed when a frame ends, and not before.
TEST_F(InteractionTest, ADoubleClickIsOneInSlowFramesToo) {
  const double frame = 0.6;
  const auto pressAt = [&](double noticed) {
    InputEvent press = at(Kind::kPress, 500, 200);
    press.seconds = noticed;
    press.waited = frame;
    const Wishes wishes = send(press);
    send(at(Kind::kRelease, 500, 200));
    seconds_ += frame;  // handled one a frame
    return wishes.focus_at.has_value();
  };
  send(at(Kind::kMove, 500, 200));
  EXPECT_FALSE(pressAt(10.0));
  EXPECT_TRUE(pressAt(10.0 + frame));
  // Surely not within 0.35 s.
  EXPECT_FALSE(pressAt(20.0));
  EXPECT_FALSE(pressAt(20.0 + 2 * frame));
}

TEST_F(InteractionTest, AStepOfTheIsovalueFitsTheRange) {
  const auto stepOf = [&](double least, double greatest) {
    volume_.least_value = least;
    volume_.greatest_value = greatest;
    return isovalueStep(volume_);
  };
  EXPECT_DOUBLE_EQ(stepOf(-1024.0, 3071.0), 1.0);  // a CT
  EXPECT_DOUBLE_EQ(stepOf(0.0, 1.0), 0.001);
  EXPECT_DOUBLE_EQ(stepOf(0.0, 255.0), 0.1);
  EXPECT_DOUBLE_EQ(stepOf(0.0, 65535.0), 10.0);
  EXPECT_DOUBLE_EQ(stepOf(0.0, 1000.0), 1.0);
  EXPECT_GT(stepOf(5.0, 5.0), 0.0);
  stepOf(0.0, 1.0);
  state_.surfaces[0].isovalue = 0.5;
  send(key(Key::kRight));
  EXPECT_DOUBLE_EQ(state_.surfaces[0].isovalue, 0.501);
  send(key(Key::kLeft, true));
  EXPECT_DOUBLE_EQ(state_.surfaces[0].isovalue, 0.491);
}

TEST(LetterKeyTest, LettersAreThoseOfTheLayout) {
  EXPECT_EQ(letterKey("a", 'Q'), Key::kA);  // AZERTY
  EXPECT_EQ(letterKey("m", '\0'), Key::kM);
  EXPECT_EQ(letterKey(",", 'M'), Key::kNone);
  EXPECT_EQ(letterKey("z", 'Y'), Key::kZ);         // QWERTZ
  EXPECT_EQ(letterKey("\xd1\x84", 'A'), Key::kA);  // Cyrillic
  EXPECT_EQ(letterKey("\xc3\xb6", '\0'), Key::kNone);
  EXPECT_EQ(letterKey("", 'X'), Key::kX);
  EXPECT_EQ(letterKey("1", '\0'), Key::kNone);
}

TEST_F(InteractionTest, OnlyTwoQuickClicksAtOnePlaceAreADoubleClick) {
  EXPECT_FALSE(click(100, 100).focus_at);
  const Wishes second = click(102, 101);
  ASSERT_TRUE(second.focus_at);
  EXPECT_EQ(*second.focus_at, glm::dvec2(102, 101));
  EXPECT_FALSE(click(102, 101).focus_at);  // a third one begins anew
  seconds_ += 1.0;
  EXPECT_FALSE(click(102, 101).focus_at);  // too late
  EXPECT_FALSE(click(150, 101).focus_at);  // too far
  seconds_ += 1.0;
  InputEvent told = at(Kind::kPress, 150, 101);
  told.clicks = 2;
  EXPECT_TRUE(send(told).focus_at);  // whoever sends it knows
}

TEST_F(InteractionTest, FocusOnAPointMovesFocusAndPivot) {
  volume_.geometry.spacing = glm::dvec3(2.0);
  focusOn({20.0, 40.0, 60.0}, volume_, state_);
  EXPECT_LT(glm::distance(state_.focus.center, glm::dvec3(10.0, 20.0, 30.0)), 1e-12);
  EXPECT_EQ(state_.camera.pivot, glm::dvec3(20.0, 40.0, 60.0));
}

TEST_F(InteractionTest, ArrowsMoveTheActiveIsovalue) {
  state_.surfaces = {{100.0}, {200.0}};
  state_.active_surface = 1;
  send(key(Key::kRight));
  send(key(Key::kRight, true));
  send(key(Key::kLeft));
  EXPECT_EQ(state_.surfaces[0].isovalue, 100.0);
  EXPECT_EQ(state_.surfaces[1].isovalue, 210.0);
  for (int i = 0; i < 100; ++i) send(key(Key::kRight, true));
  EXPECT_EQ(state_.surfaces[1].isovalue, 1000.0);  // the greatest value
}

TEST_F(InteractionTest, AKeyStepsThroughTheSuggestedIsovalues) {
  state_.surfaces = {{100.0}};
  send(key(Key::kR));
  EXPECT_EQ(state_.surfaces[0].isovalue, 100.0);  // none is suggested
  volume_.isovalues = {500.0, 200.0, 800.0};
  for (const double next : {200.0, 500.0, 800.0, 200.0}) {
    send(key(Key::kR));
    EXPECT_EQ(state_.surfaces[0].isovalue, next);
  }
}

TEST_F(InteractionTest, KeysToggleAndAsk) {
  const ViewState start = state_;
  for (const Key k : {Key::kW, Key::kC, Key::kL, Key::kB, Key::kS, Key::kO, Key::kPad5, Key::kO})
    send(key(k));
  EXPECT_TRUE(state_.wireframe);
  EXPECT_EQ(state_.coloring, ViewColoring::kLevel);
  EXPECT_EQ(state_.lighting, ViewLighting::kHeadlight);
  EXPECT_NE(state_.show_box, start.show_box);
  EXPECT_NE(state_.focus.show_sphere, start.focus.show_sphere);
  EXPECT_TRUE(state_.camera.orthographic);
  EXPECT_TRUE(send(key(Key::kP)).screenshot);
  EXPECT_TRUE(send(key(Key::kM)).export_mesh);
  EXPECT_TRUE(send(key(Key::kS, false, true)).save_state);
  EXPECT_TRUE(send(key(Key::kO, false, true)).load_state);
  EXPECT_TRUE(send(key(Key::kQ, false, true)).close);
  InputEvent held = key(Key::kW);
  held.repeated = true;
  send(held);
  EXPECT_TRUE(state_.wireframe);  // a held key is one press
}

TEST_F(InteractionTest, AKeyThatIsHeldGoesOnWithStepsAlone) {
  const auto hold = [&](Key which, bool control) {
    InputEvent event = key(which);
    event.control = control;
    event.repeated = true;
    return send(event);
  };
  const double before = activeSurface(state_).isovalue;
  hold(Key::kRight, false);
  EXPECT_GT(activeSurface(state_).isovalue, before);
  EXPECT_TRUE(hold(Key::kZ, true).undo);
  EXPECT_TRUE(hold(Key::kY, true).redo);
  const ViewState state = state_;
  EXPECT_FALSE(hold(Key::kQ, true).close);
  EXPECT_FALSE(hold(Key::kS, true).save_state);
  EXPECT_FALSE(hold(Key::kO, true).load_state);
  EXPECT_FALSE(hold(Key::kR, true).show_named_view);
  EXPECT_FALSE(hold(Key::kP, false).screenshot);
  EXPECT_FALSE(hold(Key::kM, false).export_mesh);
  hold(Key::kW, false);
  EXPECT_EQ(state_, state);
}

TEST_F(InteractionTest, ClipPlanesGoThroughTheFocusAndTurnRound) {
  send(key(Key::kX));
  ASSERT_EQ(state_.clip_planes.size(), 1u);
  EXPECT_EQ(state_.clip_planes[0].normal, glm::dvec3(1.0, 0.0, 0.0));
  EXPECT_EQ(state_.clip_planes[0].offset, 50.0);
  send(key(Key::kI));
  EXPECT_EQ(state_.clip_planes[0].normal, glm::dvec3(-1.0, 0.0, 0.0));
  EXPECT_EQ(state_.clip_planes[0].offset, -50.0);
  send(key(Key::kX));
  EXPECT_FALSE(state_.clip_planes[0].enabled);
  send(key(Key::kZ));
  EXPECT_EQ(state_.clip_planes.size(), 2u);
}

TEST_F(InteractionTest, FlyingMovesWithHeldKeysOnly) {
  send(key(Key::kG));
  const ViewState start = state_;
  advanceFlight(1.0, volume_, interaction_, state_);
  EXPECT_EQ(state_, start);
  send(key(Key::kW));
  advanceFlight(0.5, volume_, interaction_, state_);
  EXPECT_EQ(state_.wireframe, start.wireframe);
  const PlacedCamera before = placeCamera(start.camera, 2.0),
                     after = placeCamera(state_.camera, 2.0);
  EXPECT_GT(glm::dot(after.eye - before.eye, before.forward), 0.0);
  InputEvent release = key(Key::kW);
  release.kind = Kind::kKeyRelease;
  send(release);
  const ViewState rest = state_;
  advanceFlight(0.5, volume_, interaction_, state_);
  EXPECT_EQ(state_, rest);
}

// No sequence of events brings a view that is no view.
TEST_F(InteractionTest, RandomEventsKeepTheViewInItsBounds) {
  std::mt19937 random(13);
  const auto draw = [&](int below) {
    return static_cast<int>(random() % static_cast<unsigned>(below));
  };
  for (int i = 0; i < 20000; ++i) {
    InputEvent event = at(static_cast<Kind>(draw(7)), draw(900) - 50, draw(500) - 50,
                          static_cast<MouseButton>(draw(3)));
    if (event.kind == Kind::kResize && draw(4) != 0) continue;
    event.key = static_cast<Key>(draw(static_cast<int>(kKeyCount)));
    event.amount = draw(9) - 4;
    event.shift = draw(4) == 0;
    event.control = draw(4) == 0;
    const Wishes wishes = send(event, draw(5) == 0);
    if (wishes.focus_at)
      focusOn({draw(200) - 50.0, draw(200) - 50.0, draw(100) * 1.0}, volume_, state_);
    advanceFlight(0.01 * draw(10), volume_, interaction_, state_);
    const ViewCamera& camera = state_.camera;
    ASSERT_TRUE(camera.distance > 0.0 && std::isfinite(camera.distance)) << i;
    ASSERT_TRUE(std::isfinite(glm::length(camera.pivot))) << i;
    ASSERT_LE(std::abs(camera.elevation), 90.0) << i;
    ASSERT_LE(state_.clip_planes.size(), kMostClipPlanes) << i;
    const ViewState tame = bounded(state_, volume_);
    ASSERT_EQ(tame.focus, state_.focus) << i;
    ASSERT_EQ(wishOf(tame, volume_, 100.0), wishOf(state_, volume_, 100.0)) << i;
  }
}

TEST(InputEventTest, KeysHaveNamesOfTheirOwn) {
  for (std::size_t i = 1; i < kKeyCount; ++i) {
    ASSERT_FALSE(kKeyNames[i].empty()) << i;
    EXPECT_EQ(keyNamed(kKeyNames[i]), static_cast<Key>(i));
  }
  EXPECT_FALSE(keyNamed(""));
  EXPECT_FALSE(keyNamed("f"));
}

TEST_F(InteractionTest, WhatIsDroppedIsToBeOpened) {
  InputEvent drop;
  drop.kind = Kind::kOpen;
  drop.path = "/scans/head.nrrd";
  const ViewState before = state_;
  EXPECT_EQ(send(drop, true).open, "/scans/head.nrrd");  // on a panel as well
  EXPECT_EQ(state_, before);
  EXPECT_TRUE(send(key(Key::kN)).browse);
  EXPECT_FALSE(send(key(Key::kN), true).browse);  // typed into a field
  Wishes wishes;
  wishes.screenshot = true;
  addWishes(send(drop), wishes);
  addWishes(Wishes{}, wishes);
  EXPECT_TRUE(wishes.screenshot);
  EXPECT_EQ(wishes.open, drop.path);
}

}  // namespace
}  // namespace isobrick
