// Folders: a DICOM series, or a stack of 2-D images. Slices are read one file at a time.
#include <itkGDCMImageIO.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <set>

#include "isobrick/preprocess/sources/dicom_header.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/itk_common.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_lengths.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick::itk_detail {
namespace {

namespace fs = std::filesystem;

// What is kept of a file's header: thousands of whole ones would be too much.
struct DicomSlice {
  std::string path;
  FileStamp stamp;
  std::string series_uid, position, orientation, instance;
  std::string grid;  // rows and columns: the same in all slices of a volume
  DicomValueMap values;
};

// "1\2\3" -> {1, 2, 3}; empty where it is something else.
std::vector<double> decimalStrings(const std::string& text, std::size_t count) {
  std::vector<double> values;
  const char* at = text.c_str();
  for (;;) {
    char* end = nullptr;
    const double value = std::strtod(at, &end);
    if (end == at || !std::isfinite(value)) break;
    values.push_back(value);
    at = end;
    while (*at == ' ') ++at;
    if (*at != '\\') break;
    ++at;
  }
  if (values.size() != count) values.clear();
  return values;
}

glm::dvec3 positionOf(const DicomSlice& slice) {
  const std::vector<double> p = decimalStrings(slice.position, 3);
  return p.empty() ? glm::dvec3(std::numeric_limits<double>::quiet_NaN())
                   : glm::dvec3(p[0], p[1], p[2]);
}

// The DICOM images among `files`. Only headers are read.
std::vector<DicomSlice> scanDicom(const std::vector<std::string>& files,
                                  const OpenOptions& options) {
  std::vector<DicomSlice> slices;
  for (std::size_t i = 0; i < files.size(); ++i) {
    options.checkCancel();
    options.report("scanning slices", static_cast<double>(i) / static_cast<double>(files.size()));
    const std::string& file = files[i];
    const DicomHeader header = readDicomHeader(file);
    if (header.state == DicomHeader::State::kDamaged)
      throw Error("cannot read '" + file + "': the DICOM file is cut short or damaged; get the " +
                      "whole file again, or move it elsewhere if it is not of this series",
                  {.path = file});
    if (header.state != DicomHeader::State::kImage) continue;
    slices.push_back({file, header.stamp, header.value(dicom::kSeriesUid),
                      header.value(dicom::kImagePosition), header.value(dicom::kImageOrientation),
                      header.value(dicom::kInstanceNumber),
                      header.value(dicom::kColumns) + " x " + header.value(dicom::kRows),
                      dicomValueMap(header)});
  }
  return slices;
}

void requireOneSeries(const std::string& folder, const std::vector<DicomSlice>& slices) {
  std::map<std::string, std::size_t> counts;
  for (const DicomSlice& slice : slices) ++counts[slice.series_uid];
  if (counts.size() == 1) return;
  std::string list;
  constexpr std::size_t kMostListed = 12;
  std::size_t listed = 0;
  for (const auto& [uid, count] : counts) {
    if (listed++ == kMostListed) {
      list += ", ...";
      break;
    }
    list += (list.empty() ? "" : ", ") + (uid.empty() ? "(no UID)" : uid) + " (" +
            std::to_string(count) + (count == 1 ? " image)" : " images)");
  }
  throw Error("cannot use the folder '" + folder + "': it holds " + std::to_string(counts.size()) +
                  " DICOM series: " + list +
                  "; move the files of one series to a folder of their own",
              {.path = folder});
}

// Throws where slices differ in what a volume has only once.
void requireOneGrid(const std::vector<DicomSlice>& slices) {
  const DicomSlice& reference = slices.front();
  const std::vector<double> axes = decimalStrings(reference.orientation, 6);
  for (const DicomSlice& slice : slices) {
    const std::vector<double> other = decimalStrings(slice.orientation, 6);
    bool same = slice.grid == reference.grid && axes.size() == other.size();
    for (std::size_t i = 0; same && i < axes.size(); ++i)
      same = std::abs(axes[i] - other[i]) < 1e-3;
    if (!same)
      throw Error("cannot use '" + slice.path + "': its size or orientation differs from '" +
                      reference.path + "' in the same series (a localizer?); move it elsewhere",
                  {.path = slice.path});
  }
}

// Sorts the slices by position along the normal of the image plane and gives the step from one to
// the next, in mm. Without positions: by instance number, and no step.
std::optional<glm::dvec3> sortSlices(std::vector<DicomSlice>& slices, const glm::dvec3& normal,
                                     std::vector<std::string>& notes) {
  const bool has_positions = std::all_of(slices.begin(), slices.end(), [](const DicomSlice& s) {
    return !std::isnan(positionOf(s).x);
  });
  if (!has_positions) {
    for (const DicomSlice& slice : slices)
      if (slice.instance.empty())
        throw Error("cannot use '" + slice.path + "': it has neither a position nor an instance " +
                        "number to sort the slices by; convert the series with its own software",
                    {.path = slice.path});
    std::stable_sort(slices.begin(), slices.end(), [](const DicomSlice& a, const DicomSlice& b) {
      return std::atoll(a.instance.c_str()) < std::atoll(b.instance.c_str());
    });
    notes.push_back("slices without positions were sorted by instance number");
    return std::nullopt;
  }
  const auto height = [&](const DicomSlice& s) { return glm::dot(positionOf(s), normal); };
  std::stable_sort(slices.begin(), slices.end(),
                   [&](const DicomSlice& a, const DicomSlice& b) { return height(a) < height(b); });
  const glm::dvec3 step = (positionOf(slices.back()) - positionOf(slices.front())) /
                          static_cast<double>(slices.size() - 1);
  const double mean_gap = glm::dot(step, normal);
  const auto pairText = [&](std::size_t i) {
    return "'" + slices[i - 1].path + "' and '" + slices[i].path + "'";
  };
  for (std::size_t i = 1; i < slices.size(); ++i)
    if (height(slices[i]) - height(slices[i - 1]) <= 1e-4 * mean_gap || mean_gap <= 0)
      throw Error("cannot use " + pairText(i) +
                  ": they are at the same position (several time "
                  "steps, or copies); keep one volume in the folder");
  double greatest_deviation = 0;
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const double gap = height(slices[i]) - height(slices[i - 1]);
    if (std::abs(gap - mean_gap) > 0.1 * mean_gap)
      throw Error("cannot use " + pairText(i) + ": they are " + std::to_string(gap) +
                  " mm apart and others " + std::to_string(mean_gap) +
                  " mm on average; find the missing slices or resample the series");
    greatest_deviation = std::max(greatest_deviation, std::abs(gap - mean_gap));
  }
  if (greatest_deviation > 0.01 * mean_gap)
    notes.push_back("slice distances differ by up to " + std::to_string(greatest_deviation) +
                    " mm; their mean was used");
  return step;
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
    throw Error("cannot use '" + path + "': it holds " + std::to_string(voxels.z) +
                    " slices, but the folder is read as a stack of single ones; name that file",
                {.path = path});
  if (expected.x != 0 && (voxels.x != expected.x || voxels.y != expected.y))
    throw Error("cannot use '" + path + "': it has " + std::to_string(voxels.x) + " x " +
                    std::to_string(voxels.y) + " pixels and the first slice " +
                    std::to_string(expected.x) + " x " + std::to_string(expected.y) +
                    "; keep only the slices of one volume in the folder",
                {.path = path});
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

// One slice is held as its file stores it; rows are converted as they are asked for.
class SliceStackSource final : public VolumeSource {
 public:
  // `slice_bytes` is what a slice takes as it is stored.
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
  std::string identity() const override { return {}; }
  // ITK's libraries hold the slice too while they decode it, and once more where they rescale it.
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
    // Whatever the headers said, and whatever became of the files since: nothing is cut off.
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
void believeGdcm(const itk::GDCMImageIO& first, std::vector<DicomSlice>& slices) {
  const double slope = first.GetRescaleSlope(), intercept = first.GetRescaleIntercept();
  const DicomValueMap& header = slices.front().values;
  if (header.slope == slope && header.intercept == intercept) return;
  for (DicomSlice& slice : slices) {
    slice.values.slope = slope;
    slice.values.intercept = intercept;
  }
}

// The type of a series, with a note where it is wider than 16 bits.
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

std::unique_ptr<VolumeSource> openDicomSeries(const std::string& folder,
                                              std::vector<DicomSlice> slices,
                                              const OpenOptions& options) {
  requireOneSeries(folder, slices);
  // One file with all slices (enhanced, multi-frame).
  if (slices.size() == 1)
    return openItkFile(slices.front().path,
                       openDicomImage(slices.front().path, slices.front().stamp), options);
  requireOneGrid(slices);

  VolumeInfo info;
  info.source = folder;
  info.format = "DICOM series";
  // In-plane geometry and the stack's normal are the same for all slices.
  const SliceImage any = openSlice({slices.front().path, slices.front().stamp}, Index3(0));
  const auto& dicom = static_cast<const itk::GDCMImageIO&>(*any.image);
  believeGdcm(dicom, slices);
  info.voxels = imageVoxels(folder, *any.image);
  info.voxels.z = static_cast<std::int64_t>(slices.size());
  checkVoxelCounts(folder, info.voxels);
  info.geometry = imageGeometry(*any.image);
  info.geometry.unit = LengthUnit::kMillimetre;
  const glm::dvec3 normal = glm::cross(info.geometry.direction[0], info.geometry.direction[1]);
  if (const auto step = sortSlices(slices, normal, info.notes)) {
    info.geometry.origin = positionOf(slices.front());
    info.geometry.spacing.z = glm::length(*step);
    info.geometry.direction[2] = *step / info.geometry.spacing.z;
  } else {
    info.geometry.direction[2] = normal;  // the distance is what ITK took for the slice thickness
  }
  tidyGeometry(folder, info.geometry, info.notes);

  info.voxel_type = chooseVoxelType(slices, exactVoxelType(any.component()), options, info.notes);
  if (dicom.GetRescaleSlope() != 1 || dicom.GetRescaleIntercept() != 0)
    info.notes.push_back("rescale slope and intercept were applied to the stored values");
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
                                             const std::vector<std::string>& paths,
                                             const OpenOptions& options) {
  if (paths.size() == 1) return openItkFile(paths.front(), options);
  VolumeInfo info;
  info.source = folder;
  const SliceImage first = openSlice({paths.front(), std::nullopt}, Index3(0));
  const std::string io_name = first.image->GetNameOfClass();
  info.format = io_name.substr(0, io_name.find("ImageIO")) + " stack";
  info.voxels = imageVoxels(folder, *first.image);
  info.voxels.z = static_cast<std::int64_t>(paths.size());
  checkVoxelCounts(folder, info.voxels);
  info.geometry.spacing = imageGeometry(*first.image).spacing;
  if (io_name.starts_with("TIFF")) {
    takeTiffLengths(paths.front(), info.geometry, info.notes);
  } else {
    info.geometry.spacing.z = info.geometry.spacing.x;
    info.notes.emplace_back(kNoSliceDistance);
  }
  tidyGeometry(folder, info.geometry, info.notes);
  const auto exact = exactVoxelType(first.component());
  info.voxel_type = exact ? *exact : VoxelType::kFloat32;
  if (!exact)
    info.notes.push_back(itk::ImageIOBase::GetComponentTypeAsString(first.component()) +
                         " voxels were converted to float32");
  std::vector<SliceFile> files;
  for (const std::string& path : paths) files.push_back({path, std::nullopt});
  return std::make_unique<SliceStackSource>(std::move(info), std::move(files),
                                            first.image->GetImageSizeInBytes(), options.cancel);
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
  std::vector<DicomSlice> dicom = scanDicom(others, options);
  if (!dicom.empty()) return openDicomSeries(path, std::move(dicom), options);
  if (!tiffs.empty()) return openImageStack(path, tiffs, options);
  if (!images.empty()) return openImageStack(path, images, options);
  throw Error("cannot read the folder '" + path + "': it holds neither DICOM files nor TIFF or " +
                  "PNG slices; name a folder that does, or a file",
              {.path = path});
}

}  // namespace isobrick::itk_detail
