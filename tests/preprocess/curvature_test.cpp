// The curvature bound: Eq. 2 against analytic surfaces, the code that never goes below, the SIMD
// fit against a plain one bit by bit, and the stored polynomials against the samples that they
// promise to bound, evaluated here on their own in double precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <glm/geometric.hpp>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "isobrick/preprocess/curvature_bricks.h"
#include "isobrick/preprocess/kernels/curvature_fit.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/curvature_code.h"
#include "tests/preprocess/bounded_volume.h"
#include "tests/preprocess/curvature_tightness.h"
#include "tests/support/array_source.h"
#include "tests/support/every_target.h"
#include "tests/support/plain_reader.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/trilinear_jet.h"

namespace isobrick::test {
namespace {

// ---- Eq. 2 ----

// The curvature of an isosurface depends on the Hessian H only through its tangential part, so
// H + g w' + w g' describes the same surface for any w. This w makes the diagonal vanish, as that
// of a trilinear function does; no component of g may be 0.
TrilinearJet<double> jetOfSurface(const glm::dvec3& g, const glm::dmat3& hessian) {
  glm::dvec3 w;
  for (int i = 0; i < 3; ++i) w[i] = -hessian[i][i] / (2 * g[i]);
  const auto mixed = [&](int i, int j) { return hessian[i][j] + g[i] * w[j] + w[i] * g[j]; };
  return {g.x, g.y, g.z, mixed(0, 1), mixed(0, 2), mixed(1, 2)};
}

glm::dvec3 randomDirection(Random& random) {
  for (;;) {
    const glm::dvec3 v(randomReal(random, -1, 1), randomReal(random, -1, 1),
                       randomReal(random, -1, 1));
    if (glm::length(v) < 1 && std::abs(v.x) > 0.1 && std::abs(v.y) > 0.1 && std::abs(v.z) > 0.1)
      return glm::normalize(v);
  }
}

TEST(TotalCurvature, SpheresHaveOneOverTwoRadiusSquared) {
  Random random(1);
  for (int round = 0; round < 1000; ++round) {
    const double radius = std::exp(randomReal(random, -3, 7));
    const double scale = randomReal(random, -5, 5);  // F and a multiple of F have the same surfaces
    const glm::dvec3 p = radius * randomDirection(random);
    const auto jet = jetOfSurface(2 * scale * p, glm::dmat3(2 * scale));
    EXPECT_NEAR(totalCurvature(jet) * 2 * radius * radius, 1, 1e-9);
  }
}

TEST(TotalCurvature, CylindersHaveHalfOfThat) {
  Random random(2);
  for (int round = 0; round < 1000; ++round) {
    const double radius = std::exp(randomReal(random, -3, 7));
    // F = |p - (p.a) a|^2: gradient 2 (I - a a') p.
    const glm::dvec3 a = randomDirection(random);
    const glm::dmat3 hessian = 2.0 * (glm::dmat3(1.0) - glm::outerProduct(a, a));
    glm::dvec3 g;
    do {
      g = 2 * radius * glm::normalize(glm::cross(a, randomDirection(random)));
    } while (std::min({std::abs(g.x), std::abs(g.y), std::abs(g.z)}) < 0.02 * radius);
    EXPECT_NEAR(totalCurvature(jetOfSurface(g, hessian)) * 4 * radius * radius, 1, 1e-9);
  }
}

TEST(TotalCurvature, PlanesHaveNoneAndSaddlesBoth) {
  EXPECT_EQ(totalCurvature(TrilinearJet<double>{1, 2, -3, 0, 0, 0}), 0);
  // The saddle 4 z + xy = 0 at the origin has the curvatures 1/4 and -1/4.
  EXPECT_EQ(totalCurvature(TrilinearJet<float>{0, 0, 4, 1, 0, 0}), 1.0f / 32);
}

TEST(TotalCurvature, AgreesWithDifferencesOfTheNormal) {
  Random random(3);
  int compared = 0;
  while (compared < 2000) {
    TrilinearCell cell;
    for (double& corner : cell.corners) corner = randomReal(random, -1, 1);
    const glm::dvec3 p(randomReal(random, 0, 1), randomReal(random, 0, 1),
                       randomReal(random, 0, 1));
    const glm::dvec3 g = cell.gradient(p);
    if (glm::length(g) < 0.2) continue;
    // The surface's shape operator: how the unit normal turns along two tangents.
    const glm::dvec3 n = glm::normalize(g);
    const glm::dvec3 u = glm::normalize(
        glm::cross(n, std::abs(n.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
    const glm::dvec3 v = glm::cross(n, u);
    constexpr double kStep = 1e-5;
    const auto turn = [&](const glm::dvec3& along) {
      return (glm::normalize(cell.gradient(p + kStep * along)) -
              glm::normalize(cell.gradient(p - kStep * along))) /
             (2 * kStep);
    };
    const glm::dvec3 du = turn(u), dv = turn(v);
    const double a = glm::dot(du, u), b = glm::dot(du, v), c = glm::dot(dv, u), d = glm::dot(dv, v);
    const double expected = (a * a + b * b + c * c + d * d) / 4;
    const auto mixed = [&](const glm::dvec3& axis_1, const glm::dvec3& axis_2) {
      return glm::dot(cell.gradient(p + kStep * axis_1) - cell.gradient(p - kStep * axis_1),
                      axis_2) /
             (2 * kStep);
    };
    const glm::dvec3 ex(1, 0, 0), ey(0, 1, 0), ez(0, 0, 1);
    const TrilinearJet<double> jet = {g.x, g.y, g.z, mixed(ex, ey), mixed(ex, ez), mixed(ey, ez)};
    EXPECT_NEAR(totalCurvature(jet), expected, 1e-6 * (1 + expected));
    EXPECT_NEAR(cell.totalCurvatureAt(p), expected, 1e-6 * (1 + expected));
    ++compared;
  }
}

// ---- the code ----

TEST(CurvatureCode, IsWhatTheFormatSays) {
  for (int code = 0; code < 256; ++code)
    EXPECT_EQ(static_cast<double>(CurvatureCode::decode(static_cast<std::uint8_t>(code))),
              plainCurvatureOfCode(static_cast<std::uint8_t>(code)))
        << code;
}

TEST(CurvatureCode, NeverGoesBelowAndIsTheSmallestThatDoesNot) {
  Random random(4);
  const auto check = [](double value) {
    const std::uint8_t code = CurvatureCode::encodeUp(value);
    ASSERT_GE(static_cast<double>(CurvatureCode::decode(code)), value);
    if (code > 0) {
      ASSERT_LT(static_cast<double>(CurvatureCode::decode(static_cast<std::uint8_t>(code - 1))),
                value);
    }
  };
  for (int round = 0; round < 300000; ++round) check(std::exp2(randomReal(random, -30, 12)));
  for (int code = 0; code < 255; ++code) {
    const auto value = static_cast<double>(CurvatureCode::decode(static_cast<std::uint8_t>(code)));
    EXPECT_EQ(CurvatureCode::encodeUp(value), code);
    check(std::nextafter(value, 1e30));
    if (value > 0) check(std::nextafter(value, 0.0));
  }
  check(std::numeric_limits<double>::denorm_min());
  check(std::numeric_limits<double>::max());
  check(std::numeric_limits<double>::infinity());
  EXPECT_EQ(CurvatureCode::encodeUp(0), 0);
}

// A coefficient that is not a number comes from an overflow: it must not become "flat".
TEST(CurvatureCode, NotANumberIsNotFlat) {
  EXPECT_EQ(CurvatureCode::encodeUp(std::numeric_limits<double>::quiet_NaN()), 255);
}

TEST(CurvatureCode, OfWholeRowsIsThatOfNumbers) {
  std::vector<float> values = {0.0f,
                               std::numeric_limits<float>::denorm_min(),
                               std::numeric_limits<float>::min(),
                               std::numeric_limits<float>::max(),
                               std::numeric_limits<float>::infinity(),
                               std::numeric_limits<float>::quiet_NaN()};
  for (int code = 1; code < 255; ++code) {
    const float value = CurvatureCode::decode(static_cast<std::uint8_t>(code));
    values.insert(values.end(), {std::nextafter(value, 0.0f), value, std::nextafter(value, 1e30f)});
  }
  Random random(9);
  for (int i = 0; i < 100000; ++i)
    values.push_back(
        std::bit_cast<float>(static_cast<std::uint32_t>(randomBelow(random, 1u << 31))));
  CurvatureRow row(static_cast<std::int64_t>(values.size()));
  for (std::size_t j = 0; j < 3; ++j)
    for (std::size_t i = 0; i < values.size(); ++i)
      row.coefficients[j][i] = values[(i + j) % values.size()];
  onEveryTarget([&] {
    std::vector<std::uint8_t> codes(3 * values.size() + 1, 77);
    encodeCurvature(row, codes.data());
    for (std::size_t i = 0; i < 3 * values.size(); ++i)
      ASSERT_EQ(codes[i],
                CurvatureCode::encodeUp(static_cast<double>(row.coefficients[i % 3][i / 3])))
          << row.coefficients[i % 3][i / 3];
    EXPECT_EQ(codes.back(), 77);
  });
}

TEST(CurvatureCode, BoundIsTheBernsteinPolynomial) {
  Random random(5);
  for (int round = 0; round < 100000; ++round) {
    std::uint8_t codes[3];
    for (std::uint8_t& code : codes)
      code = static_cast<std::uint8_t>(random() % (round % 10 == 0 ? 256 : 255));
    const auto low = static_cast<float>(randomReal(random, -1000, 1000));
    const auto high = round % 50 == 0 ? low : low + static_cast<float>(randomReal(random, 0, 500));
    const auto value = static_cast<float>(randomReal(random, -1200, 1700));
    const double expected = plainCurvatureBound(codes, {low, high}, static_cast<double>(value));
    const auto bound = static_cast<double>(curvatureBound(codes, low, high, value));
    if (std::isinf(expected)) {
      EXPECT_EQ(bound, expected);
    } else {
      EXPECT_NEAR(bound, expected, 1e-6 * expected);
    }
  }
}

// ---- the SIMD fit and a plain one ----

// fitCurvature once more, cell by cell and sample by sample as the definition has it: the same
// operations in the same order, so the same bits.
class PlainFit {
 public:
  // voxels[z][y][x]
  using Voxels = std::array<std::array<std::array<float, 3>, 3>, 3>;

  PlainFit(const CurvatureFitOptions& options, const Voxels& voxels, const ValueRange& range)
      : options_(options), voxels_(voxels), range_(range) {
    setScale();
  }

  std::array<float, 3> coefficients() {
    fit();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    const auto [least, greatest] = std::minmax_element(&voxels_[0][0][0], &voxels_[0][0][0] + 27);
    const bool finite = std::all_of(&voxels_[0][0][0], &voxels_[0][0][0] + 27,
                                    [](float v) { return std::isfinite(v); });
    if (!finite || !std::isfinite(range_.min)) return {kInfinity, kInfinity, kInfinity};
    if (*least == *greatest) return {0, 0, 0};
    if (scale_ == 0) return {kInfinity, kInfinity, kInfinity};
    const float factor = (width_ * width_) * ((1 + 1e-4f) / 2);
    const float reach = *greatest * scale_ - *least * scale_;
    const bool counts = reach * reach + (reach * reach + reach * reach) >= least_squared_;
    const float margin = counts && !options_.small_integers ? 0x1p-30f : 0.0f;
    return {b_[0] * factor + margin, b_[1] * factor + margin, b_[2] * factor + margin};
  }

 private:
  struct Jet {
    std::array<float, 3> first{};  // by axis
    std::array<float, 3> mixed{};  // of the two other axes
  };
  using Point = std::array<int, 3>;

  void setScale() {
    const float quarter = 0.25f * range_.max - 0.25f * range_.min;
    if (!(quarter >= 0x1p-122f && quarter <= std::numeric_limits<float>::max())) return;
    scale_ = std::ldexp(1.0f, std::max(-126, -3 - std::ilogb(quarter)));
    width_ = range_.max * scale_ - range_.min * scale_;
    const float threshold = static_cast<float>(options_.epsilon * (1 - 1e-6)) * width_;
    least_squared_ = std::max(threshold * threshold, 0x1p-36f);
  }

  float voxel(const Point& p) const {
    return voxels_[static_cast<std::size_t>(p[2])][static_cast<std::size_t>(p[1])]
                  [static_cast<std::size_t>(p[0])] *
           scale_;
  }
  // Difference along `axis` at the cell's corner `p`, in the cell `cell`.
  float difference(const Point& cell, Point p, std::size_t axis) const {
    p[axis] = cell[axis];
    Point q = p;
    ++q[axis];
    return voxel(q) - voxel(p);
  }
  Jet jetAtCorner(const Point& cell, const Point& p) const {
    Jet jet;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      jet.first[axis] = difference(cell, p, axis);
      // The difference along v of the differences along u.
      const std::size_t u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
      Point low = p, high = p;
      low[v] = cell[v];
      high[v] = cell[v] + 1;
      jet.mixed[axis] = difference(cell, high, u) - difference(cell, low, u);
    }
    return jet;
  }
  // The sum over all six faces.
  float slack(const Point& cell) const {
    float sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Point next = cell;
      ++next[axis];
      const float lower = jetAtCorner(cell, cell).mixed[axis];
      const float upper = jetAtCorner(cell, next).mixed[axis];
      sum = sum + (lower * lower + upper * upper);
    }
    return 4 * 0x1p-19f * sum;
  }
  static float twiceCurvature(const Jet& j, const std::array<std::size_t, 3>& axes, float slack,
                              float least) {
    const float fa = j.first[axes[0]], fu = j.first[axes[1]], fv = j.first[axes[2]];
    const float fuv = j.mixed[axes[0]], fav = j.mixed[axes[1]], fau = j.mixed[axes[2]];
    const float g2 = fa * fa + (fu * fu + fv * fv);
    if (!(g2 >= least)) return 0;
    const float a = fa * fuv, b = fu * fav, c = fv * fau;
    const float mean = (fu * fv) * fuv + fa * (fu * fau + fv * fav);
    const float e = (a + b) - c;
    const float s = e * e - 4 * (a * b);
    return ((mean + mean) * mean + g2 * (s + g2 * slack)) / ((g2 * g2) * g2);
  }

  // The greatest curvature of all samples at a place, by its coordinates in half cells.
  using Places = std::array<std::array<std::array<float, 5>, 5>, 5>;
  static float& placeOf(Places& places, const Point& at) {
    return places[static_cast<std::size_t>(at[2])][static_cast<std::size_t>(at[1])]
                 [static_cast<std::size_t>(at[0])];
  }

  void addCell(const Point& cell, Places& places) const {
    const float cell_slack = slack(cell);
    for (const auto& point : kCellSamplePoints) {
      Point low, high, place;  // the ends of the sample's edge, or twice the sample
      std::size_t along = 3;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        place[axis] = 2 * cell[axis] + point[axis];
        low[axis] = place[axis] / 2;
        high[axis] = (place[axis] + 1) / 2;
        if (point[axis] == 1) along = axis;
      }
      Jet jet = jetAtCorner(cell, low);
      float least = least_squared_;
      std::array<std::size_t, 3> axes = {0, 1, 2};
      if (along < 3) {  // twice the jet at the midpoint
        const Jet other = jetAtCorner(cell, high);
        for (std::size_t i = 0; i < 3; ++i) {
          jet.first[i] = jet.first[i] + other.first[i];
          jet.mixed[i] = jet.mixed[i] + other.mixed[i];
        }
        least = 4 * least;
        axes = {along, along == 0 ? 1u : 0u, along == 2 ? 1u : 2u};
      }
      float& k = placeOf(places, place);
      k = std::max(k, twiceCurvature(jet, axes, cell_slack, least));
    }
  }

  void raise(float t, float u, float k) {
    const std::array<float, 3> basis = {u * u, (t + t) * u, t * t};
    const float norm = (basis[0] * basis[0] + basis[1] * basis[1]) + basis[2] * basis[2];
    const float p = (b_[0] * basis[0] + b_[1] * basis[1]) + b_[2] * basis[2];
    const float step = std::max(k - p, 0.0f) * (1 / norm);
    for (std::size_t i = 0; i < 3; ++i) b_[i] = b_[i] + step * basis[i];
  }
  float above(const Point& p) const { return voxel(p) - range_.min * scale_; }
  float below(const Point& p) const { return range_.max * scale_ - voxel(p); }

  // Inner or outer coordinates, in turn for the axes that follow; bit i of `kind` is for `axes[i]`.
  static bool isOfKind(const Point& p, std::initializer_list<std::size_t> axes, int kind) {
    for (const std::size_t axis : axes) {
      if ((p[axis] == 1) != ((kind & 1) == 1)) return false;
      kind >>= 1;
    }
    return true;
  }
  static void forAllVoxels(const std::function<void(const Point&)>& f) {
    for (int z = 0; z < 3; ++z)
      for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 3; ++x) f({x, y, z});
  }

