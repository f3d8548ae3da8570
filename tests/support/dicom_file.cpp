#include "tests/support/dicom_file.h"

#include <gdcmImageWriter.h>

#include <stdexcept>
#include <utility>

namespace isobrick::test {
namespace {

// Text of an even number of bytes, as DICOM wants it; UIDs are padded with 0, other text by spaces.
void setText(gdcm::DataSet& data, const gdcm::Tag& tag, gdcm::VR::VRType type, std::string text) {
  if (text.size() % 2 == 1) text += type == gdcm::VR::UI ? '\0' : ' ';
  gdcm::DataElement element(tag);
  element.SetVR(type);
  element.SetByteValue(text.data(), gdcm::VL(static_cast<std::uint32_t>(text.size())));
  data.Replace(element);
}

}  // namespace

void writeDicomSlice(const std::string& path, const DicomSliceFile& slice) {
  gdcm::ImageWriter writer;
  gdcm::Image& image = writer.GetImage();
  image.SetNumberOfDimensions(2);
  const std::int64_t dims[2] = {slice.columns, slice.rows};
  for (unsigned axis = 0; axis < 2; ++axis) {
    image.SetDimension(axis, static_cast<unsigned>(dims[axis]));
    image.SetSpacing(axis, slice.pixel_spacing[static_cast<int>(axis)]);
  }
  image.SetSpacing(2, slice.thickness);
  const glm::dvec3 &u = slice.row_axis, &v = slice.column_axis;
  const double cosines[6] = {u.x, u.y, u.z, v.x, v.y, v.z};
  image.SetDirectionCosines(cosines);
  // One by one: all at once, GDCM takes as many as the image has dimensions.
  for (unsigned axis = 0; axis < 3; ++axis)
    image.SetOrigin(axis, slice.position[static_cast<int>(axis)]);
  image.SetPixelFormat(gdcm::PixelFormat::INT16);
  image.SetPhotometricInterpretation(gdcm::PhotometricInterpretation::MONOCHROME2);
  image.SetTransferSyntax(gdcm::TransferSyntax::ExplicitVRLittleEndian);
  image.SetIntercept(slice.intercept);
  image.SetSlope(slice.slope);
  gdcm::DataElement pixels(gdcm::Tag(0x7fe0, 0x0010));
  pixels.SetVR(gdcm::VR::OW);
  pixels.SetByteValue(reinterpret_cast<const char*>(slice.pixels.data()),
                      gdcm::VL(static_cast<std::uint32_t>(2 * slice.pixels.size())));
  image.SetDataElement(pixels);

  gdcm::DataSet& data = writer.GetFile().GetDataSet();
  using gdcm::VR;
  const std::string instance = std::to_string(slice.instance);
  setText(data, {0x0008, 0x0016}, VR::UI, "1.2.840.10008.5.1.4.1.1.2");  // CT Image Storage
  setText(data, {0x0008, 0x0018}, VR::UI, slice.series_uid + "." + instance);
  setText(data, {0x0008, 0x0060}, VR::CS, "CT");
  setText(data, {0x0028, 0x0004}, VR::CS, "MONOCHROME2");
  setText(data, {0x0010, 0x0010}, VR::PN, "Phantom^Head");
  setText(data, {0x0020, 0x000d}, VR::UI, "1.2.826.0.1.3680043.2.1125.1");
  setText(data, {0x0020, 0x000e}, VR::UI, slice.series_uid);
  setText(data, {0x0020, 0x0013}, VR::IS, instance);
  writer.SetFileName(path.c_str());
  if (!writer.Write()) throw std::runtime_error("GDCM cannot write " + path);
}

void writeDicomSeries(const std::string& folder, const Index3& voxels,
                      const std::vector<std::int16_t>& values, const glm::dvec3& spacing,
                      const glm::dvec3& origin, double intercept) {
  DicomSliceFile slice;
  slice.columns = voxels.x;
  slice.rows = voxels.y;
  slice.pixel_spacing = {spacing.x, spacing.y};
  slice.thickness = spacing.z;
  slice.intercept = intercept;
  const auto pixels = static_cast<std::ptrdiff_t>(voxels.x * voxels.y);
  for (std::int64_t k = 0; k < voxels.z; ++k) {
    slice.pixels.assign(values.begin() + k * pixels, values.begin() + (k + 1) * pixels);
    for (std::int16_t& pixel : slice.pixels)
      pixel = static_cast<std::int16_t>(static_cast<double>(pixel) - intercept);
    slice.position = origin + glm::dvec3(0, 0, static_cast<double>(k) * spacing.z);
    slice.instance = static_cast<int>(k) + 1;
    writeDicomSlice(folder + "/slice." + std::to_string(1001 + k) + ".dcm", slice);
  }
}

}  // namespace isobrick::test
