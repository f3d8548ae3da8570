// The bound of a collapse's deviation against samples of both surfaces: random edges and stars of
// triangles, each old one with a deviation of its own.
#include "isobrick/extract/simplify/deviation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

namespace isobrick::test {
namespace {

using CornerPoints = std::array<glm::vec3, 3>;

// The surfaces lie over a plane whose normal is `up`; what it takes is height over the plane.
struct Frame {
  glm::vec3 right, ahead, up;
  glm::vec3 point(float x, float y, float height) const {
    return x * right + y * ahead + height * up;
  }
};

// Triangles around what collapses, and what comes of them.
struct Case {
  std::vector<glm::vec3> places;           // of vertices; the new one is at the origin
  std::vector<std::uint32_t> corners;      // three vertices a triangle
  std::vector<Deviation> deviations;       // of triangles
  std::vector<std::uint32_t> old_numbers;  // of triangles in the region
  std::vector<CornerPoints> old_triangles, new_triangles;
  CollapseRegion region;

  void addTriangle(std::size_t a, std::size_t b, std::size_t c) {
    for (const std::size_t v : {a, b, c}) corners.push_back(static_cast<std::uint32_t>(v));
  }
};

class RandomRegions {
 public:
  explicit RandomRegions(unsigned seed) : random_(seed) {}

  float real(float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random_);
  }
  Case make() {
    frame_ = randomFrame();
    rough_ = real(0, 0.3f);
    return real(0, 1) < 0.5f ? edge() : star();
  }
  // From a corner of the first vertex to the next one, which may stay where it is.
  Case edge() {
    Case made;
    const bool is_open = real(0, 1) < 0.4f;
    const int ring = static_cast<int>(real(3, 9.99f)) + (is_open ? 0 : 2);
    const std::size_t gone = 0, kept = 1, first = 2;
    if (is_open) {
      made.places = {point(real(-0.1f, 0.1f), real(0.2f, 0.4f)), glm::vec3(0.0f)};
    } else {
      made.places = {point(real(0, 0.3f), real(-0.2f, 0.2f)),
                     point(real(-0.3f, 0), real(-0.2f, 0.2f))};
    }
    // The edge runs to the left, so the ring begins below it. An open one is above its center.
    const float begin = is_open ? 0.1f : -0.5f, around = is_open ? 0.9f : 2.0f;
    for (int i = 0; i < ring; ++i) {
      const float part = (static_cast<float>(i) + real(-0.3f, 0.3f)) / static_cast<float>(ring);
      made.places.push_back(at(begin + around * part, real(0.7f, 1.3f)));
    }
    const auto count = static_cast<std::size_t>(ring);
    const std::size_t last_of_gone = is_open ? count - 1 : count / 2;
    made.addTriangle(gone, kept, first);
    made.addTriangle(kept, gone, first + last_of_gone);
    for (std::size_t i = 0; i < (is_open ? count - 1 : count); ++i)
      made.addTriangle(i < last_of_gone ? gone : kept, first + i, first + (i + 1) % count);
    const CornerTable table = tableOf(made);
    EXPECT_TRUE(made.region.findEdge(table, 0, is_open));
    finish(made);
    return made;
  }
  // A vertex and 4 to 8 neighbours, around each of which the ring has up to two points of its own.
  Case star() {
    Case made;
    const auto arms = static_cast<std::size_t>(real(4, 8.99f));
    const auto after = [&](std::size_t arm) { return (arm + 1) % arms; };
    made.places.push_back(point(real(-0.1f, 0.1f), real(-0.1f, 0.1f)));
    const auto angleOf = [&](float arm) { return 2 * arm / static_cast<float>(arms); };
    for (std::size_t arm = 0; arm < arms; ++arm)
      made.places.push_back(
          at(angleOf(static_cast<float>(arm) + real(-0.1f, 0.1f)), real(0.5f, 0.7f)));
    // The ring point across the side before each arm; a neighbour of four has one for both sides.
    std::vector<std::size_t> across(arms);
    std::vector<bool> has_four(arms, false);
    for (std::size_t arm = 1; arm + 1 < arms; ++arm)
      has_four[arm] = arms > 5 && !has_four[arm - 1] && real(0, 1) < 0.2f;
    for (std::size_t arm = 0; arm < arms; ++arm) {
      const std::size_t before = (arm + arms - 1) % arms;
      if (has_four[before]) {
        across[arm] = across[before];
        continue;
      }
      across[arm] = made.places.size();
      const float place = static_cast<float>(arm) - (has_four[arm] ? 0.0f : 0.5f);
      made.places.push_back(at(angleOf(place + real(-0.05f, 0.05f)), real(1.1f, 1.4f)));
    }
    for (std::size_t arm = 0; arm < arms; ++arm) {
      const std::size_t v = 1 + arm, next = 1 + after(arm);
      made.addTriangle(0, v, next);
      made.addTriangle(next, v, across[after(arm)]);
      const int own = has_four[arm] ? 0 : static_cast<int>(real(0, 2.99f));
      std::size_t last = across[arm];
      for (int i = 1; i <= own; ++i) {
        const float part = static_cast<float>(i) / static_cast<float>(own + 1) - 0.5f;
        made.places.push_back(at(angleOf(static_cast<float>(arm) + 0.8f * part), real(1.1f, 1.4f)));
        made.addTriangle(v, last, made.places.size() - 1);
        last = made.places.size() - 1;
      }
      if (!has_four[arm]) made.addTriangle(v, last, across[after(arm)]);
    }
    const CornerTable table = tableOf(made);
    EXPECT_TRUE(made.region.findStar(table, 0));
    EXPECT_TRUE(made.region.findAroundStar(table));
    finish(made);
    return made;
  }

