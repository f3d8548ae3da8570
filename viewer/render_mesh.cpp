#include "isobrick/viewer/render_mesh.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <limits>
#include <numeric>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

constexpr std::size_t kMostTriangles = std::size_t{1} << 18;

// Cuts a mesh into chunks; holds a number for each of its vertices.
class MeshCutter {
 public:
  MeshCutter(const RenderMesh& mesh, const glm::dvec3& origin)
      : mesh_(mesh), origin_(origin), numbers_(mesh.positions.size(), kNone) {}

  void add(std::size_t triangle, SurfaceChunk& chunk) {
    const std::uint32_t* const corners = mesh_.triangles.data() + 3 * triangle;
    for (int k = 0; k < 3; ++k) {
      assert(corners[k] < mesh_.positions.size());
      chunk.triangles.push_back(mesh_.normals.empty() ? addCorner(corners[k], chunk)
                                                      : sharedCorner(corners[k], chunk));
    }
    if (mesh_.normals.empty()) giveFacetNormal(chunk);
  }
  // The next chunk has vertices of its own.
  void endChunk() {
    for (const std::uint32_t vertex : used_) numbers_[vertex] = kNone;
    used_.clear();
  }

 private:
  static constexpr std::uint32_t kNone = ~0u;

  std::uint32_t addCorner(std::uint32_t vertex, SurfaceChunk& chunk) const {
    SurfaceVertex result;
    result.position = glm::vec3(glm::dvec3(mesh_.positions[vertex]) - origin_);
    if (!mesh_.normals.empty()) result.normal = packNormal(mesh_.normals[vertex]);
    chunk.vertices.push_back(result);
    return static_cast<std::uint32_t>(chunk.vertices.size() - 1);
  }
  std::uint32_t sharedCorner(std::uint32_t vertex, SurfaceChunk& chunk) {
    if (numbers_[vertex] == kNone) {
      numbers_[vertex] = addCorner(vertex, chunk);
      used_.push_back(vertex);
    }
    return numbers_[vertex];
  }
  static void giveFacetNormal(SurfaceChunk& chunk) {
    SurfaceVertex* const corners = chunk.vertices.data() + chunk.vertices.size() - 3;
    const glm::vec3 facet = glm::cross(corners[1].position - corners[0].position,
                                       corners[2].position - corners[0].position);
    const float area = glm::length(facet);
    const auto normal = packNormal(area > 0.0f ? facet / area : glm::vec3(0.0f));
    for (int k = 0; k < 3; ++k) corners[k].normal = normal;
  }

  const RenderMesh& mesh_;
  glm::dvec3 origin_;
  std::vector<std::uint32_t> numbers_;  // of the mesh's vertices in the current chunk
  std::vector<std::uint32_t> used_;
};

glm::dvec3 originOf(const RenderMesh& mesh) {
  const RenderBox box = boundsOf(mesh.positions);
  return glm::round(0.5 * (glm::dvec3(box.lower) + glm::dvec3(box.upper)));
}

constexpr double kMargin = 1.06;
constexpr double kLeast = -std::numeric_limits<double>::infinity();

void placeLookAt(const LookAtCamera& look_at, PlacedCamera& camera) {
  camera.eye = look_at.eye;
  camera.forward = glm::normalize(look_at.target - look_at.eye);
  const glm::dvec3 right = glm::cross(camera.forward, glm::normalize(look_at.up));
  constexpr double kLeastSine = 1e-6;  // of the angle between up and the view
  if (!(glm::length(right) > kLeastSine) || !std::isfinite(glm::length(look_at.eye))) {
    throw Error(
        "cannot render: the camera's eye and target coincide or its up direction is parallel to "
        "the view; move the eye or choose another up direction");
  }
  camera.right = glm::normalize(right);
  camera.up = glm::cross(camera.right, camera.forward);
}

