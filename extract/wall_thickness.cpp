#include "isobrick/extract/wall_thickness.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/common.hpp>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "isobrick/storage/pyramid_parts.h"
#include "isobrick/storage/voxel_type.h"

namespace isobrick {
namespace {

// A cubic over 0 .. 1 by its Bernstein coefficients, between the least and the greatest of which
// its values are.
using Cubic = std::array<double, 4>;

// Its parts before and behind a place, each over 0 .. 1 again (de Casteljau).
std::array<Cubic, 2> splitAt(const Cubic& cubic, double t) {
  const auto between = [t](double a, double b) { return a + t * (b - a); };
  const double ab = between(cubic[0], cubic[1]), bc = between(cubic[1], cubic[2]),
               cd = between(cubic[2], cubic[3]);
  const double abc = between(ab, bc), bcd = between(bc, cd), middle = between(abc, bcd);
  return {Cubic{cubic[0], ab, abc, middle}, Cubic{middle, bcd, cd, cubic[3]}};
}

// The first place where the cubic is below 0, to 2^-kHalvings.
std::optional<double> firstBelowZero(const Cubic& cubic, int halvings = 0) {
  constexpr int kHalvings = 24;
  if (std::ranges::all_of(cubic, [](double value) { return value >= 0; })) return std::nullopt;
  if (cubic[0] < 0 || halvings == kHalvings) return 0.0;
  const auto [first, second] = splitAt(cubic, 0.5);
  if (const auto found = firstBelowZero(first, halvings + 1)) return *found / 2;
  if (const auto found = firstBelowZero(second, halvings + 1)) return (1 + *found) / 2;
  return std::nullopt;
}

// How far the values of a cell's corners are within the inside, x fastest.
using CornerHeights = std::array<double, 8>;

double heightAt(const CornerHeights& corners, double x, double y, double z) {
  const auto along = [&](std::size_t at) { return corners[at] * (1 - x) + corners[at + 1] * x; };
  const auto plane = [&](std::size_t at) { return along(at) * (1 - y) + along(at + 2) * y; };
  return plane(0) * (1 - z) + plane(4) * z;
}

// Between two points of the cell: the coefficients are means of values at points of which each
// coordinate is of one of the two (the blossom of a product of three linear functions), so that
// where no corner is below 0 none of them is.
Cubic alongSegment(const CornerHeights& corners, const glm::dvec3& p, const glm::dvec3& q) {
  const auto mean = [&](const glm::dvec3& most, const glm::dvec3& one) {
    return (heightAt(corners, one.x, most.y, most.z) + heightAt(corners, most.x, one.y, most.z) +
            heightAt(corners, most.x, most.y, one.z)) /
           3;
  };
  return {heightAt(corners, p.x, p.y, p.z), mean(p, q), mean(q, p),
          heightAt(corners, q.x, q.y, q.z)};
}

constexpr std::size_t kEnded = ~std::size_t{0};  // in place of a brick

struct Ray {
  std::size_t vertex = 0;
  glm::dvec3 start{0.0}, step{0.0};  // voxel indices, and these per world unit
  Index3 cell{0};
  std::size_t brick_row = 0;     // of the brick that has the cell
  double at = 0;                 // world units from the start
  std::optional<double> inside;  // where the ray came in, if it is in
};

// Goes on through cells of one brick.
class RayMarch {
 public:
  // Pieces of the inside that are shorter are roundings of a vertex's place: world units.
  RayMarch(const Index3& cells, double most, double least_length)
      : cells_(cells), most_(most), least_length_(least_length) {}

  // Goes through the ray's cell; the thickness if the ray ends. `heights`: of its corners.
  std::optional<double> cross(Ray& ray, const CornerHeights& heights) const {
    constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
    int axis = 0;
    double next = std::numeric_limits<double>::infinity();
    for (int a = 0; a < 3; ++a) {
      if (ray.step[a] == 0) continue;
      const auto side = static_cast<double>(ray.cell[a] + (ray.step[a] > 0 ? 1 : 0));
      if (const double leaves = (side - ray.start[a]) / ray.step[a]; leaves < next) {
        next = leaves;
        axis = a;
      }
    }
    next = std::max(next, ray.at);
    if (std::ranges::any_of(heights, [](double height) { return std::isnan(height); })) return kNaN;
    if (!(next < std::numeric_limits<double>::infinity())) return kNaN;  // no direction
    if (const auto end = endWithin(ray, heights, next)) return end;
    if (const double from = ray.inside.value_or(0); next - from >= most_)
      return ray.inside ? most_ : kNaN;
    ray.at = next;
    ray.cell[axis] += ray.step[axis] > 0 ? 1 : -1;
    if (ray.cell[axis] >= 0 && ray.cell[axis] < cells_[axis]) return std::nullopt;
    return ray.inside ? next - *ray.inside : kNaN;
  }

