// Folders: a DICOM series, or a stack of 2-D images. Slices are read one file at a time.
#include <itkGDCMImageIO.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <glm/geometric.hpp>
#include <map>
#include <set>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_stack.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_source.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick::itk_detail {
namespace {

namespace fs = std::filesystem;

// The kept part of a file's header: thousands of whole ones would be too much.
struct DicomSlice {
  std::string path;
  FileStamp stamp;
  std::string series_uid, series_number, description;
  std::string position, orientation, instance, time;
  std::string grid;  // columns and rows: the same in all slices of a volume
  std::string photometric;
  bool has_pixel_spacing = false;
  std::int64_t frames = 1;
  DicomValueMap values;
};

DicomSlice dicomSlice(const std::string& path, const DicomHeader& header) {
  DicomSlice slice;
  slice.path = path;
  slice.stamp = header.stamp;
  slice.series_uid = header.value(dicom::kSeriesUid);
  slice.series_number = header.value(dicom::kSeriesNumber);
  slice.description = header.value(dicom::kSeriesDescription);
  // An enhanced file of a single frame has these in its groups.
  slice.position = header.value(dicom::kImagePosition, 0);
  slice.orientation = header.value(dicom::kImageOrientation, 0);
  slice.instance = header.value(dicom::kInstanceNumber);
  slice.time = header.value(dicom::kTemporalPosition);
  slice.grid = header.value(dicom::kColumns) + " x " + header.value(dicom::kRows);
  slice.photometric = header.value(dicom::kPhotometricInterpretation);
  slice.has_pixel_spacing = !header.value(dicom::kPixelSpacing, 0).empty() ||
                            !header.value(dicom::kImagerPixelSpacing).empty();
  slice.frames = std::max(std::atoll(header.value(dicom::kNumberOfFrames).c_str()), 1LL);
  slice.values = dicomValueMap(header);
  return slice;
}

struct DicomScan {
  std::vector<DicomSlice> slices;
  std::vector<std::string> damaged;  // files that begin as DICOM and are not whole

  // So that it can be compared with pictures: a file of many frames is many slices.
  std::int64_t pictures() const {
    auto count = static_cast<std::int64_t>(damaged.size());
    for (const DicomSlice& slice : slices) count += std::min(slice.frames, kMaxVoxelsPerAxis);
    return count;
  }
};

// The DICOM images among `files`. Only headers are read.
DicomScan scanDicom(const std::vector<std::string>& files, const OpenOptions& options) {
  DicomScan scan;
  for (std::size_t i = 0; i < files.size(); ++i) {
    options.checkCancel();
    options.report("scanning slices", static_cast<double>(i) / static_cast<double>(files.size()));
    const DicomHeader header = readDicomHeader(files[i]);
    if (header.state == DicomHeader::State::kDamaged) scan.damaged.push_back(files[i]);
    if (header.state == DicomHeader::State::kImage)
      scan.slices.push_back(dicomSlice(files[i], header));
  }
  return scan;
}

// A series as a list of them shows it.
struct DicomSeries {
  std::string uid, number, description, grid;
  std::int64_t slices = 0;

