// Folders: a DICOM series, or a stack of 2-D images. Slices are read one file at a time.
#include <algorithm>
#include <cstring>
#include <set>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_series.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_source.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick::itk_detail {
namespace {

// One 2-D file of a series, open.
struct SliceImage {
  itk::ImageIOBase::Pointer image;
  Component component() const { return image->GetComponentType(); }
};

SliceImage openSlice(const std::string& path, const Index3& expected) {
  SliceImage slice{openImage(path)};
  const Index3 voxels = imageVoxels(path, *slice.image);
  if (voxels.z != 1)
    throw unusable(path,
                   "it holds " + std::to_string(voxels.z) +
                       " slices, but the folder is read as a stack of single ones; name that file");
  if (expected.x != 0 && (voxels.x != expected.x || voxels.y != expected.y))
    throw unusable(path, "it has " + std::to_string(voxels.x) + " x " + std::to_string(voxels.y) +
                             " pixels and the first slice " + std::to_string(expected.x) + " x " +
                             std::to_string(expected.y) +
                             "; keep only the slices of one volume in the folder");
  return slice;
}

// A slice as its file has it.
struct SlicePixels {
  std::shared_ptr<std::vector<std::byte>> bytes;
  Component component = Component::UNKNOWNCOMPONENTTYPE;
  std::size_t component_bytes = 0;
};

// Into `buffer`, which may be that of an earlier slice.
SlicePixels decodeSlice(const std::string& path, const Index3& expected,
                        std::shared_ptr<std::vector<std::byte>> buffer) {
  const SliceImage slice = openSlice(path, expected);
  buffer->resize(static_cast<std::size_t>(slice.image->GetImageSizeInBytes()));
  readImageSlices(path, *slice.image, 0, 1, buffer->data());
  return {std::move(buffer), slice.component(), slice.image->GetComponentSize()};
}

bool isInteger(Component component) {
  return component != Component::FLOAT && component != Component::DOUBLE;
}

// Element by element from `component` to `type`; values must fit.
void convertComponents(Component component, const void* in, std::size_t count, VoxelType type,
                       void* out) {
  visitComponent(component, [&](auto in_tag) {
    using In = typename decltype(in_tag)::Type;
    visitVoxelType(type, [&](auto out_tag) {
      using Out = typename decltype(out_tag)::Type;
      if constexpr (std::is_same_v<In, Out>) {
        std::memcpy(out, in, count * sizeof(Out));
      } else {
        const In* const from = static_cast<const In*>(in);
        Out* const to = static_cast<Out*>(out);
        for (std::size_t i = 0; i < count; ++i) to[i] = static_cast<Out>(from[i]);
      }
    });
  });
}

// One slice is held as its file stores it; rows are converted as they are read.
class SliceStackSource final : public VolumeSource {
 public:
  // `slice_bytes`: of a slice as it is stored.
  SliceStackSource(VolumeInfo info, std::vector<std::string> files, std::uint64_t slice_bytes,
                   const CancelFlag* cancel)
      : info_(std::move(info)),
        files_(std::move(files)),
        slice_bytes_(slice_bytes),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count;) {
      const std::int64_t k = row / info_.voxels.y, y = row % info_.voxels.y;
      const std::int64_t rows = std::min(info_.voxels.y - y, first + count - row);
      if (k != slice_) loadSlice(k);
      const auto voxels = static_cast<std::size_t>(rows * info_.voxels.x);
      convertComponents(pixels_.component,
                        pixels_.bytes->data() +
                            static_cast<std::size_t>(y * info_.voxels.x) * pixels_.component_bytes,
                        voxels, info_.voxel_type, to);
      to += voxels * voxelBytes(info_.voxel_type);
      row += rows;
    }
  }

  std::vector<std::string> files() const override { return files_; }
  // ITK's libraries hold the slice too while they decode it, and once more if they rescale it.
  std::uint64_t bufferBytes() const override { return 3 * slice_bytes_; }

 private:
  void loadSlice(std::int64_t k) {
    slice_ = -1;
    const std::string& file = files_[static_cast<std::size_t>(k)];
    auto buffer =
        pixels_.bytes ? std::move(pixels_.bytes) : std::make_shared<std::vector<std::byte>>();
    // A large packed slice takes seconds, and its library does not stop before its end.
    pixels_ = runAbandonable(cancel_, [file, expected = info_.voxels, buffer = std::move(buffer)] {
      return decodeSlice(file, expected, buffer);
    });
    // Nothing is cut off, even if the headers are wrong or the files have changed since.
    const bool is_exact = exactVoxelType(pixels_.component) == info_.voxel_type;
    const bool is_float = info_.voxel_type == VoxelType::kFloat32;
    if (!is_exact && !is_float) checkRange(file, k);
    slice_ = k;
  }

  void checkRange(const std::string& file, std::int64_t k) const {
    const auto misfit = [&](const std::string& what) {
      return Error("cannot read slice " + std::to_string(k) + ", '" + file + "': " + what +
                       "; convert all to one type",
                   {.path = file});
    };
    if (!isInteger(pixels_.component))
      throw misfit("its values are of another type than the first slice's");
    visitComponent(pixels_.component, [&](auto in_tag) {
      using In = typename decltype(in_tag)::Type;
      if constexpr (std::is_integral_v<In>)
        visitVoxelType(info_.voxel_type, [&](auto out_tag) {
          using Out = typename decltype(out_tag)::Type;
          if constexpr (std::is_integral_v<Out>) {
            const auto* values = reinterpret_cast<const In*>(pixels_.bytes->data());
            const auto* end = values + info_.voxels.x * info_.voxels.y;
            const auto* found =
                std::find_if(values, end, [](In v) { return !std::in_range<Out>(v); });
            if (found != end)
              throw misfit("its value " + std::to_string(*found) + " does not fit the " +
                           std::string(voxelTypeName(info_.voxel_type)) + " of the first slice");
          }
        });
    });
  }

  VolumeInfo info_;
  std::vector<std::string> files_;
  std::uint64_t slice_bytes_;
  const CancelFlag* cancel_;
  std::int64_t slice_ = -1;  // the one in pixels_; none is -1
  SlicePixels pixels_;
};

