// Places and values of NIfTI files by the rules of the format.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/nifti_file.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

constexpr Index3 kBox(4, 3, 2);

// Of 24 voxels, 16-bit, in a world of NIfTI (right, anterior, superior).
class NiftiSourceTest : public VolumeFilesTest {
 protected:
  NiftiSourceTest() : header_(niftiHeader(kBox, {.spacing = {0.5f, 0.25f, 2.0f}}, false)) {}

  template <typename T>
  void put(std::size_t at, const std::vector<T>& values) {
    std::memcpy(header_.data() + at, values.data(), values.size() * sizeof(T));
  }
  void setCodes(std::int16_t qform, std::int16_t sform) { put<std::int16_t>(252, {qform, sform}); }
  // Without a turn.
  void setQform(float x, float y, float z) { put<float>(256, {0, 0, 0, x, y, z}); }
  void setSform(const glm::dmat3& steps, const glm::dvec3& origin) {
    std::vector<float> rows;
    for (int row = 0; row < 3; ++row) {
      for (int axis = 0; axis < 3; ++axis) rows.push_back(static_cast<float>(steps[axis][row]));
      rows.push_back(static_cast<float>(origin[row]));
    }
    put(280, rows);
  }
  std::unique_ptr<VolumeSource> open(const OpenOptions& options = {}) const {
    return openVolume(write("scan.nii", header_ + bytesOfValues(voxels_)), options);
  }
  // In LPS.
  void expectSteps(const glm::dmat3& steps, const glm::dvec3& origin) const {
    const GridGeometry geometry = open()->info().geometry;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LT(glm::length(geometry.indexToWorldMatrix()[axis] - steps[axis]), 1e-6) << axis;
    EXPECT_LT(glm::length(geometry.origin - origin), 1e-6);
  }
  std::string notes() const {
    std::string all;
    const auto source = open();
    for (const std::string& note : source->info().notes) all += note + "\n";
    return all;
  }

  std::string header_;
  std::vector<std::int16_t> voxels_ = [] {
    std::vector<std::int16_t> values(24);
    for (std::size_t i = 0; i < 24; ++i) values[i] = static_cast<std::int16_t>(10 * i);
    return values;
  }();
};

TEST_F(NiftiSourceTest, TheSformWinsWhateverTheCodes) {
  const glm::dmat3 sform({0, 0.6, 0}, {-0.7, 0, 0}, {0, 0, 3});
  setSform(sform, {1, 2, 3});
  setQform(-5, -6, 7);
  for (const std::int16_t sform_code : std::vector<std::int16_t>{1, 2, 4})
    for (const std::int16_t qform_code : std::vector<std::int16_t>{0, 1, 2}) {
      setCodes(qform_code, sform_code);
      expectSteps(glm::dmat3({0, -0.6, 0}, {0.7, 0, 0}, {0, 0, 3}), {-1, -2, 3});
      EXPECT_EQ(notes().find("the sform was taken") != std::string::npos, qform_code > 0);
    }
  EXPECT_CONTAINS(notes(), "sform (code 4) and its qform (code 2) put voxels up to");
  for (const std::int16_t qform_code : std::vector<std::int16_t>{1, 3}) {
    setCodes(qform_code, 0);
    expectSteps(glm::dmat3({-0.5, 0, 0}, {0, -0.25, 0}, {0, 0, 2}), {5, 6, 7});
  }
  setCodes(0, 0);  // as nibabel: x from right to left, the middle at 0
  expectSteps(glm::dmat3({0.5, 0, 0}, {0, -0.25, 0}, {0, 0, 2}), {-0.75, 0.25, -1});
  EXPECT_CONTAINS(notes(), "neither sform nor qform");
}

