// DICOM slices for tests: CT images as GDCM writes them, uncompressed, the pixels at the end.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick::test {

struct DicomSliceFile {
  std::int64_t columns = 0, rows = 0;
  std::vector<std::int16_t> pixels;  // as stored, columns * rows, x fastest
  glm::dvec3 position{0.0};          // of the first pixel, in mm
  glm::dvec3 row_axis{1, 0, 0}, column_axis{0, 1, 0};
  glm::dvec2 pixel_spacing{1.0};  // in mm, along x and y
  double thickness = 1;           // in mm
  double intercept = 0;           // a value is slope * stored + intercept
  double slope = 1;
  int instance = 1;
  std::string series_uid = "1.2.826.0.1.3680043.2.1125.1.1";
};

// Throws std::runtime_error if the file cannot be written.
void writeDicomSlice(const std::string& path, const DicomSliceFile& slice);

// The volume as one series: slice k goes to FOLDER/slice.K.dcm, K = 1001, 1002, ..., at
// origin + k * spacing.z. `values` are what a reader shall get; stored is value - intercept.
void writeDicomSeries(const std::string& folder, const Index3& voxels,
                      const std::vector<std::int16_t>& values,
                      const glm::dvec3& spacing = {1, 1, 1}, const glm::dvec3& origin = {0, 0, 0},
                      double intercept = -1024);

}  // namespace isobrick::test