std::vector<std::string> withExtension(const std::vector<std::string>& files,
                                       const std::set<std::string>& extensions) {
  std::vector<std::string> result;
  for (const std::string& file : files)
    if (extensions.contains(lowerExtension(file))) result.push_back(file);
  std::sort(result.begin(), result.end(), numericNameLess);
  return result;
}

std::unique_ptr<VolumeSource> openImageStack(const std::string& folder,
                                             const std::vector<std::string>& files,
                                             const OpenOptions& options,
                                             std::vector<std::string> notes) {
  if (!options.series.empty())
    throw Error("cannot use the folder '" + folder + "': it holds no DICOM series to choose from",
                {.path = folder});
  if (files.size() == 1) return openItkFile(files.front(), options);
  VolumeInfo info;
  info.source = folder;
  info.notes = std::move(notes);
  if (lowerExtension(files.front()) != ".png")
    return openTiffStack(std::move(info), files, options);
  const std::vector<std::string> paths = chooseSlices(files, options, info);
  const SliceImage first = openSlice(paths.front(), Index3(0));
  info.format = "PNG stack";
  info.voxels = imageVoxels(folder, *first.image);
  info.voxels.z = static_cast<std::int64_t>(paths.size());
  checkVoxelCounts(folder, info.voxels);
  info.geometry.spacing = imageGeometry(*first.image).spacing;
  std::vector<std::string> unsaid;  // of a distance that is given
  std::vector<std::string>& distance_notes = options.spacing ? unsaid : info.notes;
  info.geometry.spacing.z = info.geometry.spacing.x;
  distance_notes.emplace_back(kNoSliceDistance);
  tidyGeometry(folder, info.geometry, info.voxels, info.notes);
  const auto exact = exactVoxelType(first.component());
  info.voxel_type = exact ? *exact : VoxelType::kFloat32;
  if (!exact)
    info.notes.push_back(itk::ImageIOBase::GetComponentTypeAsString(first.component()) +
                         " voxels were converted to float32");
  return std::make_unique<SliceStackSource>(std::move(info), paths,
                                            first.image->GetImageSizeInBytes(), options.cancel);
}

// A way to read a folder, and how many slices speak for it.
struct FolderKind {
  const char* name;
  std::int64_t slices;
};

// The kind with the most slices: a stray picture does not decide. A note names the others.
std::size_t mostOf(const std::string& folder, const std::vector<FolderKind>& kinds,
                   std::vector<std::string>& notes) {
  std::size_t most = 0;
  for (std::size_t i = 1; i < kinds.size(); ++i)
    if (kinds[i].slices > kinds[most].slices) most = i;
  if (kinds[most].slices == 0)
    throw Error("cannot read the folder '" + folder +
                    "': it holds neither DICOM files nor TIFF or " +
                    "PNG slices; name a folder that does, or a file",
                {.path = folder});
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    if (i == most || kinds[i].slices == 0) continue;
    const auto counted = [](const FolderKind& kind) {
      return std::to_string(kind.slices) + " " + kind.name +
             (kind.slices == 1 ? " slice" : " slices");
    };
    if (kinds[i].slices == kinds[most].slices)
      throw Error("cannot use the folder '" + folder + "': it holds " + counted(kinds[most]) +
                      " and " + counted(kinds[i]) + "; move one of them to a folder of its own",
                  {.path = folder});
    notes.push_back(counted(kinds[i]) + " in the folder " +
                    (kinds[i].slices == 1 ? "was" : "were") + " left out");
  }
  return most;
}

}  // namespace

std::unique_ptr<VolumeSource> openItkFolder(const std::string& path, const OpenOptions& options) {
  prepareItk();
  std::vector<std::string> files = filesInFolder(path);
  // Names of slice images are no DICOM and may be large: do not scan them.
  const std::vector<std::string> tiffs = withExtension(files, {".tif", ".tiff"});
  const std::vector<std::string> images = withExtension(files, {".png"});
  std::erase_if(files, [&](const std::string& file) {
    return !withExtension({file}, {".tif", ".tiff", ".png"}).empty();
  });
  DicomScan dicom = scanDicom(files, options);
  // A medium keeps its series in folders below, and a list of them here.
  const bool is_medium = std::any_of(files.begin(), files.end(), isDicomDirectory);
  if (dicom.pictures() == 0 && (is_medium || (tiffs.empty() && images.empty())))
    dicom = scanDicom(filesBelowFolder(path), options);
  std::vector<std::string> notes;
  switch (mostOf(path,
                 {{"DICOM", dicom.pictures()},
                  {"TIFF", static_cast<std::int64_t>(tiffs.size())},
                  {"PNG", static_cast<std::int64_t>(images.size())}},
                 notes)) {
    case 0:
      return openDicomSeries(path, std::move(dicom), options, std::move(notes));
    case 1:
      return openImageStack(path, tiffs, options, std::move(notes));
    default:
      return openImageStack(path, images, options, std::move(notes));
  }
}

}  // namespace isobrick::itk_detail
