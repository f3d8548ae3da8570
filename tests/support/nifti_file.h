// NIfTI files for tests.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <glm/vec3.hpp>
#include <string>

#include "isobrick/storage/grid.h"

namespace isobrick::test {

// A NIfTI-1 header with the four bytes that say that it has no extension.
struct NiftiFields {
  std::int16_t data_type = 4, bits = 16;
  float slope = 0, intercept = 0, offset = 352;
  const char* magic = "n+1";  // "ni1" where the voxels are in a file of their own
  glm::vec3 spacing{1.0f};
};
inline std::string niftiHeader(const Index3& voxels, const NiftiFields& fields, bool big_endian) {
  std::string header(352, '\0');
  const auto put = [&](std::size_t at, auto value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    if (big_endian) std::reverse(bytes, bytes + sizeof value);
    std::copy_n(bytes, sizeof value, header.begin() + static_cast<std::ptrdiff_t>(at));
  };
  put(0, std::int32_t{348});
  std::int16_t dims[8] = {3, 0, 0, 0, 1, 1, 1, 1};
  for (int axis = 0; axis < 3; ++axis) dims[1 + axis] = static_cast<std::int16_t>(voxels[axis]);
  for (std::size_t i = 0; i < 8; ++i) put(40 + 2 * i, dims[i]);
  put(70, fields.data_type);
  put(72, fields.bits);
  for (std::size_t i = 0; i < 8; ++i)
    put(76 + 4 * i, i >= 1 && i <= 3 ? fields.spacing[static_cast<int>(i) - 1] : 1.0f);
  // An sform that is the identity in LPS.
  put(254, std::int16_t{1});
  for (int axis = 0; axis < 3; ++axis)
    put(280 + 20 * static_cast<std::size_t>(axis), (axis < 2 ? -1 : 1) * fields.spacing[axis]);
  put(108, fields.offset);
  put(112, fields.slope);
  put(116, fields.intercept);
  header.replace(344, 3, fields.magic);
  return header;
}

}  // namespace isobrick::test
