// DICOM files of a folder as series, of which the only one, or the one of --select series, is read.
#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {

std::optional<DicomHeader> dicomImageHeader(const std::string& path) {
  if (!isRegularFile(path)) return std::nullopt;
  DicomHeader header = readDicomHeader(path);
  switch (header.state) {
    case DicomHeader::State::kNotDicom:
      return std::nullopt;
    case DicomHeader::State::kNoImage:
      throw unusable(path, "it is a DICOM file without an image; name the folder of the series");
    case DicomHeader::State::kDamaged:
      throw unreadable(path, "the DICOM file is cut short or damaged; get the whole file again");
    case DicomHeader::State::kImage:
      break;
  }
  return header;
}

std::unique_ptr<VolumeSource> openDicomFile(const std::string& path, const DicomHeader& header,
                                            const OpenOptions& options) {
  DicomFrames volume = arrangeDicomFrames(path, header, options);
  return makeDicomSource(std::move(volume.info), {dicomFile(path, header)},
                         std::move(volume.slices), options.cancel);
}

namespace {

SeriesFile seriesFile(const std::string& path, const DicomHeader& header) {
  SeriesFile file;
  file.file = dicomFile(path, header);
  file.fault = faultOfPixels(header);
  file.series_uid = header.value(dicom::kSeriesUid);
  file.series_number = header.value(dicom::kSeriesNumber);
  file.description = header.value(dicom::kSeriesDescription);
  // An enhanced file of a single frame has these in its groups.
  file.position = header.value(dicom::kImagePosition, 0);
  file.orientation = header.value(dicom::kImageOrientation, 0);
  file.instance = header.value(dicom::kInstanceNumber);
  file.time = header.value(dicom::kTemporalPosition);
  file.photometric = header.value(dicom::kPhotometricInterpretation);
  file.pixel_spacing = dicomPixelSpacing(header, 0);
  file.slice_distance = dicomSliceDistance(header, 0);
  file.has_idle_rescale = hasIdleRescale(header);
  return file;
}

std::string gridText(const SeriesFile& file) {
  return concat(file.file.columns, " x ", file.file.rows);
}

// A series as a list of them shows it.
struct DicomSeries {
  std::string uid, number, description, grid;
  std::int64_t slices = 0;

  std::string text(const std::string& more = {}) const {
    return concat(number.empty() ? "(no number)" : number, " ", quotedText(description, 40), " (",
                  slices, slices == 1 ? " slice of " : " slices of ", grid, more, ")");
  }
  bool isCalled(const std::string& name) const {
    return name == uid ||
           (!number.empty() && std::atoll(number.c_str()) == std::atoll(name.c_str()) &&
            name.find_first_not_of("0123456789") == std::string::npos);
  }
};

std::vector<DicomSeries> listSeries(const std::vector<SeriesFile>& files) {
  std::map<std::string, DicomSeries> by_uid;
  for (const SeriesFile& file : files) {
    DicomSeries& series = by_uid[file.series_uid];
    if (series.slices == 0)
      series = {file.series_uid, file.series_number, file.description, gridText(file), 0};
    series.slices += file.file.frames;
  }
  std::vector<DicomSeries> all;
  for (auto& [uid, series] : by_uid) all.push_back(std::move(series));
  std::ranges::stable_sort(all, [](const DicomSeries& a, const DicomSeries& b) {
    return std::atoll(a.number.c_str()) < std::atoll(b.number.c_str());
  });
  return all;
}

// Leaves the slices of the only series, or of the chosen one.
void chooseSeries(const std::string& folder, const std::string& name,
                  std::vector<SeriesFile>& files) {
  const std::vector<DicomSeries> all = listSeries(files);
  if (all.size() == 1 && name.empty()) return;
  std::vector<std::string> chosen;
  std::vector<SeveralSeries::Series> found;
  ListText list("; ", 20);
  for (const DicomSeries& series : all) {
    if (!name.empty() && series.isCalled(name)) chosen.push_back(series.uid);
    list.add(series.text(", UID " + (series.uid.empty() ? "missing" : series.uid)));
    found.push_back({series.uid.empty() ? series.number : series.uid, series.text()});
  }
  if (chosen.size() != 1) {
    const std::string what = name.empty() ? ""
                             : chosen.empty()
                                 ? "no series " + quotedText(name, 70) + " among "
                                 : "several series " + quotedText(name, 70) + " among ";
    throw SeveralSeries(
        fileError(folder, "cannot use the folder '", folder, "': it holds ", what, all.size(),
                  " DICOM series: ", list.text(), Remedy::kChooseSeries),
        std::move(found));
  }
  std::erase_if(files, [&](const SeriesFile& file) { return file.series_uid != chosen[0]; });
}

// Throws if slices differ in a property that a volume has only once.
void requireOneGrid(const std::vector<SeriesFile>& files) {
  const SeriesFile& reference = files.front();
  const std::int64_t pixels = std::max(reference.file.columns, reference.file.rows);
  const std::vector<double> axes = decimalStrings(reference.orientation, 6);
  for (const SeriesFile& file : files) {
    const auto refuse = [&](const std::string& what) {
      throw unusable(file.file.path, "its ", what, " differs from '", reference.file.path,
                     "' in the same series (a localizer?); move it elsewhere");
    };
    if (gridText(file) != gridText(reference) ||
        !areSameForPixels(axes, decimalStrings(file.orientation, 6), pixels, 1))
      refuse("size or orientation");
    if (!areSameForPixels(reference.pixel_spacing, file.pixel_spacing, pixels, 0))
      refuse("pixel spacing");
    if (!file.fault.empty()) throw unusable(file.file.path, file.fault);
    if (file.file.frames > 1)
      throw unusable(file.file.path, "it holds ", file.file.frames,
                     " slices, but the folder is read as a stack of single ones; name that file");
  }
}

// Sorts the slices of the one volume, those at the time of the options, and takes their places into
// the geometry.
void sortSlices(const std::string& folder, std::vector<SeriesFile>& files,
                const OpenOptions& options, VolumeInfo& info) {
  std::vector<DicomPlace> places;
  for (const SeriesFile& file : files) {
    DicomPlace place;
    place.index = places.size();
    place.name = "'" + file.file.path + "'";
    takeDicomPosition(file.position, place);
    place.number = std::atoll(file.instance.c_str());
    if (!file.time.empty()) place.time.push_back(std::atoll(file.time.c_str()));
    places.push_back(std::move(place));
  }
  const auto unplaced =
      std::ranges::find_if(places, [&](const DicomPlace& p) { return !p.position; });
  if (unplaced != places.end())
    for (const SeriesFile& file : files)
      if (file.instance.empty())
        throw unusable(file.file.path,
                       "it has neither a position nor an instance number to sort the slices by; "
                       "convert the series with its own software");
  const DicomStackWords words = {folder,
                                 "(several time steps, or copies); keep one volume in the folder",
                                 "find the missing slices or resample the series"};
  const auto normalOf = [&](const DicomPlace&) { return glm::dvec3(info.geometry.direction[2]); };
  chooseDicomVolume(words, normalOf, false, options, places, info);
  if (places.size() < 2)
    throw unusable(folder, "the volume is a single slice; choose one of several slices");
  if (!sortDicomSlices(words, places, info.geometry, info.notes)) {
    info.notes.emplace_back("slices without positions were sorted by instance number");
    const SeriesFile& first = files[places.front().index];
    if (first.slice_distance > 0) info.geometry.spacing.z = first.slice_distance;
    if (!options.spacing)
      info.notes.back() +=
          "; their distance, " + shortText(info.geometry.spacing.z) + " mm, is an assumption";
  }
  std::vector<SeriesFile> sorted;
  for (const DicomPlace& place : places) sorted.push_back(std::move(files[place.index]));
  files = std::move(sorted);
}

void takeVoxelType(const std::vector<SeriesFile>& files, const OpenOptions& options,
                   VolumeInfo& info) {
  std::vector<DicomValueMap> maps;
  for (const SeriesFile& file : files) maps.push_back(file.file.values);
  takeDicomVoxelType(maps, options.dicom_float32, info);
  if (files.front().has_idle_rescale)
    info.notes.push_back(
        "slope and intercept of the headers were not applied: images of this kind (MR) have none "
        "by the standard");
  noteMonochrome1(files.front().photometric, info.notes);
}

}  // namespace

