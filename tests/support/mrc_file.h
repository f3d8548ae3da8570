// MRC files for tests.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"
#include "tests/support/volume_files.h"

namespace isobrick::test {

struct MrcFile {
  std::int32_t mode = 2;
  Index3 counts{2, 3, 4};                        // of columns, rows, sections
  std::array<std::int32_t, 3> axes{1, 2, 3};     // of the world: along a column, a row, a section
  std::array<float, 3> cell{20, 60, 120};        // in ångströms along x, y and z
  std::array<std::int32_t, 3> samples{2, 3, 4};  // of the cell along x, y and z
  std::array<std::int32_t, 3> starts{0, 0, 0};   // of columns, rows, sections in the cell
  std::array<float, 3> angles{90, 90, 90}, origin{0, 0, 0};
  std::int32_t group = 1, version = 0, imod_stamp = 0, imod_flags = 0;
  bool big_endian = false;

  std::string header() const {
    std::string bytes(1024, '\0');
    const auto put = [&](std::size_t at, auto value) {
      bytes.replace(at, sizeof value, bytesOfValues(std::vector{value}, big_endian));
    };
    put(12, mode);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      put(4 * axis, static_cast<std::int32_t>(counts[static_cast<int>(axis)]));
      put(16 + 4 * axis, starts[axis]);
      put(28 + 4 * axis, samples[axis]);
      put(52 + 4 * axis, angles[axis]);
      put(196 + 4 * axis, origin[axis]);
      put(40 + 4 * axis, cell[axis]);
      put(64 + 4 * axis, axes[axis]);
    }
    put(88, group);
    put(108, version);
    put(152, imod_stamp);
    put(156, imod_flags);
    bytes.replace(208, 4, "MAP ");
    bytes.replace(212, 2, 2, big_endian ? '\x11' : '\x44');
    return bytes;
  }
};

}  // namespace isobrick::test
