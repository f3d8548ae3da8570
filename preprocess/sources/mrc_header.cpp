#include "isobrick/preprocess/sources/mrc_header.h"

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"

namespace isobrick {

MrcHeader::MrcHeader(const std::string& path) : path_(path) {
  const InputFile file(path);
  file_bytes_ = file.size();
  static_cast<void>(file.readAt(0, bytes_.data(), bytes_.size()));
}

std::int32_t MrcHeader::number(std::size_t at) const {
  constexpr std::size_t kStampAt = 212;
  return loadNumber<std::int32_t>(&bytes_[at], bytes_[kStampAt] == 0x11);
}

void MrcHeader::checkBytes(std::uint64_t voxel_bytes) const {
  constexpr std::size_t kExtensionBytesAt = 92;
  const std::uint64_t before =
      bytes_.size() + static_cast<std::uint32_t>(number(kExtensionBytesAt));
  if (file_bytes_ < before || file_bytes_ - before < voxel_bytes)
    throw unreadable(path_, "it has " + std::to_string(file_bytes_) +
                                " bytes, and its header takes " + std::to_string(before) +
                                " and its voxels " + std::to_string(voxel_bytes) +
                                "; get the whole file again");
}

void MrcHeader::turnAxes(GridGeometry& geometry) const {
  constexpr std::size_t kAxesAt = 64;
  const Index3 axes(number(kAxesAt), number(kAxesAt + 4), number(kAxesAt + 8));
  const GridGeometry before = geometry;
  Index3 uses(0);
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t named = axes[axis] - 1;
    if (named < 0 || named > 2 || uses[static_cast<int>(named)]++ > 0)
      throw unusable(path_, "its axes are not x, y and z in some order; correct its header");
    geometry.spacing[axis] = before.spacing[static_cast<int>(named)];
    geometry.direction[axis] = before.direction[static_cast<int>(named)];
  }
}

std::string MrcHeader::unit() const {
  constexpr std::size_t kCellAt = 40;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (number(kCellAt + 4 * axis) != 0) return "angstrom";
  return "";
}

bool MrcHeader::hasSignedBytes() const {
  constexpr std::size_t kVersionAt = 108, kImodStampAt = 152, kImodFlagsAt = 156;
  constexpr std::int32_t kImodStamp = 1146047817;  // "IMOD" in the file's byte order
  if (number(kImodStampAt) == kImodStamp) return (number(kImodFlagsAt) & 1) != 0;
  return number(kVersionAt) / 10 == 2014;
}

}  // namespace isobrick
