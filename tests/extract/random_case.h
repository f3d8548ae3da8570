// Random small volumes and random ways to say how fine their surface shall be.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/requirement.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {

class RandomCase {
 public:
  explicit RandomCase(std::uint32_t seed) : random_(seed) {}

  int uniform(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  bool chance(double p) { return real(0, 1) < p; }

  Index3 dims() {
    // Mostly small, so that borders and thin cells are everywhere; now and then up to 70.
    const int most = chance(0.1) ? 70 : chance(0.4) ? 34 : 14;
    Index3 d(uniform(2, most), uniform(2, most), uniform(2, most));
    while (elementCount(d) > 40000) d[uniform(0, 2)] = uniform(2, 20);
    return d;
  }

  // More cells along x than a word has bits, and few along y and z.
  Index3 wideDims() {
    // At and beside the ends of words and bricks.
    constexpr int kEnds[] = {64, 128, 192, 256};
    const int x = chance(0.4) ? kEnds[uniform(0, 3)] + uniform(1, 3) : uniform(66, 310);
    Index3 d(x, uniform(2, 14), uniform(2, 14));
    while (elementCount(d) > 40000) d[uniform(1, 2)] = uniform(2, 9);
    return d;
  }

  // Noise, plateaus, smooth bumps with or without noise, or nearly linear.
  template <typename T>
  std::vector<T> field(const Index3& dims) {
    const int kind = uniform(0, 4);
    const double low = std::is_signed_v<T> && !std::is_floating_point_v<T> ? -100.0 : 0.0;
    const glm::dvec3 wave(real(0.1, 0.9), real(0.1, 0.9), real(0.1, 0.9));
    const double phase = real(0, 6), noise = chance(0.5) ? real(0, 20) : 0.0;
    const int steps = uniform(2, 5);
    std::vector<T> values;
    for (std::int64_t z = 0; z < dims.z; ++z)
      for (std::int64_t y = 0; y < dims.y; ++y)
        for (std::int64_t x = 0; x < dims.x; ++x) {
          const double smooth = 0.5 + (std::sin(wave.x * static_cast<double>(x) + phase) +
                                       std::sin(wave.y * static_cast<double>(y)) +
                                       std::sin(wave.z * static_cast<double>(z) - phase)) /
                                          6;
          double v = 0;
          switch (kind) {
            case 0:
              v = real(0, 200);
              break;
            case 1:
              v = 50 * uniform(0, steps - 1);
              break;
            case 2:
              v = 200 * smooth + real(-noise, noise);
              break;
            case 3:
              v = std::floor(smooth * steps) * 40;
              break;
            default:
              v = 2 * wave.x * static_cast<double>(x) + wave.y * static_cast<double>(y) +
                  wave.z * static_cast<double>(z) + real(-noise, noise) * 0.1;
          }
          v = std::clamp(low + v, low, low + 200);
          values.push_back(static_cast<T>(std::is_floating_point_v<T> ? v : std::round(v)));
        }
    return values;
  }

 private:
  std::mt19937 random_;
};

// Builds "case.isb" in the folder, of a random field in bricks of 8 to 8 * 2^most_doublings cells;
// returns its path.
inline std::string buildRandomPyramid(RandomCase& random, const TemporaryFolder& folder,
                                      int most_doublings) {
  const Index3 dims = random.dims();
  BuildOptions options;
  options.brick_cells = std::int64_t{8} << random.uniform(0, most_doublings);
  ArraySource<float> source(dims, random.field<float>(dims));
  const std::string path = folder.file("case.isb");
  buildPyramid(source, path, options);
  return path;
}

// `focused`: the part of the choices without a view that have a focus.
inline DetailChoice randomChoice(RandomCase& random, const Pyramid& pyramid, double focused) {
  const Index3& dims = pyramid.spec().voxels;
  const auto reach = static_cast<double>(std::max({dims.x, dims.y, dims.z}));
  const auto anywhere = [&] {
    glm::dvec3 point;
    for (int axis = 0; axis < 3; ++axis)
      point[axis] = random.chance(0.8) ? random.real(0, static_cast<double>(dims[axis] - 1))
                                       : random.real(-reach, 2 * reach);
    return random.chance(0.3) ? glm::round(point) : point;
  };
  DetailChoice choice;
  if (random.chance(0.25)) {
    ViewPoint& view = choice.view.emplace();
    view.eye = anywhere();
    view.pixels = random.real(0.5, 4);
    if (random.chance(0.15))
      view.pixels_per_unit = view.pixels * std::exp2(-random.real(-1, 4));
    else
      view.pixels_per_radian = random.real(1, 40);
    if (random.chance(0.6)) {
      view.field = ViewPoint::Field{};
      view.field->direction = anywhere() - view.eye + glm::dvec3(0.01);
      view.field->half_angle = random.real(0.05, 1.5);
      view.field->radius = random.real(0.5, reach);
    }
  }
  if (random.chance(choice.view ? 0.3 : focused)) {
    choice.focus = FocusSphere{anywhere(), 0};
    if (!random.chance(0.25))
      choice.focus->radius = random.real(0, random.chance(0.2) ? 2 * reach : reach / 3);
  } else if (random.chance(0.5)) {
    choice.uniform_level = random.uniform(0, pyramid.lattice().levels() - 1);
  }
  if (choice.uniform_level.value_or(0) == 0 && random.chance(0.6))
    choice.curvature_tolerance = random.chance(0.15) ? 0.0 : std::exp(random.real(-9, 5));
  return choice;
}

// With an isovalue that random fields have.
inline Query randomQuery(RandomCase& random, const Pyramid& pyramid) {
  Query query;
  static_cast<DetailChoice&>(query) = randomChoice(random, pyramid, 0.6);
  query.isovalue = random.real(20, 180);
  return query;
}

}  // namespace isobrick::test