  // The order of the updates is a choice; this is that of fitCurvature.
  void fit() {
    if (scale_ == 0) return;
    Places places{};
    for (int cell = 0; cell < 8; ++cell) addCell({cell & 1, cell >> 1 & 1, cell >> 2}, places);
    for (int kind = 0; kind < 8; ++kind)
      forAllVoxels([&](const Point& p) {
        if (isOfKind(p, {0, 1, 2}, kind))
          raise(above(p), below(p), placeOf(places, {2 * p[0], 2 * p[1], 2 * p[2]}));
      });
    for (std::size_t a = 0; a < 3; ++a) {
      const std::size_t u = a == 0 ? 1 : 0, v = a == 2 ? 1 : 2;
      for (int kind = 0; kind < 4; ++kind)
        for (int at_v = 0; at_v < 3; ++at_v)
          for (int at_u = 0; at_u < 3; ++at_u)
            for (int at_a = 0; at_a < 2; ++at_a) {
              Point p, q, place;
              p[a] = at_a, p[u] = at_u, p[v] = at_v;
              if (!isOfKind(p, {u, v}, kind)) continue;
              q = p;
              ++q[a];
              for (std::size_t i = 0; i < 3; ++i) place[i] = p[i] + q[i];
              raise(above(p) + above(q), below(p) + below(q), 4 * placeOf(places, place));
            }
    }
  }