  std::string text() const {
    return (number.empty() ? "(no number)" : number) + " " + quotedText(description, 40) + " (" +
           std::to_string(slices) + (slices == 1 ? " slice of " : " slices of ") + grid + ", UID " +
           (uid.empty() ? "missing" : uid) + ")";
  }
  bool isCalled(const std::string& name) const {
    return name == uid ||
           (!number.empty() && std::atoll(number.c_str()) == std::atoll(name.c_str()) &&
            name.find_first_not_of("0123456789") == std::string::npos);
  }
};

std::vector<DicomSeries> listSeries(const std::vector<DicomSlice>& slices) {
  std::map<std::string, DicomSeries> by_uid;
  for (const DicomSlice& slice : slices) {
    DicomSeries& series = by_uid[slice.series_uid];
    if (series.slices == 0)
      series = {slice.series_uid, slice.series_number, slice.description, slice.grid, 0};
    series.slices += slice.frames;
  }
  std::vector<DicomSeries> all;
  for (auto& [uid, series] : by_uid) all.push_back(std::move(series));
  std::stable_sort(all.begin(), all.end(), [](const DicomSeries& a, const DicomSeries& b) {
    return std::atoll(a.number.c_str()) < std::atoll(b.number.c_str());
  });
  return all;
}

// Leaves the slices of the only series, or of the chosen one.
void chooseSeries(const std::string& folder, const std::string& name,
                  std::vector<DicomSlice>& slices) {
  const std::vector<DicomSeries> all = listSeries(slices);
  if (all.size() == 1 && name.empty()) return;
  std::vector<std::string> chosen;
  std::string list;
  constexpr std::size_t kMostListed = 20;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!name.empty() && all[i].isCalled(name)) chosen.push_back(all[i].uid);
    if (i < kMostListed) list += (i > 0 ? "; " : "") + all[i].text();
    if (i == kMostListed) list += "; ...";
  }
  if (chosen.size() != 1) {
    const std::string what = name.empty() ? ""
                             : chosen.empty()
                                 ? "no series " + quotedText(name, 70) + " among "
                                 : "several series " + quotedText(name, 70) + " among ";
    throw Error("cannot use the folder '" + folder + "': it holds " + what +
                    std::to_string(all.size()) + " DICOM series: " + list,
                {.path = folder}, {Remedy::kChooseSeries});
  }
  std::erase_if(slices, [&](const DicomSlice& slice) { return slice.series_uid != chosen[0]; });
}

// Throws if slices differ in a property that a volume has only once.
void requireOneGrid(const std::vector<DicomSlice>& slices) {
  const DicomSlice& reference = slices.front();
  const std::vector<double> axes = decimalStrings(reference.orientation, 6);
  for (const DicomSlice& slice : slices) {
    if (slice.grid != reference.grid || !areNear(axes, decimalStrings(slice.orientation, 6)))
      throw unusable(slice.path, "its size or orientation differs from '" + reference.path +
                                     "' in the same series (a localizer?); move it elsewhere");
  }
}

// Sorts the slices of the one volume, those at the time of the options, and takes their places into
// the geometry; false if they have no positions.
bool sortSlices(const std::string& folder, std::vector<DicomSlice>& slices,
                const OpenOptions& options, VolumeInfo& info) {
  std::vector<DicomPlace> places;
  for (const DicomSlice& slice : slices) {
    DicomPlace place;
    place.index = places.size();
    place.name = "'" + slice.path + "'";
    place.position = dicomPosition(slice.position);
    place.number = std::atoll(slice.instance.c_str());
    if (!slice.time.empty()) place.time.push_back(std::atoll(slice.time.c_str()));
    places.push_back(std::move(place));
  }
  const auto unplaced =
      std::find_if(places.begin(), places.end(), [&](const DicomPlace& p) { return !p.position; });
  if (unplaced != places.end())
    for (const DicomSlice& slice : slices)
      if (slice.instance.empty())
        throw unusable(slice.path,
                       "it has neither a position nor an instance number to sort the slices by; "
                       "convert the series with its own software");
  const DicomStackWords words = {folder,
                                 "(several time steps, or copies); keep one volume in the folder",
                                 "find the missing slices or resample the series"};
  const auto normalOf = [&](const DicomPlace&) { return glm::dvec3(info.geometry.direction[2]); };
  chooseDicomVolume(words, normalOf, false, options, places, info);
  const bool have_positions = sortDicomSlices(words, places, info.geometry, info.notes);
  std::vector<DicomSlice> sorted;
  for (const DicomPlace& place : places) sorted.push_back(std::move(slices[place.index]));
  slices = std::move(sorted);
  return have_positions;
}

// A file of a stack. Those of a DICOM series were walked before, and are still to be the same.
struct SliceFile {
  std::string path;
  std::optional<FileStamp> dicom_stamp;
};

// One 2-D file of a series, open.
struct SliceImage {
  itk::ImageIOBase::Pointer image;
  Component component() const { return image->GetComponentType(); }
};

