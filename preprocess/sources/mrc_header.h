// What MRC headers say beyond what ITK takes from them. Private to preprocess/sources/.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "isobrick/storage/grid.h"

namespace isobrick {

class MrcHeader {
 public:
  explicit MrcHeader(const std::string& path);

  // Throws Error if the file ends before its voxels do, which ITK does not notice.
  void checkBytes(std::uint64_t voxel_bytes) const;

  // From the file's axes for x, y and z, as ITK has it, to those that the header names. Throws
  // Error if it names one twice.
  void turnAxes(GridGeometry& geometry) const;

  // MRC's lengths are ångströms; without any ITK makes them 1.
  std::string unit() const;

  // Whether voxels of one byte, which ITK takes for unsigned, have a sign: by the flags of IMOD, or
  // by the standard of 2014. Older headers do not say.
  bool hasSignedBytes() const;

 private:
  std::int32_t number(std::size_t at) const;

  std::string path_;
  std::uint64_t file_bytes_ = 0;
  std::array<char, 1024> bytes_ = {};
};

}  // namespace isobrick