  CurvatureFitOptions options_;
  Voxels voxels_;
  ValueRange range_;
  float scale_ = 0, width_ = 0, least_squared_ = 0;
  std::array<float, 3> b_{};  // twice the coefficients over width_^2
};

// Values that reach all ends of float and all kinds of nodes.
float wildValue(Random& random, int kind) {
  switch (kind) {
    case 0:
      return static_cast<float>(randomReal(random, -1, 1));
    case 1:
      return static_cast<float>(randomInt(random, 0, 2));
    case 2:
      return static_cast<float>(randomReal(random, -1, 1)) * std::numeric_limits<float>::max();
    case 3:
      return static_cast<float>(randomReal(random, -1, 1)) * 0x1p-115f;
    case 4:
      return static_cast<float>(randomReal(random, -1, 1)) * 0x1p-121f;
    case 5:
      return 1000 + static_cast<float>(randomInt(random, 0, 3)) * 0x1p-14f;
    case 6:
      return static_cast<float>(randomInt(random, 0, 65535));
    case 7:
      return 5;
    default:
      return std::ldexp(static_cast<float>(randomReal(random, -1, 1)),
                        static_cast<int>(randomInt(random, -140, 127)));
  }
}

PlainFit::Voxels voxelsOfNode(const CurvatureRow& row, std::size_t node) {
  PlainFit::Voxels voxels;
  for (std::size_t z = 0; z < 3; ++z)
    for (std::size_t y = 0; y < 3; ++y)
      for (std::size_t x = 0; x < 3; ++x) voxels[z][y][x] = row.voxels[3 * z + y][2 * node + x];
  return voxels;
}

void fillWithWildNodes(Random& random, CurvatureRow& row) {
  for (std::vector<float>& line : row.voxels)
    for (float& voxel : line) voxel = 0;
  const auto kind_of_row = static_cast<int>(random() % 12);
  for (std::size_t node = 0; node < static_cast<std::size_t>(row.nodes); ++node) {
    const int kind = kind_of_row < 9 ? kind_of_row : static_cast<int>(random() % 9);
    for (std::vector<float>& line : row.voxels)
      for (std::size_t x = node == 0 ? 0 : 1; x < 3; ++x)
        line[2 * node + x] = wildValue(random, kind);
  }
  for (std::size_t node = 0; node < static_cast<std::size_t>(row.nodes); ++node) {
    ValueRange range;
    for (const auto& slice : voxelsOfNode(row, node))
      for (const auto& line : slice)
        for (const float voxel : line) range.include(voxel);
    if (random() % 2 == 0) range.include(wildValue(random, static_cast<int>(random() % 9)));
    row.low[node] = range.min;
    row.high[node] = range.max;
  }
}

TEST(CurvatureFit, HasTheBitsOfThePlainOneOnEveryTarget) {
  Random random(10);
  int targets = 0;
  std::int64_t nodes = 0, raised = 0, unbounded = 0;
  for (int round = 0; round < 300; ++round) {
    CurvatureRow row(randomInt(random, 1, 37));
    const CurvatureFitOptions options = {std::exp2(-randomReal(random, 0, 16)), round % 2 == 0};
    fillWithWildNodes(random, row);
    std::vector<std::array<float, 3>> expected;
    for (std::size_t node = 0; node < static_cast<std::size_t>(row.nodes); ++node) {
      PlainFit plain(options, voxelsOfNode(row, node), {row.low[node], row.high[node]});
      expected.push_back(plain.coefficients());
      ++nodes;
      raised += expected.back()[0] > 0 && std::isfinite(expected.back()[0]);
      unbounded += std::isinf(expected.back()[0]);
    }
    targets = 0;
    onEveryTarget([&] {
      ++targets;
      fitCurvature(options, row);
      for (std::size_t node = 0; node < expected.size(); ++node)
        for (std::size_t j = 0; j < 3; ++j)
          ASSERT_EQ(std::bit_cast<std::uint32_t>(row.coefficients[j][node]),
                    std::bit_cast<std::uint32_t>(expected[node][j]))
              << "round " << round << ", node " << node << ", b" << j << ": "
              << row.coefficients[j][node] << " instead of " << expected[node][j];
    });
  }
  std::printf("  %d targets, %lld nodes, %lld with coefficients, %lld without a bound\n", targets,
              static_cast<long long>(nodes), static_cast<long long>(raised),
              static_cast<long long>(unbounded));
  EXPECT_GE(targets, 1);
  EXPECT_GT(raised, nodes / 2);
  EXPECT_GT(unbounded, 0);
}

TEST(CurvatureFit, WhatIsNotFiniteHasNoBound) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  onEveryTarget([&] {
    for (const float bad : {kNan, kInfinity, -kInfinity})
      for (std::size_t voxel = 0; voxel < 27; ++voxel) {
        CurvatureRow row(3);
        Random random(voxel);
        for (std::vector<float>& line : row.voxels)
          for (std::size_t x = 0; x < 7; ++x)
            line[x] = static_cast<float>(randomReal(random, 0, 9));
        std::fill_n(row.high.begin(), 3, 9.0f);
        row.voxels[voxel / 3][2 + voxel % 3] = bad;
        fitCurvature({}, row);
        for (std::size_t j = 0; j < 3; ++j)
          EXPECT_EQ(row.coefficients[j][1], kInfinity) << "voxel " << voxel;
        EXPECT_EQ(std::isfinite(row.coefficients[0][0]), voxel % 3 != 0);
        EXPECT_EQ(std::isfinite(row.coefficients[0][2]), voxel % 3 != 2);
      }
    // Ranges.
    CurvatureRow row(3);
    for (std::vector<float>& line : row.voxels) line[1] = line[3] = line[5] = 1;
    row.high = {kNan, kInfinity, 0x1p-121f};
    row.low.resize(row.high.size());
    row.high.resize(16);
    row.low.resize(16);
    fitCurvature({}, row);
    for (std::size_t node = 0; node < 3; ++node)
      for (std::size_t j = 0; j < 3; ++j)
        EXPECT_EQ(row.coefficients[j][node], kInfinity) << "range " << node;
  });
}

