// Sound files that are refused say so, and what to do, in the words of docs/LIMITS.md.
#include <fstream>
#include <functional>
#include <map>
#include <regex>
#include <string>
#include <vector>

#include "tests/support/mrc_file.h"
#include "tests/support/nifti_file.h"
#include "tests/support/test_paths.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using test::errorOf;

class RefusalsTest : public test::VolumeFilesTest {
 protected:
  std::string nrrd(const std::string& fields, std::size_t bytes) const {
    return write("a.nrrd", "NRRD0004\ndimension: 3\nsizes: 3 3 3\n" + fields + "\n\n" +
                               std::string(bytes, '\1'));
  }
  std::string mrc(std::int32_t mode, float beta) const {
    test::MrcFile file;
    file.mode = mode;
    file.angles[1] = beta;
    return write("a.mrc", file.header() + std::string(96, '\0'));
  }
  std::string nifti(std::int16_t type, std::int16_t bits, float shear) const {
    test::NiftiFields fields;
    fields.data_type = type;
    fields.bits = bits;
    std::string header = test::niftiHeader({3, 3, 3}, fields, false);
    std::memcpy(header.data() + 284, &shear, sizeof shear);  // x of the second axis
    return write("a.nii", header + std::string(27 * static_cast<std::size_t>(bits) / 8, '\0'));
  }
  std::string tiff(std::uint32_t packing, std::uint32_t kind, std::uint32_t bytes) const {
    test::TiffForm form;
    form.packing = packing;
    test::TiffBuilder builder(form);
    for (int page = 0; page < 3; ++page)
      builder.addPage({3, 3, bytes, kind, 1, std::string(9 * bytes, '\1')});
    return write("a.tif", builder.bytes());
  }
  std::string vti() const {
    return write("a.vti", R"(<VTKFile type="ImageData" compressor="vtkOtherCompressor">
        <ImageData WholeExtent="0 2 0 2 0 2"><Piece Extent="0 2 0 2 0 2"><PointData>
        <DataArray type="UInt8" Name="a" format="binary">AAAA</DataArray>
        </PointData></Piece></ImageData></VTKFile>)");
  }
  std::string zarr(const std::string& type, const std::string& compressor,
                   const std::string& filters) const {
    test::fs::create_directories(folder_ / "a.zarr");
    write("a.zarr/.zarray",
          R"({"zarr_format": 2, "shape": [3, 3, 3], "chunks": [3, 3, 3], "dtype": ")" + type +
              R"(", "fill_value": 0, "order": "C", "compressor": )" + compressor +
              R"(, "filters": )" + filters + "}");
    return pathOf("a.zarr");
  }
};

TEST_F(RefusalsTest, SayWhatTheDocumentSays) {
  const std::map<std::string, std::function<std::string()>> files{
      {"NRRD of blocks", [&] { return nrrd("type: block\nblock size: 4\nencoding: raw", 108); }},
      {"MRC of another mode", [&] { return mrc(9, 90); }},
      {"MRC with oblique axes", [&] { return mrc(2, 112); }},
      {"NIfTI with a shear", [&] { return nifti(4, 16, 0.5f); }},
      {"NIfTI of 128-bit floats", [&] { return nifti(1536, 128, 0); }},
      {"TIFF packed as JPEG 2000", [&] { return tiff(34712, 1, 1); }},
      {"TIFF of complex numbers", [&] { return tiff(0, 6, 8); }},
      {"VTI of another compressor", [&] { return vti(); }},
      {"Zarr of another compressor", [&] { return zarr("|u1", R"({"id": "other"})", "null"); }},
      {"Zarr with another filter",
       [&] { return zarr("<f4", "null", R"([{"id": "fixedscaleoffset"}])"); }},
      {"Zarr of texts", [&] { return zarr("<U4", "null", "null"); }}};
  std::ifstream page(test::goldenFolder() + "/../../docs/LIMITS.md");
  const std::regex row(R"(\| ([^|`]+) \| `([^|`]+)` \| `([^|`]+)` \|)");
  std::size_t rows = 0;
  for (std::string line; std::getline(page, line);) {
    std::smatch cells;
    if (!std::regex_match(line, cells, row)) continue;
    const auto file = files.find(cells[1]);
    ASSERT_NE(file, files.end()) << line;
    const std::string path = file->second();
    const std::string message = errorOf([&] { openVolume(path); });
    EXPECT_CONTAINS(message, cells[2].str()) << line;
    EXPECT_CONTAINS(message, cells[3].str()) << line;
    EXPECT_EQ(message.find("damaged"), std::string::npos) << message;
    ++rows;
  }
  EXPECT_EQ(rows, files.size());
}

}  // namespace
}  // namespace isobrick
