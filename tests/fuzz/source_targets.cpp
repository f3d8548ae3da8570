// Volumes and meshes of other programs.
#include <cstdint>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "isobrick/extract/read_mesh_file.h"
#include "isobrick/preprocess/hdf5_handle.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/unpack_block.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/hdf5_file.h"

namespace isobrick::test {
namespace {

// Of larger volumes some voxels are read.
constexpr std::int64_t kMostSourceVoxels = 1 << 17;

void readSome(VolumeSource& source) {
  const Index3 voxels = source.info().voxels;
  for (int axis = 0; axis < 3; ++axis)
    demand(voxels[axis] >= 2 && voxels[axis] <= kMaxVoxelsPerAxis, "axes have voxels");
  const bool is_small = elementCount(voxels) <= kMostSourceVoxels;
  if (is_small) source.chooseVoxels(nullptr, {});
  const std::size_t voxel_bytes = voxelBytes(source.info().voxel_type);
  const auto room = [&](const Index3& count) {
    return std::vector<std::byte>(static_cast<std::size_t>(elementCount(count)) * voxel_bytes);
  };
  if (source.readsBoxes()) {
    const IndexBox box =
        is_small ? IndexBox{Index3(0), voxels} : IndexBox{voxels / Index3(2), Index3(1)};
    source.readBox(box, room(box.count).data());
  }
  const Index3 slice(voxels.x, is_small ? voxels.y : 1, 1);
  std::vector<std::byte> out = room(slice);
  for (std::int64_t z = 0; z < (is_small ? voxels.z : 1); ++z)
    source.readRows(z * voxels.y, slice.y, out.data());
}

// As it comes; and else as a user would try again, who reads that there is a choice.
template <typename Open>
void openAndReadSome(const std::string& path, Open&& open) {
  OpenOptions options;
  options.memory_bytes = std::uint64_t{8} << 20;
  for (int attempt = 0; attempt < 3; ++attempt) try {
      if (attempt > 0) options.image = options.time = options.channel = 0;
      if (attempt == 2) options.component.emplace();
      return readSome(*open(path, options));
    } catch (const Error&) {
      if (attempt == 2) throw;
    }
}

using OpenFile = std::unique_ptr<VolumeSource> (*)(const std::string&, const OpenOptions&);

template <OpenFile kOpen>
void runSource(FuzzBytes bytes, const std::string& name) {
  const FuzzFolder folder(filesOf(bytes), name);
  if (!folder.files().empty()) openAndReadSome(folder.files().front(), kOpen);
}

void runVti(FuzzBytes bytes) { runSource<openVtiSource>(bytes, "a.vti"); }
void runVtk(FuzzBytes bytes) { runSource<openVtiSource>(bytes, "a.vtk"); }
void runNrrd(FuzzBytes bytes) { runSource<openNrrdSource>(bytes, "a.nrrd"); }
void runMetaImage(FuzzBytes bytes) { runSource<openMetaImageSource>(bytes, "a.mha"); }
void runNifti(FuzzBytes bytes) { runSource<openNiftiSource>(bytes, "a.nii"); }
void runMrc(FuzzBytes bytes) { runSource<openMrcSource>(bytes, "a.mrc"); }
void runZip(FuzzBytes bytes) { runSource<openZarrSource>(bytes, "a.zip"); }

std::unique_ptr<VolumeSource> openTiff(const std::string& path, const OpenOptions& options) {
  auto source = openTiffFile(path, options);
  if (source == nullptr) throw Error("no TIFF");
  return source;
}
void runTiff(FuzzBytes bytes) { runSource<openTiff>(bytes, "a.tif"); }

void runZarr(FuzzBytes bytes) {
  const FuzzFolder folder(filesOf(bytes), ".zarray");
  openAndReadSome(folder.path(), openZarrSource);
}

// Without the library that unpacks pixels.
void runDicom(FuzzBytes bytes) {
  const FuzzFolder folder({{"", filesOf(bytes).front().bytes}}, "a.dcm");
  const std::string& path = folder.files().front();
  const DicomHeader header = readDicomHeader(path);
  if (header.state != DicomHeader::State::kImage || !faultOfPixels(header).empty()) return;
  const DicomFile file = dicomFile(path, header);
  demand(file.pixels_at < bytes.size(), "pixels lie in their file");
  arrangeDicomFrames(path, header, {});
  takeDicomVoxelType({dicomValueMap(header)}, false, *std::make_unique<VolumeInfo>());
}

// HDF5's library trusts its files, so what is made of any bytes is a sound file with hostile
// names, attributes and shapes, by lines: "data NAME TYPE 2,3,4", "text OBJECT NAME VALUE",
// "letters OBJECT NAME VALUE", "numbers OBJECT NAME 1,2,3", "scales OBJECT A B C", "group NAME".
void takeHdf5Line(Hdf5TestFile& file, const std::string& line) {
  std::istringstream words(line);
  std::string kind, object, name, value;
  words >> kind >> object >> name;
  std::getline(words >> std::ws, value);
  std::vector<double> numbers;
  std::istringstream list(value);
  for (std::string word; std::getline(list, word, ',') && numbers.size() < 100;)
    numbers.push_back(std::strtod(word.c_str(), nullptr));
  if (kind == "data") {
    std::vector<std::uint64_t> dims;
    std::uint64_t elements = 1;
    for (const double number : numbers) {
      dims.push_back(number >= 1 && number < 40 ? static_cast<std::uint64_t>(number) : 1);
      if ((elements *= dims.back()) > kMostSourceVoxels) return;
    }
    if (!dims.empty()) file.dataset(object, dims, name, std::string(8 * elements, '\1'));
  } else if (kind == "group") {
    file.group(object);
  } else if (kind == "text") {
    file.text(object, name, value);
  } else if (kind == "letters" && !value.empty()) {
    file.letters(object, name, value);
  } else if (kind == "numbers" && !numbers.empty()) {
    file.numbers(object, name, numbers);
  } else if (kind == "scales") {
    std::istringstream rest(name + " " + value);
    std::vector<std::string> scales;
    for (std::string scale; rest >> scale;) scales.push_back(scale == "-" ? "" : scale);
    file.scales(object, scales);
  }
}

void runHdf5(FuzzBytes bytes) {
  const std::vector<FuzzFile> files = filesOf(bytes);
  const FuzzFolder folder(files, "lines");
  const std::string path = folder.path() + "/a.h5";
  {
    const Hdf5Call silent;
    Hdf5TestFile file(path);
    std::istringstream lines(files.front().bytes);
    int left = 40;
    for (std::string line; std::getline(lines, line) && --left > 0;) try {
        takeHdf5Line(file, line);
      } catch (const std::logic_error&) {  // what no file can have
      } catch (const std::runtime_error&) {
      }
  }
  openAndReadSome(path, openHdf5Source);
}

// The codec, the size in two bytes, and a block.
void runUnpack(FuzzBytes bytes) {
  if (bytes.size() < 3) return;
  std::vector<std::byte> out(8u * (bytes[1] + 256u * bytes[2]) + bytes[0] / 9u);
  unpackBlock(static_cast<BlockCodec>(bytes[0] % 9), std::as_bytes(bytes.subspan(3)), out);
}

void runMesh(FuzzBytes bytes) {
  const bool is_ply = bytes.size() > 3 && bytes[0] == 'p' && bytes[1] == 'l' && bytes[2] == 'y';
  const FuzzFolder folder({{"", filesOf(bytes).front().bytes}}, is_ply ? "a.ply" : "a.stl");
  const IndexedMesh mesh = readMeshFile(folder.files().front());
  for (const std::uint32_t index : mesh.triangles)
    demand(index < mesh.positions.size(), "triangles have vertices of the mesh");
}

constexpr FuzzTarget kTable[] = {
    {"sources", "zarr", "preprocess/sources/(zarr_(array|source|filters)|unpack_block)", runZarr},
    {"sources", "zip", "preprocess/sources/zarr_store", runZip},
    {"sources", "vti", "preprocess/sources/(vti_|byte_stream|stored_voxels)", runVti},
    {"sources", "vtk", "preprocess/sources/(vti_|byte_stream)", runVtk},
    {"sources", "nrrd", "preprocess/sources/(nrrd|header_text|stored_array|raw_run|byte_stream)",
     runNrrd},
    {"sources", "metaimage", "preprocess/sources/(metaimage|header_text|stored_array)",
     runMetaImage},
    {"sources", "nifti", "preprocess/sources/(nifti|one_grid)", runNifti},
    {"sources", "mrc", "preprocess/sources/mrc", runMrc},
    {"sources", "tiff", "preprocess/sources/tiff", runTiff},
    {"sources", "dicom", "preprocess/sources/dicom", runDicom},
    {"sources", "hdf5", "preprocess/sources/hdf5", runHdf5},
    {"sources", "unpack", "preprocess/sources/unpack_block", runUnpack},
    {"sources", "mesh", "extract/read_mesh_file", runMesh},
};

}  // namespace

constinit const std::span<const FuzzTarget> kSourceTargets = kTable;

}  // namespace isobrick::test
