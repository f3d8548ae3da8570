// The phantoms are ground truth for other tests, so they are tested against mathematics.
#include "isobrick/preprocess/phantoms/phantom.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <random>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

PhantomSpec specOf(const std::string& name, std::int64_t size,
                   std::optional<VoxelType> type = std::nullopt) {
  PhantomSpec spec;
  spec.name = name;
  spec.size = size;
  spec.voxel_type = type;
  return spec;
}

std::vector<std::byte> generate(const PhantomSpec& spec, std::int64_t slab) {
  const auto source = makePhantomSource(spec);
  const Index3 voxels = source->info().voxels;
  const auto slice_bytes =
      static_cast<std::size_t>(voxels.x * voxels.y) * voxelBytes(source->info().voxel_type);
  std::vector<std::byte> bytes(slice_bytes * static_cast<std::size_t>(voxels.z));
  for (std::int64_t first = 0; first < voxels.z; first += slab)
    source->readRows(first * voxels.y, std::min(slab, voxels.z - first) * voxels.y,
                     bytes.data() + static_cast<std::size_t>(first) * slice_bytes);
  return bytes;
}

template <typename T>
std::vector<T> generateValues(const PhantomSpec& spec) {
  const auto bytes = generate(spec, spec.size);
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

TEST(PhantomTest, GradientsAgreeWithFiniteDifferences) {
  constexpr double kSize = 65;
  constexpr double kStep = 1e-4;
  for (const char* name : {"sphere", "torus", "gyroid", "marschner-lobb", "plane"}) {
    const Phantom phantom(specOf(name, 65));
    std::mt19937 random(7);
    std::uniform_real_distribution<double> coordinate(0, kSize - 1);
    double greatest = 0;
    for (int i = 0; i < 500; ++i) {
      const glm::dvec3 p(coordinate(random), coordinate(random), coordinate(random));
      const glm::dvec3 gradient = phantom.gradient(p);
      greatest = std::max(greatest, glm::length(gradient));
      for (int axis = 0; axis < 3; ++axis) {
        glm::dvec3 step(0);
        step[axis] = kStep;
        const double difference = (phantom.value(p + step) - phantom.value(p - step)) / (2 * kStep);
        // Near the circle of the torus, where the gradient jumps, differences mean nothing.
        if (phantom.value(p) > phantom.constants().torus_minor_radius - 1e-2) continue;
        ASSERT_NEAR(gradient[axis], difference, 1e-5)
            << name << " at " << p.x << " " << p.y << " " << p.z;
      }
    }
    EXPECT_GT(greatest, 0.01) << name;
  }
  EXPECT_THROW(Phantom(specOf("head", 8)).gradient(glm::dvec3(1)), std::logic_error);
}

TEST(PhantomTest, SurfacesAreWhereTheConstantsSay) {
  const Phantom sphere(specOf("sphere", 33));
  const PhantomConstants c = sphere.constants();
  EXPECT_EQ(c.center, glm::dvec3(16));
  for (const glm::dvec3 direction : {glm::dvec3(1, 0, 0), glm::dvec3(-0.6, 0, 0.8)}) {
    EXPECT_NEAR(sphere.value(c.center + c.sphere_radius * direction), sphere.isovalue(), 1e-12);
    EXPECT_NEAR(sphere.value(c.center + 3.0 * direction), c.sphere_radius - 3, 1e-12);
  }
  const Phantom torus(specOf("torus", 33));
  const glm::dvec3 on_circle = c.center + c.torus_major_radius * glm::dvec3(0.6, 0.8, 0);
  EXPECT_NEAR(torus.value(on_circle), c.torus_minor_radius, 1e-12);
  EXPECT_NEAR(torus.value(on_circle + glm::dvec3(0, 0, c.torus_minor_radius)), 0, 1e-12);
  EXPECT_NEAR(torus.value(on_circle + c.torus_minor_radius * glm::dvec3(0.6, 0.8, 0)), 0, 1e-12);

  const Phantom plane(specOf("plane", 33));
  const PhantomConstants p = plane.constants();
  EXPECT_NEAR(glm::length(p.plane_normal), 1, 1e-12);
  const glm::dvec3 point(3, 11, 29);
  EXPECT_NEAR(plane.value(point), glm::dot(p.plane_normal, point) - p.plane_offset, 1e-12);
  EXPECT_LT(std::abs(plane.value(p.center)), 1);  // it goes through the volume

  const Phantom gyroid(specOf("gyroid", 33));
  const glm::dvec3 origin = gyroid.constants().gyroid_origin;
  EXPECT_NEAR(gyroid.value(origin), 0, 1e-12);
  EXPECT_NEAR(gyroid.value(origin + glm::dvec3(16, -32, 48)), 0, 1e-12);  // whole periods
  EXPECT_NEAR(gyroid.value(origin + glm::dvec3(4, 0, 0)), 1, 1e-12);      // sin of a quarter

  const Phantom signal(specOf("marschner-lobb", 33));
  // (1 - sin 0 + alpha (1 + cos(12 pi))) / (2 (1 + alpha)) at the centre.
  EXPECT_NEAR(signal.value(glm::dvec3(16)), 1.5 / 2.5, 1e-12);
  EXPECT_NEAR(signal.value(glm::dvec3(16, 16, 32)), 0.5 / 2.5, 1e-12);
}

TEST(PhantomTest, BytesDependOnTheSpecAlone) {
  for (const std::string& name : phantomNames()) {
    const PhantomSpec spec = specOf(name, 37);
    const auto whole = generate(spec, 37);
    for (const std::int64_t slab : {1, 5, 36}) EXPECT_EQ(generate(spec, slab), whole) << name;
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(generate(spec, 8), whole) << name;
  }
}

TEST(PhantomTest, VoxelsAreTheFieldScaledRoundedAndClamped) {
  for (const std::string& name : phantomNames())
    for (std::uint32_t t = 0; t < kVoxelTypeCount; ++t) {
      const PhantomSpec spec = specOf(name, 19, static_cast<VoxelType>(t));
      const Phantom phantom(spec);
      ASSERT_EQ(phantom.voxelType(), *spec.voxel_type);
      visitVoxelType(*spec.voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        const auto values = generateValues<T>(spec);
        for (std::size_t i = 0; i < values.size(); i += 13) {
          const double stored = phantom.scale().stored(
              phantom.value(static_cast<double>(i % 19), static_cast<double>(i / 19 % 19),
                            static_cast<double>(i / 361)));
          const double got = static_cast<double>(values[i]);
          if constexpr (std::is_integral_v<T>) {
            const double clamped =
                std::clamp(stored, static_cast<double>(std::numeric_limits<T>::min()),
                           static_cast<double>(std::numeric_limits<T>::max()));
            ASSERT_LE(std::abs(got - clamped), 0.5) << name << " " << t << " voxel " << i;
          } else {
            ASSERT_EQ(values[i], static_cast<float>(stored)) << name << " voxel " << i;
          }
        }
        // The isosurface is there, inside the range of the type.
        const double isovalue = phantom.storedIsovalue();
        EXPECT_TRUE(std::any_of(values.begin(), values.end(), [&](T v) { return v < isovalue; }))
            << name << " " << t;
        EXPECT_TRUE(std::any_of(values.begin(), values.end(), [&](T v) { return v >= isovalue; }))
            << name << " " << t;
      });
    }
}

