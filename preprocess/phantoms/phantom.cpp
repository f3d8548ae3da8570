#include "isobrick/preprocess/phantoms/phantom.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <glm/geometric.hpp>
#include <glm/trigonometric.hpp>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/phantoms/head_phantom.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

constexpr double kPi = std::numbers::pi;

// In the order of Phantom::Kind.
constexpr std::array kPhantomNames = {"head",   "sphere",         "torus",
                                      "gyroid", "marschner-lobb", "plane"};

using ScaleRow = std::array<PhantomScale, kVoxelTypeCount>;  // in the order of VoxelType
constexpr ScaleRow kDistanceScale = {{{128, 16}, {0, 16}, {32768, 256}, {0, 256}, {0, 1}}};
constexpr ScaleRow kGyroidScale = {{{128, 84}, {0, 84}, {32768, 20000}, {0, 20000}, {0, 1}}};
constexpr ScaleRow kUnitScale = {{{0, 255}, {-128, 255}, {0, 65535}, {0, 32767}, {0, 1}}};
constexpr ScaleRow kHeadScale = {{{0, 1.0 / 16}, {-128, 1.0 / 16}, {0, 1}, {0, 1}, {0, 1}}};

// From voxel indices to -1 .. 1. In single precision: the head is made of it.
float normalized(double index, std::int64_t size) {
  return static_cast<float>(2 * index / static_cast<double>(size - 1) - 1);
}

template <typename T>
T toVoxel(double stored) {
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<T>(stored);
  } else {
    constexpr double kLeast = std::numeric_limits<T>::min(), kMost = std::numeric_limits<T>::max();
    // Halves go up; a cast truncates, so it is done on positive numbers. (lround is a call.)
    const double clamped = stored < kLeast ? kLeast : stored > kMost ? kMost : stored;
    return static_cast<T>(static_cast<std::int32_t>(clamped - kLeast + 0.5) +
                          static_cast<std::int32_t>(kLeast));
  }
}

glm::dvec3 withoutNan(const glm::dvec3& v) {
  return {std::isnan(v.x) ? 0 : v.x, std::isnan(v.y) ? 0 : v.y, std::isnan(v.z) ? 0 : v.z};
}

class PhantomSource final : public VolumeSource {
 public:
  explicit PhantomSource(const PhantomSpec& spec) : phantom_(spec) {
    info_.voxels = Index3(spec.size);
    info_.voxel_type = phantom_.voxelType();
    info_.source = spec.name;
    info_.format = "phantom";
  }

  const VolumeInfo& info() const override { return info_; }

  std::string identity() const override {
    const PhantomSpec& spec = phantom_.spec();
    char period[40];
    std::snprintf(period, sizeof period, "%.17g", spec.gyroid_period);
    return concat("phantom ", spec.name, ", ", spec.size, " voxels, ",
                  voxelTypeName(info_.voxel_type), ", period ", period);
  }

  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    const std::size_t row_bytes =
        static_cast<std::size_t>(box.count.x) * voxelBytes(info_.voxel_type);
    isolatedFor(std::int64_t{0}, box.count.y * box.count.z, [&](std::int64_t i) {
      phantom_.fillRow(box.first + Index3(0, i % box.count.y, i / box.count.y), box.count.x,
                       static_cast<std::byte*>(out) + static_cast<std::size_t>(i) * row_bytes);
    });
  }

 private:
  Phantom phantom_;
  VolumeInfo info_;
};

}  // namespace

Phantom::Kind Phantom::kindOf(const std::string& name) {
  std::string all;
  for (std::size_t i = 0; i < kPhantomNames.size(); ++i) {
    if (name == kPhantomNames[i]) return static_cast<Kind>(i);
    all += (i == 0 ? "" : ", ") + std::string(kPhantomNames[i]);
  }
  throw Error("unknown phantom '" + name + "'; choose one of " + all);
}

