// Distances and angles between points, by hand and as text.
#include "isobrick/viewer/state/measurement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>

#include "isobrick/viewer/state/interaction.h"

namespace isobrick {
namespace {

TEST(MeasurementTest, DistancesAndAnglesAreThoseOfThePoints) {
  EXPECT_DOUBLE_EQ((ViewMeasurement{{{1, 2, 3}, {4, 6, 15}}}.value()), 13.0);
  // Far from the origin, as scanners place volumes, and for all angles, small ones too.
  const glm::dvec3 apex(1e4, -2e4, 3e4);
  const glm::dvec3 u = glm::normalize(glm::dvec3(1, 2, -1));
  const glm::dvec3 v = glm::normalize(glm::cross(u, glm::dvec3(0, 0, 1)));
  for (const double degrees : {0.001, 1.0, 37.5, 90.0, 135.0, 179.999}) {
    const double angle = degrees * std::numbers::pi / 180.0;
    const ViewMeasurement measured{
        {apex + 3.0 * u, apex, apex + 7.0 * (std::cos(angle) * u + std::sin(angle) * v)}};
    EXPECT_NEAR(measured.value(), degrees, 1e-9);
  }
  EXPECT_EQ((ViewMeasurement{{apex, apex, apex + u}}.value()), 0.0);
}

TEST(MeasurementTest, TextHasTheUnitIfItIsKnown) {
  const ViewMeasurement distance{{{0, 0, 0}, {0, 0, 12.3456}}};
  EXPECT_EQ(measurementText(distance, LengthUnit::kMillimetre), "12.35 mm");
  EXPECT_EQ(measurementText(distance, LengthUnit::kUnknown), "12.35");
  EXPECT_EQ(measurementText({{{1, 0, 0}, {0, 0, 0}, {0, 1, 0}}}, LengthUnit::kUnknown), "90.0°");
}

TEST(MeasurementTest, TheTableHasAllOfThem) {
  const std::vector<ViewMeasurement> both{{{{0, 0, 0}, {0, 0.5, 0}}},
                                          {{{1, 0, 0}, {0, 0, 0}, {0, 1, -2.25}}}};
  EXPECT_EQ(measurementsCsv(both, LengthUnit::kMillimetre),
            "number,kind,value,unit,x1,y1,z1,x2,y2,z2,x3,y3,z3\n"
            "1,distance,0.5,mm,0,0,0,0,0.5,0,,,\n"
            "2,angle,90,degrees,1,0,0,0,0,0,0,1,-2.25\n");
}

class MeasuringTest : public ::testing::Test {
 protected:
  MeasuringTest() {
    volume_.voxels = {101, 101, 101};
    state_ = firstView(volume_, 2.0);
    interaction_.size = {800, 400};
  }
  Wishes send(InputEvent::Kind kind, double x, double y) {
    InputEvent event;
    event.kind = kind;
    event.x = x;
    event.y = y;
    return applyEvent(event, seconds_ += 0.01, false, volume_, interaction_, state_);
  }
  Wishes key(Key key, bool shift = false) {
    InputEvent event;
    event.shift = shift;
    event.kind = InputEvent::Kind::kKeyPress;
    event.key = key;
    return applyEvent(event, seconds_ += 0.01, false, volume_, interaction_, state_);
  }
  // The wishes of both its events.
  Wishes click(double x, double y, double by = 0.0) {
    send(InputEvent::Kind::kMove, x, y);
    Wishes wishes = send(InputEvent::Kind::kPress, x, y);
    send(InputEvent::Kind::kMove, x + by, y);
    addWishes(send(InputEvent::Kind::kRelease, x + by, y), wishes);
    return wishes;
  }

  ViewVolume volume_;
  ViewState state_;
  Interaction interaction_;
  double seconds_ = 0.0;
};

TEST_F(MeasuringTest, ClicksAreForTheToolAlone) {
  EXPECT_FALSE(click(300, 200).measure_at);
  key(Key::kD);
  const Wishes once = click(300, 200);
  ASSERT_TRUE(once.measure_at);
  EXPECT_EQ(*once.measure_at, glm::dvec2(300, 200));
  const Wishes again = click(300, 200);  // soon after, at the same place
  EXPECT_TRUE(again.measure_at);
  EXPECT_FALSE(again.focus_at);
  // A drag turns, as ever.
  const ViewCamera before = state_.camera;
  EXPECT_FALSE(click(300, 200, 40.0).measure_at);
  EXPECT_NE(state_.camera, before);
  key(Key::kD);
  EXPECT_FALSE(click(300, 200).measure_at);
}

TEST_F(MeasuringTest, PointsBecomeMeasurementsAndCanBeTakenBack) {
  key(Key::kD);
  measureAt({1, 0, 0}, interaction_, state_);
  EXPECT_TRUE(state_.measurements.empty());
  measureAt({4, 4, 0}, interaction_, state_);
  ASSERT_EQ(state_.measurements.size(), 1u);
  EXPECT_EQ(state_.measurements[0].value(), 5.0);
  EXPECT_TRUE(interaction_.picked.empty());
  key(Key::kA);  // the other tool begins anew
  measureAt({1, 0, 0}, interaction_, state_);
  measureAt({0, 0, 0}, interaction_, state_);
  key(Key::kBackspace);
  EXPECT_EQ(interaction_.picked.size(), 1u);
  measureAt({0, 0, 0}, interaction_, state_);
  measureAt({0, 1, 0}, interaction_, state_);
  ASSERT_EQ(state_.measurements.size(), 2u);
  EXPECT_NEAR(state_.measurements[1].value(), 90.0, 1e-12);
  key(Key::kBackspace);
  EXPECT_EQ(state_.measurements.size(), 1u);
  measureAt({0, 1, 0}, interaction_, state_);
  key(Key::kEscape);
  EXPECT_EQ(interaction_.tool, Interaction::Tool::kNone);
  EXPECT_TRUE(interaction_.picked.empty());
  measureAt({0, 1, 0}, interaction_, state_);
  EXPECT_TRUE(interaction_.picked.empty());
}

TEST_F(MeasuringTest, ThereAreNoMoreThanAView) {
  key(Key::kD);
  for (std::size_t i = 0; i < 2 * (kMostMeasurements + 3); ++i)
    measureAt(glm::dvec3(static_cast<double>(i)), interaction_, state_);
  EXPECT_EQ(state_.measurements.size(), kMostMeasurements);
  EXPECT_EQ(bounded(state_, volume_).measurements, state_.measurements);
}

}  // namespace
}  // namespace isobrick
