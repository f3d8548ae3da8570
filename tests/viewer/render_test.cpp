// Pictures of spheres, whose outline and colours are known beforehand, and pictures as files.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/offscreen_renderer.h"
#include "tests/support/mesh_picture.h"
#include "tests/support/requirement.h"
#include "tests/support/temporary_folder.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

using test::MeshLook;

struct OwnedMesh {
  std::vector<glm::vec3> positions;
  std::vector<glm::vec3> normals;
  std::vector<std::uint32_t> triangles;
  std::vector<std::uint8_t> levels;

  DrawableSurface surface() const { return test::surfaceOf(positions, normals, triangles, levels); }
};

// Adds a sphere of 2 * rings * slices triangles, those at the poles without area.
void addSphere(OwnedMesh& mesh, const glm::vec3& center, float radius, std::uint8_t level,
               std::uint32_t rings, std::uint32_t slices) {
  const auto base = static_cast<std::uint32_t>(mesh.positions.size());
  for (std::uint32_t ring = 0; ring <= rings; ++ring) {
    const double polar = std::numbers::pi * ring / rings;
    for (std::uint32_t slice = 0; slice <= slices; ++slice) {
      const double angle = 2.0 * std::numbers::pi * slice / slices;
      const glm::vec3 normal(glm::dvec3(std::sin(polar) * std::cos(angle),
                                        std::sin(polar) * std::sin(angle), std::cos(polar)));
      mesh.positions.push_back(center + radius * normal);
      mesh.normals.push_back(normal);
    }
  }
  for (std::uint32_t ring = 0; ring < rings; ++ring) {
    for (std::uint32_t slice = 0; slice < slices; ++slice) {
      const std::uint32_t a = base + ring * (slices + 1) + slice;
      const std::uint32_t b = a + slices + 1;
      for (const std::uint32_t index : {a, b, b + 1, a, b + 1, a + 1}) {
        mesh.triangles.push_back(index);
      }
      mesh.levels.insert(mesh.levels.end(), 2, level);
    }
  }
}

OwnedMesh unitSphere(std::uint32_t rings = 96, std::uint32_t slices = 192) {
  OwnedMesh mesh;
  addSphere(mesh, glm::vec3(0.0f), 1.0f, 0, rings, slices);
  return mesh;
}

glm::vec3 pixelOf(const Image& image, int x, int y) {
  const std::size_t offset = image.offsetOf(x, y);
  return {image.rgb[offset], image.rgb[offset + 1], image.rgb[offset + 2]};
}

float luminance(const glm::vec3& color) {
  return glm::dot(color, glm::vec3(0.2126f, 0.7152f, 0.0722f));
}

double meanLuminance(const Image& image) {
  double sum = 0.0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) sum += luminance(pixelOf(image, x, y));
  }
  return sum / image.width / image.height;
}

// The pixels that are not as in `background`.
struct Silhouette {
  std::int64_t pixels = 0;
  int left, right = -1, top, bottom = -1;
};

Silhouette silhouetteOf(const Image& image, const Image& background) {
  Silhouette found;
  found.left = image.width;
  found.top = image.height;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (glm::distance(pixelOf(image, x, y), pixelOf(background, x, y)) < 1e-3f) continue;
      ++found.pixels;
      found.left = std::min(found.left, x);
      found.right = std::max(found.right, x);
      found.top = std::min(found.top, y);
      found.bottom = std::max(found.bottom, y);
    }
  }
  return found;
}

// Which of red, green and blue is the greatest, as a letter.
char hueOf(const glm::vec3& color) {
  if (color.r > color.g && color.r > color.b) return 'r';
  return color.g > color.b ? 'g' : 'b';
}

class RenderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!renderer_) {
      try {
        renderer_ = std::make_unique<OffscreenRenderer>();
      } catch (const Error& error) {
        SKIP_UNLESS_REQUIRED(error.what());
      }
    }
  }
  static void TearDownTestSuite() { renderer_.reset(); }

  static Image render(const OwnedMesh& mesh, const MeshLook& options) {
    return test::pictureOf(*renderer_, mesh.surface(), options);
  }

  static MeshLook smallPicture() {
    MeshLook options;
    options.width = 320;
    options.height = 240;
    return options;
  }

  static std::unique_ptr<OffscreenRenderer> renderer_;  // one for all tests: shaders take a while
};

std::unique_ptr<OffscreenRenderer> RenderTest::renderer_;

// Enough triangles for several of the pieces in which a mesh is sent.
TEST_F(RenderTest, SphereCoversItsProjection) {
  const OwnedMesh sphere = unitSphere(500, 600);
  MeshLook options;
  options.width = 1000;
  options.height = 800;
  options.view.camera = lookingAt({1.0, -4.0, 1.5}, {0.0, 0.0, 0.0});
  options.view.camera.vertical_fov = 40.0;
  options.is_placed = true;
  const Image image = render(sphere, options);
  const Silhouette silhouette = silhouetteOf(image, render(OwnedMesh{}, options));

  const double distance = options.view.camera.distance;
  const double focal = 400.0 / std::tan(20.0 * std::numbers::pi / 180.0);  // pixels
  const double radius = focal * std::tan(std::asin(1.0 / distance));
  const double area = std::numbers::pi * radius * radius;
  EXPECT_NEAR(static_cast<double>(silhouette.pixels), area, 0.01 * area);
  EXPECT_NEAR(silhouette.right - silhouette.left + 1, 2.0 * radius, 2.0);
  EXPECT_NEAR(silhouette.bottom - silhouette.top + 1, 2.0 * radius, 2.0);
  EXPECT_NEAR(0.5 * (silhouette.left + silhouette.right + 1), 500.0, 1.0);
  EXPECT_NEAR(0.5 * (silhouette.top + silhouette.bottom + 1), 400.0, 1.0);
  EXPECT_GT(luminance(pixelOf(image, 500, 400)), 2.0f * luminance(pixelOf(image, 5, 400)));
}

TEST_F(RenderTest, TheWholeMeshIsInThePictureFromEverywhere) {
  // Far from the origin, as a scanner may have it.
  OwnedMesh mesh;
  addSphere(mesh, {9000.0f, -4000.0f, 70.0f}, 30.0f, 0, 24, 48);
  addSphere(mesh, {9000.0f, -4000.0f, 190.0f}, 10.0f, 0, 24, 48);
  for (const auto& [width, height] : {std::pair{300, 200}, std::pair{160, 240}}) {
    for (const double elevation : {-90.0, 15.0, 90.0}) {
      for (const double azimuth : {0.0, 25.0, 200.0}) {
        MeshLook options;
        options.width = width;
        options.height = height;
        options.view.camera.azimuth = azimuth;
        options.view.camera.elevation = elevation;
        const Silhouette seen = silhouetteOf(render(mesh, options), render({}, options));
        const double filled = std::max((seen.right - seen.left + 1.0) / width,
                                       (seen.bottom - seen.top + 1.0) / height);
        EXPECT_GT(filled, 0.90) << azimuth << ' ' << elevation;
        EXPECT_LT(filled, 0.98) << azimuth << ' ' << elevation;
        EXPECT_NEAR(seen.left, width - 1 - seen.right, 2) << azimuth << ' ' << elevation;
        EXPECT_NEAR(seen.top, height - 1 - seen.bottom, 2) << azimuth << ' ' << elevation;
      }
    }
  }
}

TEST_F(RenderTest, AGivenBoxIsFramedInsteadOfTheMesh) {
  const OwnedMesh sphere = unitSphere();
  MeshLook options = smallPicture();
  const auto seen = [&] { return silhouetteOf(render(sphere, options), render({}, options)); };
  const std::int64_t framed_mesh = seen().pixels;
  options.frame = WorldBox{glm::dvec3(-4.0), glm::dvec3(4.0)};
  const std::int64_t framed_large = seen().pixels;
  options.frame = WorldBox{glm::dvec3(-0.1), glm::dvec3(0.1)};  // a close-up, cut off
  EXPECT_GT(framed_large, 0);
  EXPECT_LT(framed_large, framed_mesh / 8);
  EXPECT_EQ(seen().pixels, 320 * 240);
}