template <typename T>
std::vector<ValueRange> tileRanges(const BrickLayout& layout, const Index3& brick,
                                   const SampleBlock<T>& samples) {
  const IndexBox cells = layout.brickCellBox(0, brick);
  const Index3 tiles = layout.brickTiles(0, brick);
  std::vector<ValueRange> ranges(static_cast<std::size_t>(elementCount(tiles)));
  Index3 at;
  for (at.z = cells.first.z; at.z <= cells.end().z; ++at.z)
    for (at.y = cells.first.y; at.y <= cells.end().y; ++at.y)
      for (at.x = cells.first.x; at.x <= cells.end().x; ++at.x)
        for (int corner = 0; corner < 8; ++corner) {  // of cells that touch it
          const Index3 cell = at - Index3(corner & 1, corner >> 1 & 1, corner >> 2) - cells.first;
          if (cell.x < 0 || cell.y < 0 || cell.z < 0) continue;
          const Index3 tile = cell / layout.tileCells();
          if (tile.x >= tiles.x || tile.y >= tiles.y || tile.z >= tiles.z) continue;
          ranges[static_cast<std::size_t>(linearIndex(tile, tiles))].include(
              static_cast<float>(samples.at(at)));
        }
  return ranges;
}

template <typename T>
std::vector<std::uint8_t> plainBrickCurvature(const BrickLayout& layout, const Index3& brick,
                                              const SampleBlock<T>& samples,
                                              const std::vector<ValueRange>& tiles) {
  const Index3 nodes = layout.brickNodes(brick), first = layout.brickCellBox(0, brick).first;
  const CurvatureFitOptions options = {1.0 / 64, std::is_integral_v<T>};
  std::vector<std::uint8_t> codes;
  Index3 n;
  for (n.z = 0; n.z < nodes.z; ++n.z)
    for (n.y = 0; n.y < nodes.y; ++n.y)
      for (n.x = 0; n.x < nodes.x; ++n.x) {
        PlainFit::Voxels voxels;
        for (std::size_t i = 0; i < 27; ++i) {
          const Index3 at(i % 3, i / 3 % 3, i / 9);
          voxels[i / 9][i / 3 % 3][i % 3] = static_cast<float>(samples.at(
              glm::min(first + std::int64_t{2} * n + at, samples.box.end() - Index3(1))));
        }
        const std::int64_t tile =
            linearIndex(std::int64_t{2} * n / layout.tileCells(), layout.brickTiles(0, brick));
        for (const float b :
             PlainFit(options, voxels, tiles[static_cast<std::size_t>(tile)]).coefficients())
          codes.push_back(CurvatureCode::encodeUp(static_cast<double>(b)));
      }
  return codes;
}