 private:
  Frame randomFrame() {
    const glm::vec3 up = glm::normalize(glm::vec3(real(-1, 1), real(-1, 1), real(-1, 1)));
    const glm::vec3 right = glm::normalize(
        glm::cross(up, std::abs(up.x) < 0.5f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0)));
    return {right, glm::cross(up, right), up};
  }
  glm::vec3 point(float x, float y) { return frame_.point(x, y, real(-rough_, rough_)); }
  // The angle is in half turns.
  glm::vec3 at(float angle, float radius) {
    angle *= std::numbers::pi_v<float>;
    return point(radius * std::cos(angle), radius * std::sin(angle));
  }
  static CornerTable tableOf(const Case& made) {
    CornerTable table;
    table.set(made.corners, made.places.size());
    return table;
  }
  void finish(Case& made) {
    CollapseRegion& region = made.region;
    const auto placeOf = [&](int p) { return made.places[region.vertices[p]]; };
    for (int i = 0; i < region.ring; ++i) region.setPlace(i, placeOf(i));
    for (int i = 0; i < region.inner; ++i)
      region.setPlace(CollapseRegion::kFirstInner + i, placeOf(CollapseRegion::kFirstInner + i));
    for (int i = 0; i < region.triangles; ++i) {
      const auto [a, b, c] = region.old[i];
      made.old_triangles.push_back({placeOf(a), placeOf(b), placeOf(c)});
      made.old_numbers.push_back(CornerTable::triangleOf(region.corners[i]));
    }
    for (int i = 0; i < region.sides(); ++i)
      made.new_triangles.push_back({glm::vec3(0.0f), placeOf(i), placeOf((i + 1) % region.ring)});
    for (std::size_t t = 0; t < made.corners.size() / 3; ++t) {
      Deviation deviation;
      for (const std::size_t axis : {0, 1, 2, 4, 5, 6}) deviation.most[axis] = real(0, 0.1f);
      made.deviations.push_back(deviation);
    }
  }