// Red (level 0) at the patient's left, blue (level 5) at the right, green (level 3) at the head,
// teal (4) in front and, hidden by it, yellow (2) at the back.
TEST_F(RenderTest, DirectionsAreThoseOfAPortrait) {
  OwnedMesh mesh;
  addSphere(mesh, {4.0f, 0.0f, 0.0f}, 1.0f, 0, 24, 48);
  addSphere(mesh, {-4.0f, 0.0f, 0.0f}, 1.0f, 5, 24, 48);
  addSphere(mesh, {0.0f, 0.0f, 4.0f}, 1.0f, 3, 24, 48);
  addSphere(mesh, {0.0f, -4.0f, 0.0f}, 1.0f, 4, 24, 48);
  addSphere(mesh, {0.0f, 4.0f, 0.0f}, 1.0f, 2, 24, 48);
  MeshLook options;
  options.width = options.height = 300;
  options.view.coloring = ViewColoring::kLevel;
  options.view.camera.azimuth = options.view.camera.elevation = 0.0;
  options.frame = WorldBox{glm::dvec3(-6.0), glm::dvec3(6.0)};
  // The spheres at x, y or z = 4 lie about this many pixels off the middle.
  const int off = 78;
  {
    const Image front = render(mesh, options);
    EXPECT_EQ(hueOf(pixelOf(front, 150 + off, 150)), 'r');
    EXPECT_EQ(hueOf(pixelOf(front, 150 - off, 150)), 'b');
    EXPECT_EQ(hueOf(pixelOf(front, 150, 150 - off)), 'g');
    EXPECT_EQ(hueOf(pixelOf(front, 150, 150)), 'g');  // teal
  }
  {
    options.view.camera.azimuth = 180.0;
    const Image back = render(mesh, options);
    EXPECT_EQ(hueOf(pixelOf(back, 150 - off, 150)), 'r');
    EXPECT_EQ(hueOf(pixelOf(back, 150 + off, 150)), 'b');
    EXPECT_EQ(hueOf(pixelOf(back, 150, 150 - off)), 'g');
    EXPECT_EQ(hueOf(pixelOf(back, 150, 150)), 'r');  // yellow
  }
  {
    options.view.camera.azimuth = 90.0;
    const Image from_left = render(mesh, options);
    EXPECT_EQ(hueOf(pixelOf(from_left, 150, 150)), 'r');
  }
  {
    options.view.camera.azimuth = 0.0;
    options.view.camera.elevation = 90.0;
    const Image from_above = render(mesh, options);
    EXPECT_EQ(hueOf(pixelOf(from_above, 150, 150)), 'g');
    EXPECT_EQ(hueOf(pixelOf(from_above, 150 + off, 150)), 'r');
    EXPECT_EQ(hueOf(pixelOf(from_above, 150, 150 - off)), 'r');  // yellow: the back is up
  }
}

TEST_F(RenderTest, InsideOutLooksDarkAndWarm) {
  OwnedMesh sphere = unitSphere();
  const MeshLook options = smallPicture();
  const glm::vec3 outside = pixelOf(render(sphere, options), 160, 120);
  for (std::size_t i = 0; i < sphere.triangles.size(); i += 3) {
    std::swap(sphere.triangles[i], sphere.triangles[i + 1]);
  }
  const glm::vec3 inside = pixelOf(render(sphere, options), 160, 120);
  EXPECT_LT(luminance(inside), 0.3f * luminance(outside));
  EXPECT_GT(inside.r, 2.0f * inside.b);
  EXPECT_LT(outside.r, 1.5f * outside.b);

  // Normals that point inwards do not make it look right again.
  for (glm::vec3& normal : sphere.normals) normal = -normal;
  EXPECT_LT(luminance(pixelOf(render(sphere, options), 160, 120)), 0.3f * luminance(outside));
}

