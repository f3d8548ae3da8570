// Folders of DICOM slices of our own.
#include "tests/support/dicom_file.h"
#include "tests/support/dicom_folder_tests.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

constexpr Index3 kSlice(40, 30, 1);
constexpr int kFirst = 1600;

std::string ownSlice(int number) {
  DicomSliceFile slice;
  slice.columns = kSlice.x;
  slice.rows = kSlice.y;
  slice.position = {-20, -15, number - 1};
  slice.intercept = -1024;
  slice.instance = number;
  for (std::int64_t i = 0; i < elementCount(kSlice); ++i)
    slice.pixels.push_back(static_cast<std::int16_t>((i * 37 + number * 101) % 3000));
  const TemporaryFolder folder;
  writeDicomSlice(folder.file("slice.dcm"), slice);
  return readBytes(folder.file("slice.dcm"));
}

INSTANTIATE_TEST_SUITE_P(Own, DicomFolder,
                         testing::Values(DicomSlices{"Own", kFirst, kSlice, kFirst - 1,
                                                     DicomSliceFile().series_uid, ownSlice}),
                         testing::PrintToStringParamName());

}  // namespace
}  // namespace isobrick::test