  std::mt19937 random_;
  Frame frame_{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  float rough_ = 0;
};

// Where a line along `up` through the point meets the triangle; nothing if that is beside it, or
// nearly so.
std::optional<glm::vec3> meet(const CornerPoints& t, const glm::vec3& point, const glm::vec3& up) {
  const glm::vec3 normal = glm::cross(t[1] - t[0], t[2] - t[0]);
  const glm::vec3 at = point + up * (glm::dot(t[0] - point, normal) / glm::dot(up, normal));
  for (std::size_t side = 0; side < 3; ++side) {
    const glm::vec3 along = t[(side + 1) % 3] - t[side];
    if (glm::dot(glm::cross(along, at - t[side]), normal) < 1e-4f * glm::dot(normal, normal))
      return std::nullopt;
  }
  return at;
}

glm::vec3 meanNormal(const Case& made) {
  glm::vec3 sum(0.0f);
  for (const CornerPoints& t : made.new_triangles) sum += glm::cross(t[1] - t[0], t[2] - t[0]);
  return glm::normalize(sum);
}

TEST(DeviationBound, HoldsForAllPointsOfBothSurfacesAndIsReached) {
  RandomRegions random(7);
  DeviationBound bound;
  int followed = 0, open = 0, stars = 0;
  double said = 0, seen = 0;
  for (int n = 0; n < 1200; ++n) {
    Case made = random.make();
    const bool with_old = n % 2 == 0;
    if (!with_old) std::fill(made.deviations.begin(), made.deviations.end(), Deviation());
    if (!bound.follow(made.region, made.deviations, 100)) continue;
    ++followed;
    open += made.region.is_open ? 1 : 0;
    stars += made.region.inner > 2 ? 1 : 0;
    const glm::vec3 up = meanNormal(made);
    float longest = 0, longest_said = 0;
    for (std::size_t j = 0; j < made.new_triangles.size(); ++j) {
      const Deviation& all = bound.deviation(static_cast<int>(j));
      longest_said = std::max(longest_said, std::sqrt(all.squaredLength()));
      for (int sample = 0; sample < 60; ++sample) {
        const float a = std::sqrt(random.real(0, 1)), b = random.real(0, 1);
        const CornerPoints& t = made.new_triangles[j];
        const glm::vec3 point = (1 - a) * t[0] + a * ((1 - b) * t[1] + b * t[2]);
        for (std::size_t i = 0; i < made.old_triangles.size(); ++i) {
          const std::optional<glm::vec3> old = meet(made.old_triangles[i], point, up);
          if (!old) continue;
          longest = std::max(longest, glm::length(point - *old));
          const Deviation& before = made.deviations[made.old_numbers[i]];
          for (int axis = 0; axis < 3; ++axis) {
            const float way = (point - *old)[axis];
            ASSERT_GE(before.lower(axis) + way, all.lower(axis) - 1e-4f) << "case " << n;
            ASSERT_LE(before.upper(axis) + way, all.upper(axis) + 1e-4f) << "case " << n;
          }
        }
      }
    }
    if (with_old) continue;
    said += longest_said;
    seen += longest;
  }
  EXPECT_GT(followed, 500);
  EXPECT_GT(open, 100);
  EXPECT_GT(stars, 200);
  // Boxes are larger than what is in them, samples seldom meet the worst point.
  EXPECT_LT(said, 1.6 * seen);
}

TEST(DeviationBound, RefusesWhatIsLongerThanTheMost) {
  RandomRegions random(11);
  DeviationBound bound;
  int tried = 0;
  for (int n = 0; n < 300; ++n) {
    const Case made = random.make();
    if (!bound.follow(made.region, made.deviations, 100)) continue;
    float longest = 0;
    for (int i = 0; i < made.region.sides(); ++i)
      longest = std::max(longest, std::sqrt(bound.deviation(i).squaredLength()));
    EXPECT_TRUE(bound.follow(made.region, made.deviations, longest * 1.001f));
    EXPECT_FALSE(bound.follow(made.region, made.deviations, longest * 0.999f));
    ++tried;
  }
  EXPECT_GT(tried, 100);
}

TEST(DeviationBound, HoldsForTheLargestOpenRing) {
  constexpr std::uint32_t kGone = 0, kKept = 1, kFirst = 2, kRing = CollapseRegion::kMostRing;
  constexpr float kHeight = 0.2f;
  std::vector<glm::vec3> places = {{0, 0.3f, kHeight}, glm::vec3(0.0f)};
  std::vector<std::uint32_t> corners = {kGone, kKept, kFirst, kKept, kGone, kFirst + kRing - 1};
  for (std::uint32_t i = 0; i < kRing; ++i) {
    const float angle = std::numbers::pi_v<float> * (0.1f + 0.8f * static_cast<float>(i) / kRing);
    places.emplace_back(std::cos(angle), std::sin(angle), 0);
    if (i > 0) corners.insert(corners.end(), {kGone, kFirst + i - 1, kFirst + i});
  }
  CornerTable table;
  table.set(corners, places.size());
  CollapseRegion region;
  ASSERT_TRUE(region.findEdge(table, 0, true));
  ASSERT_EQ(region.ring, CollapseRegion::kMostRing);
  for (int i = 0; i < region.ring; ++i) region.setPlace(i, places[region.vertices[i]]);
  for (const int i : {CollapseRegion::kFirstInner, CollapseRegion::kFirstInner + 1})
    region.setPlace(i, places[region.vertices[i]]);
  DeviationBound bound;
  ASSERT_TRUE(bound.follow(region, std::vector<Deviation>(corners.size() / 3), 100));
  float longest = 0;
  for (int i = 0; i < region.sides(); ++i)
    longest = std::max(longest, std::sqrt(bound.deviation(i).squaredLength()));
  EXPECT_NEAR(longest, kHeight, 1e-5f);
}

// A ring that goes round twice, and one with a triangle upside down, have no direction.
TEST(DeviationBound, RefusesRingsThatFold) {
  RandomRegions random(3);
  Case made = random.edge();
  while (made.region.is_open || made.region.ring < 9) made = random.edge();
  CollapseRegion& region = made.region;
  DeviationBound bound;
  const auto putRing = [&](float turns, float rise) {
    for (int i = 0; i < region.ring; ++i) {
      const auto part = static_cast<float>(i) / static_cast<float>(region.ring);
      const float angle = 2 * turns * std::numbers::pi_v<float> * part;
      region.setPlace(i, {std::cos(angle), std::sin(angle), rise * part});
    }
  };
  region.setPlace(CollapseRegion::kFirstInner, {0.05f, 0, 0});
  region.setPlace(CollapseRegion::kFirstInner + 1, {-0.05f, 0, 0});
  putRing(2, 1);
  EXPECT_FALSE(bound.follow(region, made.deviations, 100));
  putRing(1, 0);
  EXPECT_TRUE(bound.follow(region, made.deviations, 100));
  region.setPlace(3, {-region.places[0][3], -region.places[1][3], 0});
  EXPECT_FALSE(bound.follow(region, made.deviations, 100));
  // One with hardly any area: points 2 and 3 are nearly the same.
  region.setPlace(3, {region.places[0][2] - 1e-5f, region.places[1][2], 0});
  EXPECT_FALSE(bound.follow(region, made.deviations, 100));
}

// All of an octahedron is one star: nothing is left to be a ring.
TEST(CollapseRegion, AStarWithNothingAroundItIsRefused) {
  std::vector<std::uint32_t> corners;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const std::uint32_t next = (i + 1) % 4;
    corners.insert(corners.end(), {0, 2 + i, 2 + next, 1, 2 + next, 2 + i});
  }
  CornerTable table;
  table.set(corners, 6);
  CollapseRegion region;
  EXPECT_TRUE(region.findStar(table, 0));
  EXPECT_FALSE(region.findAroundStar(table));
}

}  // namespace
}  // namespace isobrick::test