TEST_F(RenderTest, NormalsCanBeLeftToTheFacets) {
  const OwnedMesh sphere = unitSphere();
  const MeshLook options = smallPicture();
  const Image smooth = render(sphere, options);
  const Image facets = test::pictureOf(
      *renderer_, test::surfaceOf(sphere.positions, {}, sphere.triangles, {}), options);
  EXPECT_LT(glm::distance(pixelOf(smooth, 160, 120), pixelOf(facets, 160, 120)), 0.02f);
}

TEST_F(RenderTest, EachTriangleHasTheColorOfItsLevel) {
  OwnedMesh sphere = unitSphere();
  MeshLook options = smallPicture();
  options.view.camera.azimuth = options.view.camera.elevation = 0.0;
  const Image plain = render(sphere, options);
  // One level for the upper half, another for the lower: rings run from the top.
  for (std::size_t i = 0; i < sphere.levels.size(); ++i) {
    sphere.levels[i] = i < sphere.levels.size() / 2 ? 0 : 5;
  }
  EXPECT_EQ(render(sphere, options).rgb, plain.rgb);
  options.view.coloring = ViewColoring::kLevel;
  const Image levels = render(sphere, options);
  EXPECT_EQ(hueOf(pixelOf(levels, 160, 80)), 'r');
  EXPECT_EQ(hueOf(pixelOf(levels, 160, 160)), 'b');
  // A hard change between the middle rows: nothing is interpolated between levels.
  EXPECT_EQ(hueOf(pixelOf(levels, 160, 117)), 'r');
  EXPECT_EQ(hueOf(pixelOf(levels, 160, 122)), 'b');

  std::fill(sphere.levels.begin(), sphere.levels.end(), std::uint8_t{20});
  EXPECT_EQ(hueOf(pixelOf(render(sphere, options), 160, 120)), hueOf(levelColor(20)));
}

TEST_F(RenderTest, WireframeDarkensEdgesAndLeavesTheRest) {
  const OwnedMesh sphere = unitSphere(12, 24);
  MeshLook options = smallPicture();
  const Image plain = render(sphere, options);
  options.view.wireframe = true;
  const Image wires = render(sphere, options);
  int darker = 0, equal = 0, brighter = 0;
  for (int y = 60; y < 180; ++y) {
    for (int x = 100; x < 220; ++x) {
      const float ratio = luminance(pixelOf(wires, x, y)) / luminance(pixelOf(plain, x, y));
      if (ratio < 0.7f) ++darker;
      if (std::abs(ratio - 1.0f) < 1e-3f) ++equal;
      if (ratio > 1.01f) ++brighter;
    }
  }
  EXPECT_GT(darker, 120 * 120 / 20);
  EXPECT_GT(equal, 120 * 120 / 2);
  EXPECT_EQ(brighter, 0);
  // Triangles smaller than the lines must not turn the surface black.
  const OwnedMesh fine = unitSphere(500, 1000);
  const Image fine_wires = render(fine, options);
  options.view.wireframe = false;
  EXPECT_GT(meanLuminance(fine_wires), 0.8 * meanLuminance(render(fine, options)));
}

TEST_F(RenderTest, FocusSphereIsACircleOfItsProjectedSize) {
  MeshLook options;
  options.width = options.height = 400;
  options.view.camera = lookingAt({0.0, -5.0, 0.0}, {0.0, 0.0, 0.0});
  options.is_placed = true;
  const OwnedMesh sphere = unitSphere();
  const Image without = render(sphere, options);
  options.view.focus.show_sphere = true;
  options.view.focus.radius = 0.5;
  const Silhouette circle = silhouetteOf(render(sphere, options), without);
  const double focal = 200.0 / std::tan(15.0 * std::numbers::pi / 180.0);
  const double diameter = 2.0 * focal * std::tan(std::asin(0.5 / 5.0));
  EXPECT_NEAR(circle.right - circle.left + 1, diameter, 8.0);  // and the width of the line
  EXPECT_NEAR(circle.bottom - circle.top + 1, diameter, 8.0);
  EXPECT_LT(circle.pixels, 8.0 * std::numbers::pi * diameter);  // thin
  options.view.focus.radius = 6.0;                              // the eye is inside: no outline
  EXPECT_EQ(render(sphere, options).rgb, without.rgb);
}

