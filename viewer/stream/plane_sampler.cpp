#include "isobrick/viewer/stream/plane_sampler.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>

namespace isobrick {
namespace {

// Reads samples of one level anywhere, and keeps the brick that was used last.
class LevelReader {
 public:
  LevelReader(const Pyramid& pyramid, int level)
      : pyramid_(pyramid), level_(level), cells_(pyramid.lattice().cells(level)) {}

  // At a voxel index; NaN outside of the volume.
  float at(const glm::dvec3& index) {
    const glm::dvec3 last(pyramid_.lattice().voxels() - Index3(1));
    constexpr double kRim = 1e-6;  // of rounding, in voxels
    if (!(glm::all(glm::greaterThanEqual(index, glm::dvec3(-kRim))) &&
          glm::all(glm::lessThanEqual(index, last + kRim))))
      return std::numeric_limits<float>::quiet_NaN();
    Index3 cell;
    glm::dvec3 share;
    for (int axis = 0; axis < 3; ++axis) {
      const double x = std::clamp(index[axis], 0.0, last[axis]);
      cell[axis] = std::min(static_cast<std::int64_t>(x) >> level_, cells_[axis] - 1);
      const auto low = static_cast<double>(pyramid_.lattice().position(level_, axis, cell[axis]));
      const auto high =
          static_cast<double>(pyramid_.lattice().position(level_, axis, cell[axis] + 1));
      share[axis] = (x - low) / (high - low);
    }
    takeBrickOf(cell);
    const Index3 first = cell - samples_.box.first;
    return visitVoxelType(pyramid_.spec().voxel_type, [&](auto tag) {
      const auto* const values = samples_.data<typename decltype(tag)::Type>();
      return static_cast<float>(trilinear(values, samples_.box.count, first, share));
    });
  }
  // Throws Error if bytes of a brick could not be read while they were used.
  void check() const {
    if (brick_.x >= 0) pyramid_.throwIfReadsFailed(level_, brick_);
  }

 private:
  void takeBrickOf(const Index3& cell) {
    const Index3 brick = cell / pyramid_.layout().brickCells();
    if (brick == brick_) return;
    check();
    samples_ = pyramid_.samples(level_, brick);
    brick_ = brick;
  }

  const Pyramid& pyramid_;
  int level_;
  Index3 cells_;
  Index3 brick_{-1};
  BrickSamples samples_;
};

// A value and its neighbours at the four sides, in steps of a pixel; at a border the value itself.
struct Neighbourhood {
  float middle, left, right, above, below;
};

// How much of the pixel lines of `width` pixels, and of 2 more, along `isovalue` cover. The
// distance to the line is that of a plane through the neighbours, which is right to a part of a
// pixel near the line.
struct Coverage {
  float line = 0.0f, rim = 0.0f;
};
Coverage coverage(const Neighbourhood& at, float isovalue, float width) {
  const float reach = 0.5f * width + 1.5f;
  const float to_line = at.middle - isovalue;
  const float left = at.middle - at.left, right = at.right - at.middle;
  const float above = at.middle - at.above, below = at.below - at.middle;
  float across = std::max(std::abs(left), std::abs(right));
  float along = std::max(std::abs(above), std::abs(below));
  if (!(to_line * to_line < reach * reach * (across * across + along * along))) return {};
  // Beside a crossing these count, the greater of both sides, so that a step of a single pixel gets
  // a line as thin as any. Further away the mean of both: a valley that stays above has no line.
  const bool is_above = to_line >= 0.0f;
  const bool crosses = (at.left >= isovalue) != is_above || (at.right >= isovalue) != is_above ||
                       (at.above >= isovalue) != is_above || (at.below >= isovalue) != is_above;
  if (!crosses) {
    across = 0.5f * (left + right);
    along = 0.5f * (above + below);
  }
  const float steepness = std::sqrt(across * across + along * along);
  if (!(steepness > 0.0f)) return {};
  const float distance = std::abs(to_line) / steepness;
  return {std::clamp(reach - 1.0f - distance, 0.0f, 1.0f),
          std::clamp(reach - distance, 0.0f, 1.0f)};
}

}  // namespace

PlaneSampling samplingOf(const Lattice& lattice, const IndexPlane& plane, int most) {
  const double across = glm::length(plane.across), along = glm::length(plane.along);
  PlaneSampling sampling;
  const auto longest = [&] { return std::ldexp(std::max(across, along), -sampling.level); };
  while (longest() + 1.0 > most && sampling.level + 1 < lattice.levels()) ++sampling.level;
  const auto values = [&](double length) {
    return std::clamp(static_cast<int>(std::lround(std::ldexp(length, -sampling.level))) + 1, 2,
                      most);
  };
  sampling.width = values(across);
  sampling.height = values(along);
  return sampling;
}

SliceImage samplePlane(const Pyramid& pyramid, const IndexPlane& plane,
                       const PlaneSampling& sampling, const CancelFlag& cancel) {
  SliceImage image{sampling.width, sampling.height, {}, pyramid.spec().values};
  image.values.resize(static_cast<std::size_t>(sampling.width) *
                      static_cast<std::size_t>(sampling.height));
  LevelReader reader(pyramid, sampling.level);
  // In squares, so that a brick is taken once for each of them and not for every row.
  constexpr int kSquare = 64;
  for (int top = 0; top < sampling.height; top += kSquare) {
    for (int left = 0; left < sampling.width; left += kSquare) {
      cancel.check();
      for (int y = top; y < std::min(top + kSquare, sampling.height); ++y) {
        for (int x = left; x < std::min(left + kSquare, sampling.width); ++x) {
          const glm::dvec3 index = plane.corner + plane.across * (x / (sampling.width - 1.0)) +
                                   plane.along * (y / (sampling.height - 1.0));
          image.values[static_cast<std::size_t>(y) * static_cast<std::size_t>(sampling.width) +
                       static_cast<std::size_t>(x)] = reader.at(index);
        }
      }
    }
  }
  reader.check();
  return image;
}

IndexPlane slicePlane(const Index3& voxels, int axis, double position) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  IndexPlane plane;
  plane.corner[axis] = position;
  plane.across[u] = static_cast<double>(voxels[u] - 1);
  plane.along[v] = static_cast<double>(voxels[v] - 1);
  return plane;
}

