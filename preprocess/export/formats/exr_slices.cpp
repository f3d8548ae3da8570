#include <ImathMatrix.h>
#include <ImathVec.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVecAttribute.h>
#include <half.h>

#include <algorithm>
#include <vector>

#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Halves hold whole numbers up to 2048, floats those of 16 bits.
Imf::PixelType pixelTypeOf(VoxelType type) {
  if (voxelBytes(type) == 1) return Imf::HALF;
  return type == VoxelType::kUint16 ? Imf::UINT : Imf::FLOAT;
}

Imf::Header headerOf(const VolumeInfo& info) {
  const GridGeometry& geometry = info.geometry;
  Imf::Header header(static_cast<int>(info.voxels.x), static_cast<int>(info.voxels.y),
                     static_cast<float>(geometry.spacing.x / geometry.spacing.y));
  header.compression() = Imf::ZIP_COMPRESSION;
  header.channels().insert("Y", Imf::Channel(pixelTypeOf(info.voxel_type)));
  const auto vectorOf = [](const glm::dvec3& v) { return Imath::V3d(v.x, v.y, v.z); };
  Imath::M33d direction;  // a row for each axis
  for (int axis = 0; axis < 3; ++axis)
    for (int row = 0; row < 3; ++row) direction[axis][row] = geometry.direction[axis][row];
  header.insert("isobrickType", Imf::StringAttribute(std::string(voxelTypeName(info.voxel_type))));
  header.insert("isobrickSpace", Imf::StringAttribute("LPS"));
  header.insert("isobrickLengthUnit",
                Imf::StringAttribute(std::string(lengthUnitName(geometry.unit))));
  header.insert("isobrickSpacing", Imf::V3dAttribute(vectorOf(geometry.spacing)));
  header.insert("isobrickOrigin", Imf::V3dAttribute(vectorOf(geometry.origin)));
  header.insert("isobrickDirection", Imf::M33dAttribute(direction));
  return header;
}

// A pixel for every voxel.
template <typename Pixel>
void writePicture(const std::string& path, const VolumeInfo& info, const std::byte* slice) {
  const auto count = static_cast<std::size_t>(info.voxels.x * info.voxels.y);
  std::vector<Pixel> pixels(count);
  visitVoxelType(info.voxel_type, [&](auto tag) {
    using T = typename decltype(tag)::Type;
    const T* const from = reinterpret_cast<const T*>(slice);
    std::transform(from, from + count, pixels.begin(), [](T value) {
      if constexpr (std::is_same_v<Pixel, std::uint32_t>)
        return static_cast<std::uint32_t>(value);
      else
        return Pixel(static_cast<float>(value));
    });
  });
  const Imf::Header header = headerOf(info);
  Imf::OutputFile file(path.c_str(), header, 0);
  Imf::FrameBuffer buffer;
  buffer.insert("Y", Imf::Slice::Make(pixelTypeOf(info.voxel_type), pixels.data(),
                                      header.dataWindow(), sizeof(Pixel),
                                      static_cast<std::size_t>(info.voxels.x) * sizeof(Pixel)));
  file.setFrameBuffer(buffer);
  file.writePixels(static_cast<int>(info.voxels.y));
}

}  // namespace

VolumeWriteReport writeExrSlices(VolumeLevels& levels, const std::string& path,
                                 const ExportOptions& options) {
  const VolumeInfo& info = levels.front()->info();
  VolumeWriteReport report =
      writeSlices(levels, path, options, [&](const std::string& file, const std::byte* slice) {
        try {
          switch (pixelTypeOf(info.voxel_type)) {
            case Imf::HALF:
              return writePicture<Imath::half>(file, info, slice);
            case Imf::UINT:
              return writePicture<std::uint32_t>(file, info, slice);
            default:
              return writePicture<float>(file, info, slice);
          }
        } catch (const std::exception& failure) {
          throw ResumableError("cannot write '" + path + "': OpenEXR reports '" +
                                   std::string(failure.what()) +
                                   "'; free some space or choose another folder",
                               {.path = path});
        }
      });
  report.space = "LPS";
  report.lost.push_back(
      "OpenEXR pictures have no spacing, origin and direction; they are kept in attributes of "
      "isobrick's own");
  return report;
}

}  // namespace isobrick