TEST_F(RenderTest, TheSameCallGivesTheSamePicture) {
  const OwnedMesh sphere = unitSphere(500, 600);
  MeshLook options = smallPicture();
  options.view.wireframe = true;
  const Image first = render(sphere, options);
  options.width = 100;
  render(sphere, options);  // another size in between
  options.width = 320;
  EXPECT_EQ(render(sphere, options).rgb, first.rgb);
  OffscreenRenderer other;
  EXPECT_EQ(test::pictureOf(other, sphere.surface(), options).rgb, first.rgb);
}

TEST_F(RenderTest, RenderersWorkSideBySideAndChangeThreads) {
  const OwnedMesh sphere = unitSphere();
  const MeshLook options = smallPicture();
  const Image expected = render(sphere, options);
  std::vector<Image> images(2);
  std::thread borrows([&] { images[0] = render(sphere, options); });
  std::thread owns([&] {
    OffscreenRenderer other;
    images[1] = test::pictureOf(other, sphere.surface(), options);
  });
  borrows.join();
  owns.join();
  EXPECT_EQ(images[0].rgb, expected.rgb);
  EXPECT_EQ(images[1].rgb, expected.rgb);
  EXPECT_EQ(render(sphere, options).rgb, expected.rgb);
}

TEST_F(RenderTest, DegenerateMeshesAreDrawnAsFarAsTheyGo) {
  const MeshLook options = smallPicture();
  OwnedMesh mesh;
  EXPECT_EQ(render(mesh, options).rgb.size(), std::size_t{320 * 240 * 3});
  mesh.positions.assign(3, glm::vec3(5.0f));
  mesh.normals.assign(3, glm::vec3(0.0f));
  mesh.triangles = {0, 1, 2};
  const Image image = render(mesh, options);
  EXPECT_TRUE(std::all_of(image.rgb.begin(), image.rgb.end(),
                          [](float value) { return std::isfinite(value); }));
}

TEST_F(RenderTest, ImpossibleViewsAreRefused) {
  const OwnedMesh sphere = unitSphere(8, 16);
  const auto refuses = [&](const auto& change) {
    MeshLook options = smallPicture();
    change(options);
    EXPECT_THROW(render(sphere, options), Error);
  };
  refuses([](MeshLook& o) { o.width = 0; });
  refuses([](MeshLook& o) { o.height = -5; });
  refuses([](MeshLook& o) { o.width = kMostPictureSide + 1; });
  refuses([](MeshLook& o) { o.view.camera.vertical_fov = 0.0; });
  refuses([](MeshLook& o) { o.view.camera.vertical_fov = std::nan(""); });
  EXPECT_NO_THROW(render(sphere, smallPicture()));
}

// ------------------------------------------------------------------------------------------ files

class ImageFileTest : public ::testing::Test {
 protected:
  bool folderIsEmpty() const { return fs::is_empty(folder_); }

  test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.path();
};

// All of 0..1, and values that a screen cannot show.
Image testPicture() {
  Image image{61, 37, {}};
  for (int i = 0; i < 61 * 37 * 3; ++i) {
    image.rgb.push_back(static_cast<float>(i % 1009) / 1000.0f - 0.004f);
  }
  image.rgb[0] = 37.5f;
  image.rgb[1] = -2.0f;
  return image;
}