TEST(PhantomTest, HeadLooksLikeACt) {
  const auto source = makePhantomSource(specOf("head", 96));
  EXPECT_EQ(source->info().voxel_type, VoxelType::kUint16);
  EXPECT_EQ(source->info().format, "phantom");
  const auto values = generateValues<std::uint16_t>(specOf("head", 96));
  const auto share = [&](int low, int high) {
    return static_cast<double>(std::count_if(values.begin(), values.end(),
                                             [&](int v) { return v >= low && v < high; })) /
           static_cast<double>(values.size());
  };
  EXPECT_GT(share(0, 25), 0.5);        // air
  EXPECT_GT(share(950, 1150), 0.15);   // soft tissue
  EXPECT_GT(share(1324, 4096), 0.01);  // bone
  EXPECT_EQ(share(4096, 65536), 0);    // what a scanner does not give
  // The corners are air.
  EXPECT_LE(values.front(), 24);
  EXPECT_LE(values.back(), 24);
  // Features are the same at every resolution: the same point, on grids of two sizes.
  const Phantom coarse(specOf("head", 129)), fine(specOf("head", 257));
  for (const glm::dvec3 p :
       {glm::dvec3(64, 70, 90), glm::dvec3(64, 20, 128), glm::dvec3(40, 64, 80)})
    EXPECT_NEAR(coarse.value(p), fine.value(2.0 * p), 1) << p.x;
}

TEST(PhantomTest, TwoVoxelsAreEnough) {
  for (const std::string& name : phantomNames()) EXPECT_NO_THROW(generate(specOf(name, 2), 1));
}

TEST(PhantomTest, UnknownNamesAndSizesAreRefused) {
  try {
    makePhantomSource(specOf("teapot", 32));
    FAIL();
  } catch (const Error& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("'teapot'"), std::string::npos);
    for (const std::string& name : phantomNames())
      EXPECT_NE(message.find(name), std::string::npos) << name;
  }
  EXPECT_THROW(makePhantomSource(specOf("head", 1)), Error);
  EXPECT_THROW(makePhantomSource(specOf("head", kMaxVoxelsPerAxis + 1)), Error);
  PhantomSpec spec = specOf("gyroid", 32);
  spec.gyroid_period = 0;
  EXPECT_THROW(makePhantomSource(spec), Error);
}

}  // namespace
}  // namespace isobrick