std::optional<IndexPlane> capPlane(const Index3& voxels, const GridGeometry& geometry,
                                   const glm::dvec3& normal, double offset) {
  // In the world: the plane's own axes, and how far the box reaches along them.
  const glm::dvec3 helper =
      std::abs(normal.z) < 0.9 ? glm::dvec3(0.0, 0.0, 1.0) : glm::dvec3(0.0, 1.0, 0.0);
  const glm::dvec3 u = glm::normalize(glm::cross(helper, normal));
  const glm::dvec3 v = glm::cross(normal, u);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  glm::dvec3 lower(kInfinity), upper(-kInfinity);
  for (const glm::dvec3& corner : worldCorners(geometry, voxels)) {
    const glm::dvec3 place(glm::dot(corner, u), glm::dot(corner, v), glm::dot(corner, normal));
    lower = glm::min(lower, place);
    upper = glm::max(upper, place);
  }
  if (!(offset >= lower.z && offset <= upper.z)) return std::nullopt;
  const glm::dvec3 corner = u * lower.x + v * lower.y + normal * offset;
  const glm::dmat3 to_index = glm::inverse(geometry.indexToWorldMatrix());
  return IndexPlane{to_index * (corner - geometry.origin), to_index * (u * (upper.x - lower.x)),
                    to_index * (v * (upper.y - lower.y))};
}

PictureBytes drawSlice(const SliceImage& values, const std::array<double, 2>& window,
                       std::span<const SliceContour> contours, double width) {
  PictureBytes picture{values.width, values.height};
  picture.rgba.resize(4 * values.values.size());
  constexpr float kNothing = 0.07f;
  const float black = static_cast<float>(values.transform.stored(window[0]));
  const float span =
      std::max(static_cast<float>((window[1] - window[0]) / values.transform.scale), 1e-30f);
  const auto at = [&](int x, int y) {
    return values.values[static_cast<std::size_t>(y) * static_cast<std::size_t>(values.width) +
                         static_cast<std::size_t>(x)];
  };
  for (int y = 0; y < values.height; ++y) {
    for (int x = 0; x < values.width; ++x) {
      const float middle = at(x, y);
      const bool is_value = !std::isnan(middle);
      glm::vec3 color(is_value ? std::clamp((middle - black) / span, 0.0f, 1.0f) : kNothing);
      if (is_value && !contours.empty()) {
        const auto beside = [&](int dx, int dy) {
          const int nx = std::clamp(x + dx, 0, values.width - 1);
          const int ny = std::clamp(y + dy, 0, values.height - 1);
          const float value = at(nx, ny);
          return std::isnan(value) ? middle : value;
        };
        const Neighbourhood around{middle, beside(-1, 0), beside(1, 0), beside(0, -1),
                                   beside(0, 1)};
        for (const SliceContour& contour : contours) {
          // A dark edge, so that a line of any colour is seen on any grey.
          constexpr float kEdge = 0.6f;
          const Coverage cover =
              coverage(around, static_cast<float>(values.transform.stored(contour.isovalue)),
                       static_cast<float>(width));
          color *= 1.0f - kEdge * cover.rim;
          color += cover.line * (contour.color - color);
        }
      }
      std::uint8_t* const pixel = picture.rgba.data() + picture.offsetOf(x, y);
      for (glm::length_t c = 0; c < 3; ++c)
        pixel[c] = static_cast<std::uint8_t>(255.0f * std::clamp(color[c], 0.0f, 1.0f) + 0.5f);
      pixel[3] = 255;
    }
  }
  return picture;
}

}  // namespace isobrick