std::int64_t DicomScan::pictures() const {
  auto count = static_cast<std::int64_t>(damaged.size());
  for (const SeriesFile& image : images) count += std::min(image.file.frames, kMaxVoxelsPerAxis);
  return count;
}

bool isDicomDirectory(const std::string& path) {
  return lowercase(path.substr(path.rfind('/') + 1)) == "dicomdir";
}

DicomScan scanDicom(const std::vector<std::string>& files, const OpenOptions& options) {
  DicomScan scan;
  for (std::size_t i = 0; i < files.size(); ++i) {
    options.checkCancel();
    options.report("scanning slices", static_cast<double>(i) / static_cast<double>(files.size()));
    const DicomHeader header = readDicomHeader(files[i]);
    if (header.state == DicomHeader::State::kDamaged) scan.damaged.push_back(files[i]);
    if (header.state == DicomHeader::State::kImage)
      scan.images.push_back(seriesFile(files[i], header));
  }
  return scan;
}

std::unique_ptr<VolumeSource> openDicomSeries(const std::string& folder, DicomScan scan,
                                              const OpenOptions& options,
                                              std::vector<std::string> notes) {
  if (!scan.damaged.empty())
    throw unreadable(scan.damaged.front(),
                     "the DICOM file is cut short or damaged; get the whole file again, or move it "
                     "elsewhere if it is not of this series");
  std::vector<SeriesFile> files = std::move(scan.images);
  chooseSeries(folder, options.series, files);
  // One file with all slices (enhanced, multi-frame).
  if (files.size() == 1) {
    const std::string& path = files.front().file.path;
    return openDicomFile(path, readDicomHeader(path), options);
  }
  requireOneGrid(files);

  VolumeInfo info;
  info.source = folder;
  info.format = "DICOM series";
  info.notes = std::move(notes);
  info.geometry = dicomPlane(files.front().orientation, files.front().pixel_spacing, options,
                             "the files have", info.notes);
  sortSlices(folder, files, options, info);
  info.voxels = {files.front().file.columns, files.front().file.rows,
                 static_cast<std::int64_t>(files.size())};
  checkVoxelCounts(folder, info.voxels);
  tidyGeometry(folder, info.geometry, info.voxels, info.notes);
  takeVoxelType(files, options, info);

  std::vector<DicomFile> all;
  std::vector<DicomSlice> slices;
  for (SeriesFile& file : files) {
    slices.push_back({all.size(), 0, file.file.values});
    all.push_back(std::move(file.file));
  }
  return makeDicomSource(std::move(info), std::move(all), std::move(slices), options.cancel);
}

}  // namespace isobrick
