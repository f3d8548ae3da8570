// The bound of a collapse's deviation against samples of both surfaces: random rings of triangles,
// each old one with a deviation of its own.
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

using Triangle = std::array<glm::vec3, 3>;

// The surfaces lie over a plane whose normal is `up`; what it takes is height over the plane.
struct Frame {
  glm::vec3 right, ahead, up;
  glm::vec3 point(float x, float y, float height) const {
    return x * right + y * ahead + height * up;
  }
};

struct Case {
  CollapseRegion region;
  std::vector<Triangle> old_triangles, new_triangles;
  std::vector<Deviation> deviations;
};

class RandomRings {
 public:
  explicit RandomRings(unsigned seed) : random_(seed) {}

  float real(float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random_);
  }
  Case make() {
    Case made;
    CollapseRegion& region = made.region;
    region.is_open = real(0, 1) < 0.4f;
    region.count = static_cast<int>(real(3, 9.99f)) + (region.is_open ? 0 : 2);
    region.last_of_gone = region.is_open ? region.count - 1 : region.count / 2;
    const Frame frame = randomFrame();
    const float rough = real(0, 0.3f);
    // The edge runs to the left, so the ring begins below it. An open one is above its center.
    const float begin = region.is_open ? 0.1f : -0.5f, around = region.is_open ? 0.9f : 2.0f;
    for (int i = 0; i < region.count; ++i) {
      const float part =
          (static_cast<float>(i) + real(-0.3f, 0.3f)) / static_cast<float>(region.count);
      const float angle = (begin + around * part) * std::numbers::pi_v<float>;
      const float radius = real(0.7f, 1.3f);
      region.ring[i] =
          frame.point(radius * std::cos(angle), radius * std::sin(angle), real(-rough, rough));
    }
    if (region.is_open) {
      region.gone = frame.point(real(-0.1f, 0.1f), real(0.2f, 0.4f), real(-rough, rough));
    } else {
      region.gone = frame.point(real(0, 0.3f), real(-0.2f, 0.2f), real(-rough, rough));
      region.kept = frame.point(real(-0.3f, 0), real(-0.2f, 0.2f), real(-rough, rough));
    }
    addTriangles(made);
    return made;
  }

 private:
  Frame randomFrame() {
    const glm::vec3 up = glm::normalize(glm::vec3(real(-1, 1), real(-1, 1), real(-1, 1)));
    const glm::vec3 right = glm::normalize(
        glm::cross(up, std::abs(up.x) < 0.5f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0)));
    return {right, glm::cross(up, right), up};
  }
  void addTriangles(Case& made) {
    CollapseRegion& region = made.region;
    for (int i = 0; i < region.sides(); ++i) {
      const glm::vec3 &a = region.ring[i], &b = region.ring[region.after(i)];
      made.old_triangles.push_back({i < region.last_of_gone ? region.gone : region.kept, a, b});
      made.new_triangles.push_back({glm::vec3(0.0f), a, b});
    }
    made.old_triangles.push_back({region.gone, region.kept, region.ring[0]});
    made.old_triangles.push_back({region.kept, region.gone, region.ring[region.last_of_gone]});
    for (std::uint32_t i = 0; i < made.old_triangles.size(); ++i) {
      region.old_triangles[i] = i;
      Deviation deviation;
      deviation.lower = -glm::vec3(real(0, 0.1f), real(0, 0.1f), real(0, 0.1f));
      deviation.upper = glm::vec3(real(0, 0.1f), real(0, 0.1f), real(0, 0.1f));
      made.deviations.push_back(deviation);
    }
  }

  std::mt19937 random_;
};

// Where a line along `up` through the point meets the triangle; nothing if that is beside it, or
// nearly so.
std::optional<glm::vec3> meet(const Triangle& t, const glm::vec3& point, const glm::vec3& up) {
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
  for (const Triangle& t : made.new_triangles) sum += glm::cross(t[1] - t[0], t[2] - t[0]);
  return glm::normalize(sum);
}

TEST(DeviationBound, HoldsForAllPointsOfBothSurfacesAndIsReached) {
  RandomRings random(7);
  DeviationBound bound;
  int followed = 0, open = 0;
  double said = 0, seen = 0;
  for (int n = 0; n < 1200; ++n) {
    Case made = random.make();
    const bool with_old = n % 2 == 0;
    if (!with_old) std::fill(made.deviations.begin(), made.deviations.end(), Deviation());
    if (!bound.follow(made.region, made.deviations, 100)) continue;
    ++followed;
    open += made.region.is_open ? 1 : 0;
    const glm::vec3 up = meanNormal(made);
    float longest = 0, longest_said = 0;
    for (std::size_t j = 0; j < made.new_triangles.size(); ++j) {
      const Deviation& all = bound.deviation(static_cast<int>(j));
      longest_said = std::max(longest_said, std::sqrt(all.squaredLength()));
      for (int sample = 0; sample < 60; ++sample) {
        const float a = std::sqrt(random.real(0, 1)), b = random.real(0, 1);
        const Triangle& t = made.new_triangles[j];
        const glm::vec3 point = (1 - a) * t[0] + a * ((1 - b) * t[1] + b * t[2]);
        for (std::size_t i = 0; i < made.old_triangles.size(); ++i) {
          const std::optional<glm::vec3> old = meet(made.old_triangles[i], point, up);
          if (!old) continue;
          longest = std::max(longest, glm::length(point - *old));
          for (const glm::vec3& before : {made.deviations[i].lower, made.deviations[i].upper})
            for (int axis = 0; axis < 3; ++axis) {
              const float way = before[axis] + (point - *old)[axis];
              ASSERT_GE(way, all.lower[axis] - 1e-4f) << "case " << n;
              ASSERT_LE(way, all.upper[axis] + 1e-4f) << "case " << n;
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
  // Boxes are larger than what is in them, samples seldom meet the worst point.
  EXPECT_LT(said, 1.6 * seen);
}

TEST(DeviationBound, RefusesWhatIsLongerThanTheMost) {
  RandomRings random(11);
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

// A ring that goes round twice, and one with a triangle upside down, have no direction.
TEST(DeviationBound, RefusesRingsThatFold) {
  DeviationBound bound;
  CollapseRegion region;
  region.count = 10;
  region.last_of_gone = 4;
  for (int i = 0; i < region.count; ++i) {
    const float angle = 4 * std::numbers::pi_v<float> * static_cast<float>(i) / 10;
    region.ring[i] = {std::cos(angle), std::sin(angle), 0.1f * static_cast<float>(i)};
  }
  region.gone = {0.05f, 0, 0};
  region.kept = {-0.05f, 0, 0};
  for (std::uint32_t i = 0; i < 12; ++i) region.old_triangles[i] = i;
  const std::vector<Deviation> none(12);
  EXPECT_FALSE(bound.follow(region, none, 100));
  for (int i = 0; i < region.count; ++i) {
    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(i) / 10;
    region.ring[i] = {std::cos(angle), std::sin(angle), 0};
  }
  EXPECT_TRUE(bound.follow(region, none, 100));
  region.ring[3] = -region.ring[3];
  EXPECT_FALSE(bound.follow(region, none, 100));
}

}  // namespace
}  // namespace isobrick::test