SliceImage openSlice(const SliceFile& file, const Index3& expected) {
  const std::string& path = file.path;
  SliceImage slice{file.dicom_stamp ? openDicomImage(path, *file.dicom_stamp) : openImage(path)};
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
SlicePixels decodeSlice(const SliceFile& file, const Index3& expected,
                        std::shared_ptr<std::vector<std::byte>> buffer) {
  const SliceImage slice = openSlice(file, expected);
  buffer->resize(static_cast<std::size_t>(slice.image->GetImageSizeInBytes()));
  readImageSlices(file.path, *slice.image, 0, 1, buffer->data());
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
  SliceStackSource(VolumeInfo info, std::vector<SliceFile> files, std::uint64_t slice_bytes,
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

  std::vector<std::string> files() const override {
    std::vector<std::string> paths;
    for (const SliceFile& file : files_) paths.push_back(file.path);
    return paths;
  }
  // ITK's libraries hold the slice too while they decode it, and once more if they rescale it.
  std::uint64_t bufferBytes() const override { return 3 * slice_bytes_; }

 private:
  void loadSlice(std::int64_t k) {
    slice_ = -1;
    const SliceFile& file = files_[static_cast<std::size_t>(k)];
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

  void checkRange(const SliceFile& file, std::int64_t k) const {
    const std::string slice = "cannot read slice " + std::to_string(k) + ", '" + file.path + "': ";
    const auto misfit = [&](const std::string& what) {
      if (file.dicom_stamp)
        return Error(slice + what + "; take the series as float32", {.path = file.path},
                     {Remedy::kDicomAsFloat32});
      return Error(slice + what + "; convert all to one type", {.path = file.path});
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
              throw misfit(
                  "its value " + std::to_string(*found) + " does not fit the " +
                  std::string(voxelTypeName(info_.voxel_type)) +
                  (file.dicom_stamp ? " that the headers suggest" : " of the first slice"));
          }
        });
    });
  }

  VolumeInfo info_;
  std::vector<SliceFile> files_;
  std::uint64_t slice_bytes_;
  const CancelFlag* cancel_;
  std::int64_t slice_ = -1;  // the one in pixels_; none is -1
  SlicePixels pixels_;
};

// The slope and intercept that GDCM applies: for some kinds of images (MR) not the header's. The
// maps have them afterwards.
void believeGdcm(const itk::GDCMImageIO& first, std::vector<DicomSlice>& slices,
                 std::vector<std::string>& notes) {
  const double slope = first.GetRescaleSlope(), intercept = first.GetRescaleIntercept();
  const DicomValueMap& header = slices.front().values;
  if (header.slope == slope && header.intercept == intercept) return;
  if (slope == 1 && intercept == 0)
    notes.push_back(
        "slope " + shortText(header.slope) + " and intercept " + shortText(header.intercept) +
        " of the headers were not applied: images of this kind (MR) have none by the standard");
  for (DicomSlice& slice : slices) {
    slice.values.slope = slope;
    slice.values.intercept = intercept;
  }
}

// The type of a series, with a note if it is wider than 16 bits.
VoxelType chooseVoxelType(const std::vector<DicomSlice>& slices, std::optional<VoxelType> first,
                          const OpenOptions& options, std::vector<std::string>& notes) {
  if (options.dicom_float32) {
    if (first != VoxelType::kFloat32) notes.push_back("values became float32, as was asked");
    return VoxelType::kFloat32;
  }
  std::vector<DicomValueMap> maps;
  bool is_one_map = true;
  const auto sameMap = [](const DicomValueMap& a, const DicomValueMap& b) {
    return a.slope == b.slope && a.intercept == b.intercept && a.bits_stored == b.bits_stored &&
           a.bits_allocated == b.bits_allocated && a.is_signed == b.is_signed;
  };
  for (const DicomSlice& slice : slices) {
    maps.push_back(slice.values);
    is_one_map = is_one_map && sameMap(slice.values, slices.front().values);
  }
  // GDCM delivers all slices as this type, which holds all that the bits stored allow.
  if (is_one_map && first) return *first;
  DicomVoxelType chosen = dicomVoxelType(maps);
  if (!chosen.note.empty()) notes.push_back(std::move(chosen.note));
  return chosen.type;
}

void refuseFrames(const std::vector<DicomSlice>& slices) {
  for (const DicomSlice& slice : slices)
    if (slice.frames > 1)
      throw unusable(
          slice.path,
          "it holds " + std::to_string(slice.frames) +
              " slices, but the folder is read as a stack of single ones; name that file");
}