TEST_F(ImageFileTest, PngHoldsTheScreenValues) {
  const Image image = testPicture();
  const fs::path path = folder_ / "picture.PNG";
  writeImage(path, image);

  png_image read{};
  read.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_file(&read, path.c_str())) << read.message;
  EXPECT_EQ(read.width, 61u);
  EXPECT_EQ(read.height, 37u);
  EXPECT_EQ(read.format, png_uint_32{PNG_FORMAT_RGB});
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(read));
  ASSERT_TRUE(png_image_finish_read(&read, nullptr, pixels.data(), 0, nullptr)) << read.message;
  std::vector<std::uint8_t> expected(image.rgb.size());
  std::transform(image.rgb.begin(), image.rgb.end(), expected.begin(), toSrgb8);
  EXPECT_EQ(pixels, expected);
  EXPECT_EQ(pixels[0], 255);
  EXPECT_EQ(pixels[1], 0);
}

TEST_F(ImageFileTest, ScreenValuesSurviveTheWayThroughLinearLight) {
  std::vector<std::uint8_t> bytes(256 * 3);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i);
  const Image image = imageFromSrgb8(16, 16, bytes);
  for (std::size_t i = 0; i < bytes.size(); ++i) EXPECT_EQ(toSrgb8(image.rgb[i]), bytes[i]);
}

TEST_F(ImageFileTest, ExrHoldsLinearLightInHalfPrecision) {
  const Image image = testPicture();
  const fs::path path = folder_ / "picture.exr";
  writeImage(path, image);

  Imf::RgbaInputFile file(path.c_str());
  const Imath::Box2i window = file.dataWindow();
  ASSERT_EQ(window.max.x - window.min.x + 1, 61);
  ASSERT_EQ(window.max.y - window.min.y + 1, 37);
  EXPECT_EQ(file.channels(), Imf::WRITE_RGB);
  std::vector<Imf::Rgba> pixels(61 * 37);
  file.setFrameBuffer(pixels.data(), 1, 61);
  file.readPixels(0, 36);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    EXPECT_EQ(static_cast<float>(pixels[i].r), static_cast<float>(half(image.rgb[3 * i])));
    EXPECT_EQ(static_cast<float>(pixels[i].g), static_cast<float>(half(image.rgb[3 * i + 1])));
    EXPECT_EQ(static_cast<float>(pixels[i].b), static_cast<float>(half(image.rgb[3 * i + 2])));
  }
}

TEST_F(ImageFileTest, BothFormatsHoldTheSizeOfAPrint) {
  Image image = testPicture();
  image.pixels_per_inch = 300.0;
  writeImage(folder_ / "print.exr", image);
  const Imf::RgbaInputFile file((folder_ / "print.exr").c_str());
  ASSERT_TRUE(Imf::hasXDensity(file.header()));
  EXPECT_EQ(Imf::xDensity(file.header()), 300.0f);
  // Other programs read the picture as before, and the size by libpng.
  const std::vector<char> encoded = encodeImage(ImageFormat::kPng, image);
  std::FILE* const bytes = fmemopen(const_cast<char*>(encoded.data()), encoded.size(), "rb");
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, bytes);
  png_read_png(png, info, PNG_TRANSFORM_IDENTITY, nullptr);
  EXPECT_EQ(png_get_x_pixels_per_meter(png, info), 11811u);
  EXPECT_EQ(png_get_y_pixels_per_meter(png, info), 11811u);
  EXPECT_EQ(png_get_image_width(png, info), 61u);
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(bytes);
}