Phantom::Phantom(const PhantomSpec& spec) : spec_(spec), kind_(kindOf(spec.name)) {
  if (spec.size < 2 || spec.size > kMaxVoxelsPerAxis)
    throw Error(concat("cannot make the phantom '", spec.name, "' with ", spec.size,
                       " voxels per axis; choose a size from 2 to ", kMaxVoxelsPerAxis));
  if (!(spec.gyroid_period > 0) || !std::isfinite(spec.gyroid_period))
    throw Error(concat("cannot make a gyroid with a period of ", spec.gyroid_period,
                       " voxels; choose a period above 0"));
  const double extent = static_cast<double>(spec.size - 1);
  constants_.center = glm::dvec3(extent / 2);
  constants_.sphere_radius = 0.35 * extent;
  constants_.torus_major_radius = 0.28 * extent;
  constants_.torus_minor_radius = 0.11 * extent;
  constants_.plane_normal = glm::normalize(glm::dvec3(1.0, 0.6, 1.7));
  // A little off the centre, so that no voxel lies on it by symmetry; the same for the gyroid.
  constants_.plane_offset = glm::dot(constants_.plane_normal, constants_.center) + 0.137;
  constants_.gyroid_origin = constants_.center + glm::dvec3(0.131, 0.293, 0.417);
  constants_.gyroid_period = spec.gyroid_period;

  voxel_type_ = spec.voxel_type.value_or(kind_ == Kind::kHead     ? VoxelType::kUint16
                                         : kind_ == Kind::kGyroid ? VoxelType::kUint8
                                                                  : VoxelType::kFloat32);
  const ScaleRow& scales = kind_ == Kind::kHead            ? kHeadScale
                           : kind_ == Kind::kGyroid        ? kGyroidScale
                           : kind_ == Kind::kMarschnerLobb ? kUnitScale
                                                           : kDistanceScale;
  scale_ = scales[static_cast<std::size_t>(voxel_type_)];

  if (kind_ == Kind::kGyroid)
    for (std::int64_t i = 0; i < spec.size; ++i) {
      const double x = 2 * kPi / constants_.gyroid_period *
                       (static_cast<double>(i) - constants_.gyroid_origin.x);
      sin_x_.push_back(std::sin(x));
      cos_x_.push_back(std::cos(x));
    }
}

double Phantom::isovalue() const {
  switch (kind_) {
    case Kind::kHead:
      return 1324;
    case Kind::kMarschnerLobb:
      return 0.5;
    default:
      return 0;
  }
}

double Phantom::value(double x, double y, double z) const {
  const glm::dvec3 p(x, y, z);
  const glm::dvec3 d = p - constants_.center;
  switch (kind_) {
    case Kind::kHead: {
      const float u = normalized(x, spec_.size);
      float result = 0;
      headPhantomRow({&u, 1}, normalized(y, spec_.size), normalized(z, spec_.size),
                     2.0f / static_cast<float>(spec_.size - 1), &result);
      return static_cast<double>(result);
    }
    case Kind::kSphere:
      return constants_.sphere_radius - std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    case Kind::kTorus: {
      const double ring = std::sqrt(d.x * d.x + d.y * d.y) - constants_.torus_major_radius;
      return constants_.torus_minor_radius - std::sqrt(ring * ring + d.z * d.z);
    }
    case Kind::kGyroid: {
      const glm::dvec3 g = 2 * kPi / constants_.gyroid_period * (p - constants_.gyroid_origin);
      return std::sin(g.x) * std::cos(g.y) + std::sin(g.y) * std::cos(g.z) +
             std::sin(g.z) * std::cos(g.x);
    }
    case Kind::kMarschnerLobb: {
      const double scale = 2 / static_cast<double>(spec_.size - 1);
      const double r = scale * std::sqrt(d.x * d.x + d.y * d.y);
      const double alpha = constants_.marschner_lobb_alpha;
      const double radial =
          std::cos(2 * kPi * constants_.marschner_lobb_frequency * std::cos(kPi * r / 2));
      return (1 - std::sin(kPi * scale * d.z / 2) + alpha * (1 + radial)) / (2 * (1 + alpha));
    }
    case Kind::kPlane:
      return constants_.plane_normal.x * x + constants_.plane_normal.y * y +
             constants_.plane_normal.z * z - constants_.plane_offset;
  }
  return 0;
}