std::unique_ptr<VolumeSource> openDicomSeries(const std::string& folder,
                                              std::vector<DicomSlice> slices,
                                              const OpenOptions& options,
                                              std::vector<std::string> notes) {
  chooseSeries(folder, options.series, slices);
  // One file with all slices (enhanced, multi-frame).
  if (slices.size() == 1) {
    const std::string& path = slices.front().path;
    return openDicomFile(path, readDicomHeader(path), options);
  }
  refuseFrames(slices);
  requireOneGrid(slices);

  VolumeInfo info;
  info.source = folder;
  info.format = "DICOM series";
  info.notes = std::move(notes);
  // In-plane geometry and the stack's normal are the same for all slices.
  const SliceImage any = openSlice({slices.front().path, slices.front().stamp}, Index3(0));
  const auto& dicom = static_cast<const itk::GDCMImageIO&>(*any.image);
  believeGdcm(dicom, slices, info.notes);
  info.voxels = imageVoxels(folder, *any.image);
  info.geometry = imageGeometry(*any.image);
  info.geometry.unit = LengthUnit::kMillimetre;
  glm::dmat3& direction = info.geometry.direction;
  direction[2] = glm::cross(direction[0], direction[1]);
  if (!sortSlices(folder, slices, options, info)) {
    // The distance is the one that ITK took for the slice thickness.
    info.notes.emplace_back("slices without positions were sorted by instance number");
    if (!options.spacing)
      info.notes.back() +=
          "; their distance, " + shortText(info.geometry.spacing.z) + " mm, is an assumption";
  }
  if (!slices.front().has_pixel_spacing && !options.spacing)
    info.notes.push_back("the files have no pixel spacing: 1 mm is an assumption");
  info.voxels.z = static_cast<std::int64_t>(slices.size());
  checkVoxelCounts(folder, info.voxels);
  tidyGeometry(folder, info.geometry, info.voxels, info.notes);

  info.voxel_type = chooseVoxelType(slices, exactVoxelType(any.component()), options, info.notes);
  if (dicom.GetRescaleSlope() != 1 || dicom.GetRescaleIntercept() != 0)
    info.notes.push_back("rescale slope and intercept were applied to the stored values");
  noteMonochrome1(slices.front().photometric, info.notes);
  std::vector<SliceFile> files;
  for (DicomSlice& slice : slices) files.push_back({std::move(slice.path), slice.stamp});
  return std::make_unique<SliceStackSource>(std::move(info), std::move(files),
                                            any.image->GetImageSizeInBytes(), options.cancel);
}

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
  const SliceImage first = openSlice({paths.front(), std::nullopt}, Index3(0));
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
  std::vector<SliceFile> slices;
  for (const std::string& path : paths) slices.push_back({path, std::nullopt});
  return std::make_unique<SliceStackSource>(std::move(info), std::move(slices),
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
  const std::vector<std::string> files = filesInFolder(path);
  // Names of slice images are no DICOM and may be large: do not scan them.
  const std::vector<std::string> tiffs = withExtension(files, {".tif", ".tiff"});
  const std::vector<std::string> images = withExtension(files, {".png"});
  std::set<std::string> named(tiffs.begin(), tiffs.end());
  named.insert(images.begin(), images.end());
  std::vector<std::string> others;
  for (const std::string& file : files)
    if (!named.contains(file)) others.push_back(file);
  DicomScan dicom = scanDicom(others, options);
  std::vector<std::string> notes;
  switch (mostOf(path,
                 {{"DICOM", dicom.pictures()},
                  {"TIFF", static_cast<std::int64_t>(tiffs.size())},
                  {"PNG", static_cast<std::int64_t>(images.size())}},
                 notes)) {
    case 0:
      break;
    case 1:
      return openImageStack(path, tiffs, options, std::move(notes));
    default:
      return openImageStack(path, images, options, std::move(notes));
  }
  if (!dicom.damaged.empty())
    throw unreadable(dicom.damaged.front(),
                     "the DICOM file is cut short or damaged; get the whole file again, or move it "
                     "elsewhere if it is not of this series");
  return openDicomSeries(path, std::move(dicom.slices), options, std::move(notes));
}

}  // namespace isobrick::itk_detail