// A volume of random values with plateaus, in a buffer that is larger.
template <typename T>
void checkBricks(Random& random) {
  const Index3 dims(randomInt(random, 2, 40), randomInt(random, 2, 15), randomInt(random, 2, 15));
  const std::int64_t tile_cells = std::int64_t{2} << random() % 3;
  const BrickLayout layout(Lattice(dims), tile_cells << random() % 2, tile_cells);
  SampleBlock<T> samples;
  samples.box = {Index3(0), dims};
  samples.row_stride = dims.x + randomInt(random, 0, 9);
  samples.slice_stride = samples.row_stride * dims.y + randomInt(random, 0, 9);
  std::vector<T> values(static_cast<std::size_t>(samples.slice_stride * dims.z));
  const bool is_float = std::is_floating_point_v<T>;
  const double low = is_float ? -1 : static_cast<double>(std::numeric_limits<T>::min());
  const double high = is_float ? 1 : static_cast<double>(std::numeric_limits<T>::max());
  const std::uint64_t plateau = 1 + randomBelow(random, 40);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = random() % plateau == 0 || i == 0 ? static_cast<T>(randomReal(random, low, high))
                                                  : values[i - 1];
  samples.data = values.data();
  const Index3 bricks = layout.bricks(0);
  std::vector<std::uint8_t> codes = {1, 2, 3};  // what was there does not matter
  for (std::int64_t i = 0; i < elementCount(bricks); ++i) {
    const Index3 brick(i % bricks.x, i / bricks.x % bricks.y, i / (bricks.x * bricks.y));
    const std::vector<ValueRange> tiles = tileRanges(layout, brick, samples);
    const std::vector<std::uint8_t> expected = plainBrickCurvature(layout, brick, samples, tiles);
    onEveryTarget([&] {
      brickCurvature(layout, brick, samples, tiles, 1.0 / 64, codes);
      ASSERT_EQ(codes.size(), expected.size());
      for (std::size_t j = 0; j < codes.size(); ++j)
        ASSERT_EQ(codes[j], expected[j])
            << "code " << j << " of brick " << i << " of " << dims.x << "x" << dims.y << "x"
            << dims.z << " voxels, tiles of " << tile_cells;
    });
  }
}