void turnOrbit(const OrbitCamera& orbit, PlacedCamera& camera) {
  const glm::dvec3 axis = glm::normalize(orbit.up);
  if (!std::isfinite(axis.x + axis.y + axis.z + orbit.azimuth + orbit.elevation)) {
    throw Error("cannot render: the camera's up direction is zero or an angle is not a number");
  }
  const bool axis_is_y = std::abs(axis.y) > 0.9;
  const glm::dvec3 ahead =
      axis_is_y ? glm::dvec3(0.0, 0.0, -std::copysign(1.0, axis.y)) : glm::dvec3(0.0, 1.0, 0.0);
  const glm::dvec3 front = glm::normalize(ahead - axis * glm::dot(ahead, axis));
  const glm::dvec3 side = glm::cross(front, axis);
  const double azimuth = glm::radians(orbit.azimuth);
  const double elevation = glm::radians(orbit.elevation);
  const glm::dvec3 outward = side * std::sin(azimuth) - front * std::cos(azimuth);
  // `up` is the derivative of the view by the elevation: defined even straight from above.
  camera.forward = -(outward * std::cos(elevation) + axis * std::sin(elevation));
  camera.up = axis * std::cos(elevation) - outward * std::sin(elevation);
  camera.right = glm::cross(camera.forward, camera.up);
}

}  // namespace

std::vector<SurfaceChunk> chunksOf(const RenderMesh& mesh, bool with_levels) {
  const std::size_t count = mesh.triangles.size() / 3;
  if (count == 0) return {};
  const bool sorted = with_levels && !mesh.triangle_levels.empty();
  std::vector<std::size_t> order;
  if (sorted) {
    order.resize(count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return mesh.triangle_levels[a] < mesh.triangle_levels[b];
    });
  }
  std::vector<SurfaceChunk> chunks;
  const glm::dvec3 origin = originOf(mesh);
  MeshCutter cutter(mesh, origin);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t triangle = sorted ? order[i] : i;
    const int level = sorted ? mesh.triangle_levels[triangle] : 0;
    if (chunks.empty() || chunks.back().level != level ||
        chunks.back().triangles.size() == 3 * kMostTriangles) {
      cutter.endChunk();
      chunks.emplace_back();
      chunks.back().origin = origin;
      chunks.back().level = level;
    }
    cutter.add(triangle, chunks.back());
  }
  for (SurfaceChunk& chunk : chunks) boundChunk(chunk);
  return chunks;
}

PictureFit::PictureFit(const PlacedCamera& camera)
    : camera_(camera),
      half_width_(camera.half_width / kMargin),
      half_height_(camera.half_height / kMargin),
      right_(kLeast),
      left_(kLeast),
      top_(kLeast),
      bottom_(kLeast),
      nearest_(kLeast) {}

// A point (x, y, z) along right, up and forward is left of the right border of an eye at (a, b, c)
// if x - a <= half_width * (z - c); so only the greatest x - half_width * z of all points matters
// there, and likewise at the three other borders.
void PictureFit::include(const glm::dvec3& point) {
  const double x = glm::dot(point, camera_.right);
  const double y = glm::dot(point, camera_.up);
  const double z = glm::dot(point, camera_.forward);
  right_ = std::max(right_, x - half_width_ * z);
  left_ = std::max(left_, -x - half_width_ * z);
  top_ = std::max(top_, y - half_height_ * z);
  bottom_ = std::max(bottom_, -y - half_height_ * z);
  nearest_ = std::max(nearest_, -z);
}

void PictureFit::moveEye(PlacedCamera& camera) const {
  if (nearest_ == kLeast) return;
  double depth =
      std::min(-(right_ + left_) / (2.0 * half_width_), -(top_ + bottom_) / (2.0 * half_height_));
  // A point, or a line seen end on, can be approached without end.
  const double scale = std::max({1.0, std::abs(nearest_), std::abs(right_), std::abs(top_)});
  if (-nearest_ - depth < 1e-9 * scale) depth = -nearest_ - 1.0;
  camera.eye = camera.right * (0.5 * (right_ - left_)) + camera.up * (0.5 * (top_ - bottom_)) +
               camera.forward * depth;
}

PlacedCamera aimCamera(const RenderOptions& options) {
  PlacedCamera camera;
  camera.half_height = std::tan(0.5 * glm::radians(options.vertical_fov));
  camera.half_width = camera.half_height * options.width / options.height;
  if (options.look_at)
    placeLookAt(*options.look_at, camera);
  else
    turnOrbit(options.orbit, camera);
  return camera;
}

RenderBox boundsOf(std::span<const glm::vec3> positions) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  RenderBox box{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  for (const glm::vec3& position : positions) {
    box.lower = glm::min(box.lower, position);
    box.upper = glm::max(box.upper, position);
  }
  return box;
}

}  // namespace isobrick
