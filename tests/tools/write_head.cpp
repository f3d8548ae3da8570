// Writes the head phantom, slice by slice, in formats that `isobrick phantom` does not write:
//
//   write_head gzip|dicom SIZE FILE_OR_FOLDER
//
// gzip is an NRRD file of uint16, dicom a series of int16 with the intercept -1024 in a folder that
// exists. For tests that need a volume of any size.
#include <zlib.h>

#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "tests/support/dicom_file.h"

namespace isobrick::test {
namespace {

using Slice = std::vector<std::uint16_t>;

// Calls use(k, slice) for all slices in order.
template <typename F>
void forEachSlice(VolumeSource& source, F&& use) {
  const Index3 voxels = source.info().voxels;
  Slice slice(static_cast<std::size_t>(voxels.x * voxels.y));
  for (std::int64_t k = 0; k < voxels.z; ++k) {
    source.readRows(k * voxels.y, voxels.y, slice.data());
    use(k, slice);
  }
}

void writeGzip(VolumeSource& source, const std::string& path) {
  const std::string size = std::to_string(source.info().voxels.x);
  std::ofstream(path, std::ios::binary)
      << "NRRD0004\ntype: uint16\ndimension: 3\nsizes: " << size << ' ' << size << ' ' << size
      << "\nendian: little\nencoding: gzip\n\n";
  const gzFile out = gzopen(path.c_str(), "ab1");  // the fastest level
  if (out == nullptr) throw std::runtime_error("cannot append to " + path);
  bool is_written = true;
  forEachSlice(source, [&](std::int64_t, const Slice& slice) {
    const auto bytes = static_cast<unsigned>(slice.size() * sizeof slice[0]);
    is_written = gzwrite(out, slice.data(), bytes) == static_cast<int>(bytes) && is_written;
  });
  if (gzclose(out) != Z_OK || !is_written) throw std::runtime_error("cannot write " + path);
}

void writeDicom(VolumeSource& source, const std::string& folder) {
  DicomSliceFile file;
  file.columns = source.info().voxels.x;
  file.rows = source.info().voxels.y;
  file.intercept = -1024;
  forEachSlice(source, [&](std::int64_t k, const Slice& slice) {
    file.pixels.assign(slice.begin(), slice.end());
    file.position.z = static_cast<double>(k);
    file.instance = static_cast<int>(k) + 1;
    writeDicomSlice(folder + "/" + std::to_string(k) + ".dcm", file);
  });
}

void run(const std::string& format, const std::string& size, const std::string& path) {
  PhantomSpec spec;
  spec.name = "head";
  spec.size = std::stoll(size);
  const auto source = makePhantomSource(spec);
  if (format == "gzip")
    writeGzip(*source, path);
  else if (format == "dicom")
    writeDicom(*source, path);
  else
    throw std::runtime_error("no such format: " + format);
}

}  // namespace
}  // namespace isobrick::test

int main(int argc, char** argv) {
  try {
    if (argc != 4) throw std::runtime_error("write_head gzip|dicom SIZE FILE_OR_FOLDER");
    isobrick::test::run(argv[1], argv[2], argv[3]);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "write_head: %s\n", error.what());
    return 1;
  }
}