TEST(CurvatureBricks, AreThePlainFitOfEveryNode) {
  Random random(11);
  for (int round = 0; round < 12 && !HasFatalFailure(); ++round) {
    checkBricks<std::uint8_t>(random);
    checkBricks<std::int8_t>(random);
    checkBricks<std::uint16_t>(random);
    checkBricks<std::int16_t>(random);
    checkBricks<float>(random);
  }
}

// ---- stored bounds ----

TEST(CurvatureBound, SamplePointsAreTheCornersAndTheEdgesMidpoints) {
  std::vector<std::array<std::uint8_t, 3>> expected;
  for (std::uint8_t z = 0; z < 3; ++z)
    for (std::uint8_t y = 0; y < 3; ++y)
      for (std::uint8_t x = 0; x < 3; ++x)
        if ((x == 1) + (y == 1) + (z == 1) <= 1) expected.push_back({x, y, z});
  std::vector<std::array<std::uint8_t, 3>> points(kCellSamplePoints.begin(),
                                                  kCellSamplePoints.end());
  std::sort(points.begin(), points.end());
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(points, expected);
  EXPECT_EQ(points.size(), 20u);
}

struct BoundCount {
  std::int64_t samples = 0, counted = 0, exceptions = 0;
};

BoundCount countExceptions(const BoundedVolume& volume, const std::string& name) {
  const std::vector<glm::dvec3> points = fittedPoints();
  BoundCount count;
  forAllNodes(volume, [&](const NodeBound& node) {
    forAllCells(node, [&](const PlainIndex& cell) {
      count.samples += static_cast<std::int64_t>(points.size());
      forCountedSamples(volume, node, cell, points, [&](const CurvatureSample& sample) {
        ++count.counted;
        const double bound = plainCurvatureBound(node.codes, node.tile_range, sample.value);
        if (bound >= sample.curvature) return;
        if (++count.exceptions <= 3)
          ADD_FAILURE() << name << ": p(" << sample.value << ") = " << bound << " < "
                        << sample.curvature << " in cell (" << cell[0] << "," << cell[1] << ","
                        << cell[2] << "), tile range " << node.tile_range.min << " .. "
                        << node.tile_range.max;
      });
    });
  });
  return count;
}

