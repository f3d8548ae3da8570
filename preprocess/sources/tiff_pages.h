// Whether a TIFF file has all of its pages, and what the first says of lengths. Private to
// preprocess/sources/.
#pragma once

#include <glm/vec3.hpp>
#include <string>

namespace isobrick {

// libtiff takes a file that ends within its list of pages as one of fewer pages, and ITK takes all
// pages to be as large as the first and reads beyond those that are not. Throws Error that names
// the file where the list leads out of it or in a circle, or where pages differ; smaller pictures
// beside the pages may. What else is wrong with a page is libtiff's to find.
void checkTiffPages(const std::string& path);

// What the first page says of lengths.
struct TiffResolution {
  int unit = 2;             // 1: none, 2: inch, 3: centimetre
  double x = 0, y = 0;      // pixels a unit; 0: not said
  glm::dvec3 lsm_voxel{0};  // Zeiss LSM: its edges in metres; 0: not said
  std::string description;  // as far as it is no longer than descriptions are
};
// Throws Error that names the file where it ends within the page.
TiffResolution tiffResolutionOf(const std::string& path);

}  // namespace isobrick