glm::dvec3 Phantom::gradient(const glm::dvec3& p) const {
  const glm::dvec3 d = p - constants_.center;
  switch (kind_) {
    case Kind::kHead:
      throw std::logic_error("the head phantom has no analytic gradient");
    case Kind::kSphere:
      return withoutNan(-d / glm::length(d));
    case Kind::kTorus: {
      const double radius = std::hypot(d.x, d.y);
      const double ring = radius - constants_.torus_major_radius;
      const double tube = std::hypot(ring, d.z);
      return withoutNan(
          {-ring / tube * (d.x / radius), -ring / tube * (d.y / radius), -d.z / tube});
    }
    case Kind::kGyroid: {
      const double omega = 2 * kPi / constants_.gyroid_period;
      const glm::dvec3 g = omega * (p - constants_.gyroid_origin);
      const glm::dvec3 s = glm::sin(g), c = glm::cos(g);
      return omega *
             glm::dvec3(c.x * c.y - s.z * s.x, c.y * c.z - s.x * s.y, c.z * c.x - s.y * s.z);
    }
    case Kind::kMarschnerLobb: {
      const double scale = 2 / static_cast<double>(spec_.size - 1);
      const double r = scale * std::hypot(d.x, d.y);
      const double alpha = constants_.marschner_lobb_alpha;
      const double omega = 2 * kPi * constants_.marschner_lobb_frequency;
      const double radial = alpha * std::sin(omega * std::cos(kPi * r / 2)) * omega * (kPi / 2) *
                            std::sin(kPi * r / 2);
      const double along = -kPi / 2 * std::cos(kPi * scale * d.z / 2);
      const double factor = scale / (2 * (1 + alpha));
      if (r == 0) return {0, 0, factor * along};
      return factor * glm::dvec3(radial * scale * d.x / r, radial * scale * d.y / r, along);
    }
    case Kind::kPlane:
      return constants_.plane_normal;
  }
  return glm::dvec3(0);
}

template <typename T>
void Phantom::fillTypedRow(const Index3& first, std::int64_t count, T* out) const {
  const auto n = static_cast<std::size_t>(count);
  const auto yd = static_cast<double>(first.y), zd = static_cast<double>(first.z);
  const auto xOf = [&](std::size_t i) {
    return static_cast<double>(first.x + static_cast<std::int64_t>(i));
  };
  const auto store = [&](std::size_t i, double field) {
    out[i] = toVoxel<T>(scale_.stored(field));
  };
  if (kind_ == Kind::kHead) {
    // Buffers per thread: a volume has size^2 rows.
    thread_local std::vector<float> x, row;
    x.resize(n);
    row.resize(n);
    for (std::size_t i = 0; i < n; ++i) x[i] = normalized(xOf(i), spec_.size);
    headPhantomRow(x, normalized(yd, spec_.size), normalized(zd, spec_.size),
                   2.0f / static_cast<float>(spec_.size - 1), row.data());
    for (std::size_t i = 0; i < n; ++i) store(i, static_cast<double>(row[i]));
  } else if (kind_ == Kind::kGyroid) {
    // The terms of value(), in its order, with the sines and cosines of the row taken out.
    const double omega = 2 * kPi / constants_.gyroid_period;
    const double gy = omega * (yd - constants_.gyroid_origin.y);
    const double gz = omega * (zd - constants_.gyroid_origin.z);
    const double cos_y = std::cos(gy), middle = std::sin(gy) * std::cos(gz), sin_z = std::sin(gz);
    const double* const sin_x = sin_x_.data() + first.x;
    const double* const cos_x = cos_x_.data() + first.x;
    for (std::size_t i = 0; i < n; ++i) store(i, sin_x[i] * cos_y + middle + sin_z * cos_x[i]);
  } else {
    for (std::size_t i = 0; i < n; ++i) store(i, value(xOf(i), yd, zd));
  }
}

void Phantom::fillRow(const Index3& first, std::int64_t count, void* out) const {
  visitVoxelType(voxel_type_, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    fillTypedRow(first, count, static_cast<T*>(out));
  });
}

std::vector<std::string> phantomNames() { return {kPhantomNames.begin(), kPhantomNames.end()}; }

std::unique_ptr<VolumeSource> makePhantomSource(const PhantomSpec& spec) {
  return std::make_unique<PhantomSource>(spec);
}

}  // namespace isobrick