TEST(CurvatureBound, StoredPolynomialsBoundAllFittedSamples) {
  const TemporaryFolder folder;
  struct Case {
    const char* name;
    Index3 dims;
    VoxelType type;
    Field field;
    std::int64_t brick_cells, tile_cells;
  };
  const Case cases[] = {
      {"noise uint8", Index3(40), VoxelType::kUint8, whiteNoise(0, 256), 16, 4},
      {"noise uint16, thin ends", Index3(36, 35, 34), VoxelType::kUint16, whiteNoise(0, 65536), 16,
       4},
      {"noise int8, tiles of 2", Index3(20, 23, 22), VoxelType::kInt8, whiteNoise(-128, 128), 8, 2},
      {"noise of 3 values", Index3(33), VoxelType::kInt16, whiteNoise(-1.99, 1.99), 8, 8},
      {"waves uint16", Index3(50, 49, 48), VoxelType::kUint16, smoothWaves(30000, 32000), 64, 4},
      {"waves float32", Index3(41, 40, 37), VoxelType::kFloat32, smoothWaves(1, 0), 16, 4},
      {"waves far from 0", Index3(33, 34, 35), VoxelType::kFloat32, smoothWaves(1, 1000), 16, 8},
      {"head uint16", Index3(52), VoxelType::kUint16, headLike(52), 16, 4},
      {"head float32", Index3(35, 34, 33), VoxelType::kFloat32, headLike(34), 32, 16},
  };
  std::int64_t counted = 0;
  for (const Case& c : cases) {
    const BoundCount count = countExceptions(
        makeBoundedVolume(folder, c.dims, c.type, c.field, c.brick_cells, c.tile_cells), c.name);
    EXPECT_EQ(count.exceptions, 0) << c.name << ": of " << count.counted << " samples";
    EXPECT_GT(count.counted, count.samples / 10) << c.name;
    counted += count.counted;
  }
  std::printf("  %lld samples counted\n", static_cast<long long>(counted));
  EXPECT_GE(counted, 1000000);
}

