// The radius that follows a user, found from the times that extractions and pictures take.
#include "isobrick/viewer/session/surface_pace.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace isobrick {
namespace {

SurfacePace::Rates afterDrawing(SurfacePace pace, std::uint64_t triangles, double seconds) {
  pace.noteDrawing(triangles, seconds);
  return pace.rates();
}

TEST(SurfacePaceTest, TheRadiusFindsWhatFitsIntoTheTime) {
  // A machine that makes a million triangles a second, and a surface of 4 r^2 of them.
  SurfacePace pace;
  double radius = pace.rates().radius;
  for (int i = 0; i < 20; ++i) {
    const auto triangles = static_cast<std::uint64_t>(4.0 * radius * radius);
    pace.noteExtraction(radius, triangles, triangles, static_cast<double>(triangles) / 1e6);
    radius = pace.rates().radius;
  }
  EXPECT_NEAR(pace.rates().triangles_per_second, 1e6, 1e4);
  EXPECT_NEAR(4.0 * radius * radius, PaceTimes().extraction * 1e6,
              0.05 * PaceTimes().extraction * 1e6);
}

TEST(SurfacePaceTest, ASlowRasteriserBoundsTheRadiusToo) {
  SurfacePace pace;
  pace.noteDrawing(100'000, 1.0);
  EXPECT_EQ(pace.rates().drawn_per_second, 1e5);
  for (int i = 0; i < 20; ++i) {
    const auto triangles =
        static_cast<std::uint64_t>(4.0 * pace.rates().radius * pace.rates().radius);
    pace.noteExtraction(pace.rates().radius, triangles, triangles,
                        static_cast<double>(triangles) / 1e6);
  }
  EXPECT_NEAR(4.0 * pace.rates().radius * pace.rates().radius, PaceTimes().extraction * 1e5,
              0.05 * PaceTimes().extraction * 1e5);
  EXPECT_EQ(afterDrawing(pace, 10, 5.0).drawn_per_second, 1e5);         // too few to say anything
  EXPECT_EQ(afterDrawing(pace, 1'000, 0.01).drawn_per_second, 1e5);     // a small surface, as slow
  EXPECT_EQ(afterDrawing(pace, 100'000, 0.001).drawn_per_second, 0.0);  // a graphics card
}

// A line that carries half a million triangles a second, and has its own share of the time.
TEST(SurfacePaceTest, ALineMayTakeLongerThanAnExtraction) {
  const PaceTimes times{0.06, 0.14, 0.25};
  SurfacePace pace({16.0, 2e6, 5e5}, times);
  EXPECT_EQ(pace.mostTriangles(), 105'000u);
  EXPECT_EQ(SurfacePace({16.0, 1e6, 5e5}, times).mostTriangles(), 90'000u);
  pace.noteDrawing(60'000, 0.12);
  EXPECT_EQ(pace.rates().drawn_per_second, 5e5);
  EXPECT_EQ(SurfacePace({80.0}, times).quickRadius(1000.0, 0.2), 80.0);
  EXPECT_EQ(SurfacePace({80.0}, times).quickRadius(1000.0, 0.5), 40.0);
}

TEST(SurfacePaceTest, StepsAreBoundedAndNeverBelowTheLeast) {
  SurfacePace pace;
  pace.noteExtraction(100.0, 1, 1, 1e-6);
  EXPECT_DOUBLE_EQ(pace.rates().radius, 200.0);  // an empty surface says little
  pace.noteExtraction(100.0, 50'000'000, 50'000'000, 10.0);
  EXPECT_DOUBLE_EQ(pace.rates().radius, 50.0);
  for (int i = 0; i < 20; ++i)
    pace.noteExtraction(pace.rates().radius, 50'000'000, 50'000'000, 10.0);
  EXPECT_DOUBLE_EQ(pace.rates().radius, SurfacePace::kLeastRadius);
}

TEST(SurfacePaceTest, PassesDoubleUpToWhatIsWanted) {
  EXPECT_EQ(SurfacePace({16.0}).passRadii(100.0), (std::vector<double>{16.0, 32.0, 64.0, 100.0}));
  EXPECT_EQ(SurfacePace({16.0}).passRadii(70.0), (std::vector<double>{16.0, 32.0, 70.0}));
  EXPECT_EQ(SurfacePace({50.0}).passRadii(20.0), (std::vector<double>{20.0}));
  EXPECT_EQ(SurfacePace({0.0}).passRadii(8.0), (std::vector<double>{8.0}));
  EXPECT_EQ(SurfacePace({16.0}).passRadii(17.0),
            (std::vector<double>{16.0, 17.0}));  // something quick comes first
  EXPECT_EQ(SurfacePace::finerRadii(16.0, 100.0), (std::vector<double>{32.0, 64.0, 100.0}));
  EXPECT_EQ(SurfacePace::finerRadii(49.0, 100.0), (std::vector<double>{100.0}));  // not 98 before
  EXPECT_EQ(SurfacePace::finerRadii(3.0, 5.0), (std::vector<double>{5.0}));
}

TEST(SurfacePaceTest, AHandThatSeesNothingNewGetsLess) {
  EXPECT_EQ(SurfacePace({80.0}).quickRadius(1000.0, 0.0), 80.0);
  EXPECT_EQ(SurfacePace({80.0}).quickRadius(1000.0, 0.1), 80.0);
  EXPECT_EQ(SurfacePace({80.0}).quickRadius(1000.0, 0.2), 40.0);
  EXPECT_EQ(SurfacePace({80.0}).quickRadius(1000.0, 5.0), 20.0);
  EXPECT_EQ(SurfacePace({10.0}).quickRadius(1000.0, 5.0), SurfacePace::kLeastRadius);
}

TEST(SurfacePaceTest, ASurfaceThatIsKnownToBeLargerGetsASmallerRadiusAtOnce) {
  SurfacePace pace({100.0});
  const auto triangles = static_cast<std::uint64_t>(PaceTimes().extraction * 1e6);
  pace.noteExtraction(100.0, triangles, triangles, PaceTimes().extraction, 1e5);
  EXPECT_NEAR(pace.quickRadius(1000.0, 0.0, 1e5), 100.0, 1e-6);
  EXPECT_NEAR(pace.quickRadius(1000.0, 0.0, 16e5), 25.0, 1e-6);
  EXPECT_NEAR(pace.quickRadius(1000.0, 0.0, 1e3), 200.0, 1e-6);  // by no more than that
  EXPECT_NEAR(pace.quickRadius(1000.0, 0.0, 1e12), 10.0, 1e-6);  // nor that
  EXPECT_NEAR(pace.quickRadius(1000.0, 0.0), 100.0, 1e-6);       // not known
}

TEST(SurfacePaceTest, ASurfaceThatSuddenlyGrowsGetsASmallerRadius) {
  EXPECT_EQ(SurfacePace().mostTriangles(), 0u);
  SurfacePace pace({40.0, 1e6, 0.0});
  EXPECT_EQ(pace.mostTriangles(), 90'000u);
  pace = SurfacePace({40.0, 1e6, 1e5});
  EXPECT_EQ(pace.mostTriangles(), 9'000u);
  EXPECT_EQ(SurfacePace::smallerRadii(40.0), (std::vector<double>{20.0, 10.0}));
  EXPECT_EQ(SurfacePace::smallerRadii(20.0), (std::vector<double>{10.0}));
  EXPECT_TRUE(SurfacePace::smallerRadii(SurfacePace::kLeastRadius).empty());
}

// They take as long as many do that are found as quickly: a surface that then grows is not given
// up for it.
TEST(SurfacePaceTest, FewTrianglesDoNotMakeAMachineSlow) {
  SurfacePace pace({200.0, 5e6, 1e6});
  for (int i = 0; i < 100; ++i) {
    pace.noteExtraction(100.0, 1'700, 1'700, 0.02);
    pace.noteDrawing(1'700, 0.04);
  }
  EXPECT_EQ(pace.mostTriangles(), 90'000u);
  for (int i = 0; i < 100; ++i) pace.noteExtraction(100.0, 60'000, 60'000, 0.12);
  EXPECT_NEAR(pace.rates().triangles_per_second, 5e5, 1e4);  // it is slow
  for (int i = 0; i < 100; ++i) pace.noteDrawing(30'000, 0.12);
  EXPECT_NEAR(pace.rates().drawn_per_second, 2.5e5, 1e4);
  pace.noteExtraction(100.0, 2'000, 2'000, 0.001);  // as quick as that at least
  EXPECT_GT(pace.rates().triangles_per_second, 9e5);
}

// A coarse level that the surface reaches all at once beyond some radius, and its fine ones do not.
TEST(SurfacePaceTest, ARadiusThatWasTooLargeIsNotTriedForEveryRequest) {
  SurfacePace pace({16.0, 1e6, 0.0});
  const auto trianglesOf = [](double radius) { return radius < 200.0 ? 2'000u : 500'000u; };
  int given_up = 0;
  double smallest = 1e9;
  constexpr int kRequests = 100;
  for (int i = 0; i < kRequests; ++i) {
    double radius = pace.rates().radius;
    while (trianglesOf(radius) > pace.mostTriangles()) {
      ++given_up;
      pace.noteGivenUp(radius, pace.mostTriangles(), 0.12);
      EXPECT_LE(pace.rates().radius, 0.5 * radius);
      radius *= 0.5;
    }
    pace.noteExtraction(radius, trianglesOf(radius), trianglesOf(radius), 0.002);
    if (i > 10) smallest = std::min(smallest, radius);
  }
  EXPECT_LE(given_up, kRequests / 5);
  EXPECT_GE(smallest, 80.0);
  // Where it is gone the radius grows again.
  for (int i = 0; i < 50; ++i) pace.noteExtraction(pace.rates().radius, 2'000, 2'000, 0.002);
  EXPECT_GT(pace.rates().radius, 250.0);
}

TEST(SurfacePaceTest, AllOfASurfaceCountsForARateIfMostOfItWasMade) {
  SurfacePace pace;
  pace.noteExtraction(50.0, 100'000, 20'000, 0.02);  // a fifth: too little to say anything
  EXPECT_EQ(pace.rates().triangles_per_second, 0.0);
  pace.noteExtraction(50.0, 100'000, 50'000, 0.05);
  EXPECT_DOUBLE_EQ(pace.rates().triangles_per_second, 1e6);
}

TEST(SurfacePaceTest, ASurfaceWithoutRoomLowersTheRadius) {
  SurfacePace pace({100.0});
  pace.noteOverBudget(60.0);
  EXPECT_DOUBLE_EQ(pace.rates().radius, 42.0);
  pace.noteOverBudget(1.0);
  EXPECT_EQ(pace.rates().radius, SurfacePace::kLeastRadius);
}

TEST(SurfacePaceTest, ASlowPictureWaitsForASurfaceThatComesSoon) {
  SurfacePace pace;
  EXPECT_FALSE(pace.drawsBetterLater(0.01));  // nothing was drawn
  pace.noteDrawing(1'000, 0.3);
  EXPECT_TRUE(pace.drawsBetterLater(0.01));
  EXPECT_FALSE(pace.drawsBetterLater(0.2));  // it did not come
  EXPECT_FALSE(pace.drawsBetterLater(std::nullopt));
  pace.noteDrawing(1'000, 0.01);
  EXPECT_FALSE(pace.drawsBetterLater(0.01));
}

}  // namespace
}  // namespace isobrick