TEST_F(NiftiSourceTest, ReadsAnSformWhoseSizesAreNotThoseOfTheVoxels) {
  setCodes(0, 1);
  setSform(glm::dmat3({0.501, 0, 0}, {0, 0.25, 0}, {0, 0, 2}), {0, 0, 0});  // 0.2 % off
  expectSteps(glm::dmat3({-0.501, 0, 0}, {0, -0.25, 0}, {0, 0, 2}), {0, 0, 0});
  setSform(glm::dmat3({9, 0, 0}, {0, -8, 0}, {0, 0, 7}), {0, 0, 0});
  expectSteps(glm::dmat3({-9, 0, 0}, {0, 8, 0}, {0, 0, 7}), {0, 0, 0});
  put<float>(76, {0, -0.5f, 0, std::numeric_limits<float>::quiet_NaN()});  // sizes of the qform
  setCodes(1, 0);
  setQform(0, 0, 0);
  expectSteps(glm::dmat3({-0.5, 0, 0}, {0, -1, 0}, {0, 0, 1}), {0, 0, 0});
}

TEST_F(NiftiSourceTest, RefusesAShearWithItsFigure) {
  setCodes(1, 1);
  setSform(glm::dmat3({1, 0, 0}, {0, 1, 0}, {0.2, 0, 1}), {0, 0, 0});
  EXPECT_CONTAINS(errorOf([&] { open(); }), "of a voxel from where it has them");
  setSform(glm::dmat3({1, 0, 0}, {0, 1, 0}, {0.002, 0, 1}), {0, 0, 0});
  EXPECT_NO_THROW(open());
}

TEST_F(NiftiSourceTest, ASlopeThatIsNoneScalesNothing) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const float slope : {0.0f, nan, std::numeric_limits<float>::infinity()})
    for (const float intercept : {0.0f, 5.0f, nan}) {
      put<float>(112, {slope, intercept});
      EXPECT_EQ(readVoxels<std::int16_t>(*open()), voxels_) << slope << " " << intercept;
    }
  put<float>(112, {2, nan});
  EXPECT_EQ(readVoxels<float>(*open())[3], 60);
}

// The same volume in both versions, both byte orders, packed and not.
TEST_F(NiftiSourceTest, SecondVersionIsRead) {
  for (const bool big : {false, true}) {
    std::string header(544, '\0');
    const auto add = [&]<typename T>(std::size_t at, const std::vector<T>& values) {
      header.replace(at, values.size() * sizeof(T), bytesOfValues(values, big));
    };
    add(0, std::vector<std::int32_t>{540});
    header.replace(4, 8, std::string("n+2\0\r\n\x1a\n", 8));
    add(12, std::vector<std::int16_t>{4, 16});
    add(16, std::vector<std::int64_t>{4, 4, 3, 2, 2, 1, 1, 1});
    add(104, std::vector<double>{1, 0.5, 0.25, 2, 1, 1, 1, 1});
    add(168, std::vector<std::int64_t>{544});
    add(176, std::vector<double>{2, -1});
    add(344, std::vector<std::int32_t>{1, 1});
    add(376, std::vector<double>{-5, -6, 7});
    add(400, std::vector<double>{0.5, 0, 0, 1, 0, 0.25, 0, 2, 0, 0, 2, 3});
    add(500, std::vector<std::int32_t>{2});
    const std::string bytes =
        header + std::string(48, '\x7f') + bytesOfValues(voxels_, big);  // the second time step
    for (const bool packed : {false, true}) {
      const std::string path =
          packed ? write("two.nii.gz", deflated(bytes, true)) : write("two.nii", bytes);
      OpenOptions options;
      options.time = 1;
      const auto source = openVolume(path, options);
      const GridGeometry& geometry = source->info().geometry;
      EXPECT_EQ(geometry.unit, LengthUnit::kMillimetre);
      EXPECT_EQ(geometry.origin, glm::dvec3(-1, -2, 3));
      EXPECT_EQ(geometry.spacing, glm::dvec3(0.5, 0.25, 2));
      const auto read = readVoxels<float>(*source);
      for (std::size_t i = 0; i < 24; ++i) EXPECT_EQ(read[i], 2 * voxels_[i] - 1);
    }
    // Every prefix of the header is an error.
    for (std::size_t size = 0; size < bytes.size(); size += size < 548 ? 1 : 20)
      EXPECT_CONTAINS(errorOf([&] {
                        OpenOptions options;
                        options.time = 1;
                        readAll(*openVolume(write("cut.nii", bytes.substr(0, size)), options));
                      }),
                      "cut.nii");
  }
}

}  // namespace
}  // namespace isobrick