// Curvature does not depend on the unit of the values, so neither may the bound: float volumes
// range from densities of 1e-27 to temperatures of 1e8 and beyond.
TEST(CurvatureBound, DoesNotDependOnTheUnitOfTheValues) {
  const TemporaryFolder folder;
  const Index3 dims(21, 18, 19);
  std::vector<std::uint8_t> codes_of_one;
  for (const double unit :
       {1.0, 0x1p-20, 0x1p-40, 0x1p-60, 0x1p-100, 0x1p20, 0x1p40, 0x1p60, 0x1p100}) {
    const Field noise = whiteNoise(-1, 1);
    const BoundedVolume volume =
        makeBoundedVolume(folder, dims, VoxelType::kFloat32, [&](const glm::dvec3& p) {
          return unit * static_cast<double>(static_cast<float>(noise(p)));
        });
    std::vector<std::uint8_t> codes;
    for (const PlainBrick& brick : volume.pyramid.bricks)
      codes.insert(codes.end(), brick.codes.begin(), brick.codes.end());
    if (codes_of_one.empty()) codes_of_one = codes;
    EXPECT_TRUE(codes == codes_of_one) << "unit 2^" << std::log2(unit) << " gives other codes";
    const BoundCount count = countExceptions(volume, "unit");
    EXPECT_EQ(count.exceptions, 0)
        << "unit 2^" << std::log2(unit) << ": of " << count.counted << " samples";
  }
}

TEST(CurvatureBound, FlatFieldsHaveNoCurvature) {
  const TemporaryFolder folder;
  const BoundedVolume volume =
      makeBoundedVolume(folder, Index3(17, 18, 19), VoxelType::kUint16,
                        [](const glm::dvec3& p) { return 100 + 3 * p.x + 5 * p.y + 7 * p.z; });
  for (const PlainBrick& brick : volume.pyramid.bricks)
    for (const std::uint8_t code : brick.codes) ASSERT_EQ(code, 0);
}

// The figures of docs/ALGORITHM.md on smaller volumes (curvature_tightness prints those). The bound
// is an estimate where the fit saw no sample, but one to rely on: most of them are below.
TEST(CurvatureBound, HoldsOverTheCellsOwnRangeAndForMostUnseenSamples) {
  const TemporaryFolder folder;
  for (const TightnessCase& c : tightnessCases(18)) {
    const BoundedVolume volume = makeBoundedVolume(folder, Index3(18), c.type, c.field);
    const Tightness tightness = measureTightness(volume);
    EXPECT_EQ(tightness.below, 0) << c.name;
    EXPECT_GT(tightness.samples, 10000) << c.name;
    for (const bool on_edges : {true, false}) {
      const UnseenSamples unseen = measureUnseen(volume, on_edges);
      EXPECT_GT(unseen.samples, 3000) << c.name;
      EXPECT_LT(unseen.above * 100, unseen.samples * 4) << c.name << (on_edges ? " edges" : "");
    }
  }
}

}  // namespace
}  // namespace isobrick::test