TEST_F(ImageFileTest, ExrHoldsAlphaDepthAndNormals) {
  Image image = testPicture();
  const std::size_t count = 61 * 37;
  for (std::size_t i = 0; i < count; ++i) {
    image.alpha.push_back(static_cast<float>(i % 11) / 10.0f);
    image.depth.push_back(i % 7 == 0 ? std::numeric_limits<float>::infinity()
                                     : 1234.5678f + static_cast<float>(i));
    for (int c = 0; c < 3; ++c) image.normals.push_back(0.25f * static_cast<float>(c) - 0.3f);
  }
  const fs::path path = folder_ / "layers.exr";
  writeImage(path, image);
  Imf::InputFile file(path.c_str());
  const Imath::Box2i window = file.header().dataWindow();
  EXPECT_EQ(window, Imath::Box2i({0, 0}, {60, 36}));
  std::vector<std::string> names;
  for (auto channel = file.header().channels().begin(); channel != file.header().channels().end();
       ++channel)
    names.emplace_back(channel.name());
  EXPECT_EQ(names, (std::vector<std::string>{"A", "B", "G", "N.X", "N.Y", "N.Z", "R", "Z"}));
  EXPECT_EQ(file.header().channels().findChannel("Z")->type, Imf::FLOAT);
  EXPECT_EQ(file.header().channels().findChannel("N.X")->type, Imf::HALF);
  // As floats, whatever they are in the file.
  std::map<std::string, std::vector<float>> read;
  Imf::FrameBuffer frame;
  for (const std::string& name : names) {
    read[name].resize(count);
    frame.insert(name, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(read[name].data()),
                                  sizeof(float), 61 * sizeof(float)));
  }
  file.setFrameBuffer(frame);
  file.readPixels(0, 36);
  EXPECT_EQ(read["Z"], image.depth);
  for (std::size_t i = 0; i < count; ++i) {
    EXPECT_EQ(read["G"][i], static_cast<float>(half(image.rgb[3 * i + 1])));
    EXPECT_EQ(read["A"][i], static_cast<float>(half(image.alpha[i])));
    EXPECT_EQ(read["N.Z"][i], static_cast<float>(half(image.normals[3 * i + 2])));
  }
}

TEST_F(ImageFileTest, PngHoldsAlphaBesideTheWholeColour) {
  Image image{3, 1, {0.5f, 0.25f, 0.0f, 0.1f, 0.2f, 0.3f, 0.0f, 0.0f, 0.0f}};
  image.alpha = {0.5f, 1.0f, 0.0f};
  const fs::path path = folder_ / "alpha.png";
  writeImage(path, image);
  png_image read{};
  read.version = PNG_IMAGE_VERSION;
  ASSERT_TRUE(png_image_begin_read_from_file(&read, path.c_str())) << read.message;
  EXPECT_EQ(read.format, png_uint_32{PNG_FORMAT_RGBA});
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(read));
  ASSERT_TRUE(png_image_finish_read(&read, nullptr, pixels.data(), 0, nullptr)) << read.message;
  EXPECT_EQ(pixels, (std::vector<std::uint8_t>{255, toSrgb8(0.5f), 0, 128, toSrgb8(0.1f),
                                               toSrgb8(0.2f), toSrgb8(0.3f), 255, 0, 0, 0, 0}));
}

TEST_F(ImageFileTest, AFinishedFileReplacesTheOldOneAndIsAlone) {
  const fs::path path = folder_ / "picture.png";
  writeImage(path, testPicture());
  const auto first_size = fs::file_size(path);
  writeImage(path, Image{1, 1, {0.5f, 0.5f, 0.5f}});
  EXPECT_LT(fs::file_size(path), first_size);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);
}

TEST_F(ImageFileTest, FailuresNameThePathAndLeaveNothingBehind) {
  for (const char* name : {"picture.jpg", "picture", "png", "picture.png.gz"}) {
    try {
      writeImage(folder_ / name, testPicture());
      ADD_FAILURE() << name;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  }
  for (const char* name : {"missing/picture.png", "missing/picture.exr"}) {
    try {
      writeImage(folder_ / name, testPicture());
      ADD_FAILURE() << name;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
    }
  }
  EXPECT_TRUE(folderIsEmpty());
}

TEST_F(ImageFileTest, AFolderInTheWayIsAnErrorAndStays) {
  const fs::path path = folder_ / "taken.png";
  fs::create_directory(path);
  EXPECT_THROW(writeImage(path, testPicture()), Error);
  EXPECT_TRUE(fs::is_directory(path));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);
}

}  // namespace
}  // namespace isobrick