 private:
  std::optional<double> endWithin(Ray& ray, const CornerHeights& heights, double next) const {
    const glm::dvec3 corner(ray.cell);
    const auto place = [&](double at) {
      return glm::clamp(ray.start + at * ray.step - corner, 0.0, 1.0);
    };
    Cubic rest = alongSegment(heights, place(ray.at), place(next));
    double from = ray.at;
    const auto goTo = [&](double share) {
      from += share * (next - from);
      rest = splitAt(rest, share)[1];
    };
    constexpr int kMostPieces = 8;  // a cubic has two; the others are roundings
    for (int piece = 0; piece < kMostPieces; ++piece) {
      if (!ray.inside) {
        const Cubic below = {-rest[0], -rest[1], -rest[2], -rest[3]};
        const auto entry = rest[0] >= 0 ? 0.0 : firstBelowZero(below);
        if (!entry) return std::nullopt;
        goTo(*entry);
        rest[0] = std::max(rest[0], 0.0);  // whatever its rounding
        ray.inside = from;
      }
      const auto exit = firstBelowZero(rest);
      if (!exit) return std::nullopt;
      goTo(*exit);
      if (from - *ray.inside >= least_length_) return std::min(from - *ray.inside, most_);
      ray.inside.reset();
      rest[0] = std::min(rest[0], -std::numeric_limits<double>::min());
    }
    return std::nullopt;
  }

  const Index3 cells_;
  const double most_, least_length_;
};

}  // namespace

WallThickness::WallThickness(const Pyramid& pyramid, double isovalue, double most, InsideOf inside)
    : pyramid_(pyramid),
      inside_(inside),
      outermost_(inside == InsideOf::kAbove
                     ? pyramid.storedIsovalue(isovalue)
                     : std::nextafter(pyramid.storedIsovalue(isovalue),
                                      -std::numeric_limits<float>::infinity())),
      most_(most),
      world_to_index_(glm::inverse(pyramid.spec().geometry.indexToWorldMatrix())) {}

void WallThickness::evaluate(std::span<const glm::dvec3> world, std::span<const glm::vec3> normals,
                             std::span<double> values) const {
  const PyramidSpec& spec = pyramid_.spec();
  const Index3 cells = spec.voxels - Index3(1);
  const auto findBrick = [&](Ray& ray) {
    ray.brick_row = pyramid_.parts().brickRow(0, ray.cell / spec.brick_cells);
  };
  std::vector<Ray> rays;
  for (std::size_t i = 0; i < world.size(); ++i) {
    Ray ray;
    ray.vertex = i;
    ray.step = world_to_index_ * -glm::dvec3(normals[i]);
    ray.start = glm::clamp(world_to_index_ * (world[i] - spec.geometry.origin), glm::dvec3(0.0),
                           glm::dvec3(cells));
    ray.cell = glm::min(Index3(glm::floor(ray.start)), cells - Index3(1));
    findBrick(ray);
    rays.push_back(ray);
  }
  const double sign = inside_ == InsideOf::kAbove ? 1 : -1;
  const RayMarch march(cells, most_, 1e-3 * spec.geometry.leastSpacing());

  // In rounds, each brick by brick: all rays in a brick go on to where they leave it.
  while (!rays.empty()) {
    std::ranges::sort(rays, [](const Ray& a, const Ray& b) {
      return std::pair(a.brick_row, a.vertex) < std::pair(b.brick_row, b.vertex);
    });
    visitVoxelType(spec.voxel_type, [&](auto tag) {
      using T = typename decltype(tag)::Type;
      for (std::size_t begin = 0; begin < rays.size();) {
        const std::size_t row = rays[begin].brick_row;
        const Index3 brick = rays[begin].cell / spec.brick_cells;
        const BrickSamples samples = pyramid_.samples(0, brick);
        const T* const data = samples.template data<T>();
        const auto heightsOf = [&](const Index3& cell) {
          CornerHeights heights;
          for (std::size_t i = 0; i < 8; ++i) {
            const Index3 corner = cell + Index3(i & 1, i >> 1 & 1, i >> 2);
            const auto value = static_cast<double>(
                data[linearIndex(corner - samples.box.first, samples.box.count)]);
            heights[i] = sign * (value - static_cast<double>(outermost_));
          }
          return heights;
        };
        for (; begin < rays.size() && rays[begin].brick_row == row; ++begin) {
          Ray& ray = rays[begin];
          std::optional<double> end;
          while (!end && ray.cell / spec.brick_cells == brick)
            end = march.cross(ray, heightsOf(ray.cell));
          values[ray.vertex] = end.value_or(0);
          ray.brick_row = end ? kEnded : row;
        }
        pyramid_.throwIfReadsFailed(0, brick);
      }
    });
    std::erase_if(rays, [](const Ray& ray) { return ray.brick_row == kEnded; });
    std::ranges::for_each(rays, findBrick);
  }
}

}  // namespace isobrick
