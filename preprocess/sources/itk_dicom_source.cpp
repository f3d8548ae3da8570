// The pixels of DICOM slices, unpacked by GDCM if they are packed. It gets nothing of a file but
// these: its own reading of headers aborts on elements of types that it does not expect.
#include <gdcmImageReader.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <new>
#include <sstream>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// Pixels of 1, 2 or 4 bytes. The bits above the high bit may hold something else.
struct StoredPixels {
  StoredPixels(const DicomFile& file, const DicomValueMap& values)
      : bytes(static_cast<unsigned>(values.bits_allocated) / 8),
        bits(static_cast<unsigned>(values.bits_stored)),
        shift(static_cast<unsigned>(values.high_bit + 1 - values.bits_stored)),
        is_signed(values.is_signed),
        big_endian(file.packed_bytes == 0 &&
                   (file.syntax == dicom::kBigEndian || file.syntax == dicom::kImplicitOfGe)) {}

  // Calls `take` with each of `count` numbers. Stored: unsigned, of `bytes`.
  template <typename Stored, typename Take>
  void forEachOf(const std::byte* from, std::size_t count, Take take) const {
    const std::int64_t range = std::int64_t{1} << bits, half = range / 2;
    for (std::size_t i = 0; i < count; ++i, from += sizeof(Stored)) {
      const auto stored = static_cast<std::int64_t>(loadNumber<Stored>(from, big_endian) >> shift);
      const std::int64_t value = stored & (range - 1);
      take(i, is_signed && value >= half ? value - range : value);
    }
  }
  template <typename Take>
  void forEach(const std::byte* from, std::size_t count, Take take) const {
    if (bytes == 1) return forEachOf<std::uint8_t>(from, count, take);
    if (bytes == 2) return forEachOf<std::uint16_t>(from, count, take);
    forEachOf<std::uint32_t>(from, count, take);
  }

  unsigned bytes, bits, shift;
  bool is_signed, big_endian;
};

// A file of GDCM's liking, up to its pixels.
class HeaderForGdcm {
 public:
  explicit HeaderForGdcm(const DicomFile& file) : bytes_(128, '\0') {
    bytes_ += "DICM";
    const char* const kind = file.frames > 1 ? "1.2.840.10008.5.1.4.1.1.7.3"  // secondary captures
                                             : "1.2.840.10008.5.1.4.1.1.7";
    add(0x00020002, "UI", kind);
    add(dicom::kTransferSyntax, "UI", file.syntax);
    add(dicom::kImageKind, "UI", kind);
    addNumber(dicom::kSamplesPerPixel, 1);
    add(dicom::kPhotometricInterpretation, "CS", "MONOCHROME2");
    if (file.frames > 1) add(dicom::kNumberOfFrames, "IS", std::to_string(file.frames));
    addNumber(dicom::kRows, file.rows);
    addNumber(dicom::kColumns, file.columns);
    addNumber(dicom::kBitsAllocated, file.values.bits_allocated);
    addNumber(dicom::kBitsStored, file.values.bits_stored);
    addNumber(dicom::kHighBit, file.values.high_bit);
    addNumber(dicom::kPixelRepresentation, file.values.is_signed ? 1 : 0);
    addTag(dicom::kPixelData);
    bytes_ += std::string("OB\0\0\xff\xff\xff\xff", 8);
  }

  const std::string& bytes() const { return bytes_; }

 private:
  void add16(std::uint32_t value) {
    bytes_ += static_cast<char>(value & 255);
    bytes_ += static_cast<char>(value >> 8 & 255);
  }
  void addTag(std::uint32_t tag) {
    add16(tag >> 16);
    add16(tag & 0xffff);
  }
  void add(std::uint32_t tag, const char* type, std::string value) {
    if (value.size() % 2 != 0) value += type[0] == 'U' ? '\0' : ' ';
    addTag(tag);
    bytes_ += type;
    add16(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
  }
  void addNumber(std::uint32_t tag, std::int64_t value) {
    addTag(tag);
    bytes_ += "US";
    add16(2);
    add16(static_cast<std::uint32_t>(value));
  }

  std::string bytes_;
};

using PixelBytes = std::shared_ptr<std::vector<char>>;

InputFile openUnchanged(const DicomFile& file) {
  if (fileStamp(file.path) != file.stamp)
    throw unreadable(file.path,
                     "it changed since its header was read; run again when nobody writes to it");
  return InputFile(file.path);
}

// All frames of a packed file, `bytes` in all.
PixelBytes unpackFrames(const DicomFile& file, std::uint64_t bytes) {
  const auto fail = [&](const std::string& why) {
    return unreadable(file.path, why, "; get the whole file again, or unpack it");
  };
  for (const auto silence : {gdcm::Trace::WarningOff, gdcm::Trace::ErrorOff, gdcm::Trace::DebugOff})
    silence();
  std::string packed = HeaderForGdcm(file).bytes();
  const std::size_t header_bytes = packed.size();
  packed.resize(header_bytes + file.packed_bytes);
  if (openUnchanged(file).readAt(file.pixels_at, packed.data() + header_bytes, file.packed_bytes) <
      file.packed_bytes)
    throw fail("it became shorter meanwhile");
  try {
    std::istringstream stream(std::move(packed));
    gdcm::ImageReader reader;
    reader.SetStream(stream);
    if (!reader.Read()) throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    const gdcm::Image& image = reader.GetImage();
    if (image.GetBufferLength() != bytes) throw fail("its pixels are not as its header says");
    auto pixels = std::make_shared<std::vector<char>>(bytes);
    if (!image.GetBuffer(pixels->data()))
      throw fail("its pixels are damaged or packed in a way that GDCM lacks");
    return pixels;
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw fail("not enough memory for its pixels");
  } catch (const std::exception& exception) {
    throw fail(exception.what());
  }
}

class DicomSource final : public VolumeSource {
 public:
  DicomSource(VolumeInfo info, std::vector<DicomFile> files, std::vector<DicomSlice> slices,
              const CancelFlag* cancel)
      : info_(std::move(info)),
        files_(std::move(files)),
        slices_(std::move(slices)),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    const Index3& voxels = info_.voxels;
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t k, std::int64_t y, std::int64_t rows, std::byte* to) {
                         const auto pixels = static_cast<std::size_t>(rows * voxels.x);
                         convert(k, readPixels(k, y, pixels), pixels, to);
                       });
    if (first + count == voxels.y * voxels.z) unpacked_.reset();
  }

  std::vector<std::string> files() const override {
    std::vector<std::string> paths;
    for (const DicomFile& file : files_) paths.push_back(file.path);
    return paths;
  }
  // GDCM has the packed pixels twice.
  std::uint64_t bufferBytes() const override {
    std::uint64_t most = 0;
    for (const DicomFile& file : files_)
      most = std::max(
          most, file.packed_bytes > 0 ? bytesOf(file) + 2 * file.packed_bytes : frameBytes(file));
    return most;
  }

 private:
  // At least one bit a pixel and some bytes a frame are in the file, so these fit 64 bits.
  std::uint64_t frameBytes(const DicomFile& file) const {
    return static_cast<std::uint64_t>(info_.voxels.x * info_.voxels.y) *
           static_cast<std::uint64_t>(file.values.bits_allocated / 8);
  }
  std::uint64_t bytesOf(const DicomFile& file) const {
    return frameBytes(file) * static_cast<std::uint64_t>(file.frames);
  }
  const DicomSlice& slice(std::int64_t k) const { return slices_[static_cast<std::size_t>(k)]; }
  const DicomFile& fileOf(std::int64_t k) const { return files_[slice(k).file]; }

  const std::byte* readPixels(std::int64_t k, std::int64_t y, std::size_t pixels) {
    const DicomFile& file = fileOf(k);
    const auto pixel_bytes = static_cast<std::uint64_t>(file.values.bits_allocated / 8);
    const std::uint64_t at = frameBytes(file) * slice(k).frame +
                             static_cast<std::uint64_t>(y * info_.voxels.x) * pixel_bytes;
    const bool is_other_file = open_file_ != slice(k).file;
    if (is_other_file) {
      unpacked_.reset();
      in_place_.reset();
    }
    open_file_ = slice(k).file;
    if (cancel_ != nullptr) cancel_->check();
    if (file.packed_bytes > 0) {
      // A large packed file takes seconds, and its library does not stop before its end.
      if (!unpacked_)
        unpacked_ = runAbandonable(
            cancel_, [file, bytes = bytesOf(file)] { return unpackFrames(file, bytes); });
      return reinterpret_cast<const std::byte*>(unpacked_->data()) + at;
    }
    if (!in_place_) in_place_.emplace(openUnchanged(file));
    rows_.resize(pixels * pixel_bytes);
    if (in_place_->readAt(file.pixels_at + at, rows_.data(), rows_.size()) < rows_.size())
      throw becameShorter(*in_place_, k, file.pixels_at + at);
    return rows_.data();
  }

  void convert(std::int64_t k, const std::byte* from, std::size_t pixels, void* out) const {
    const DicomValueMap& map = slice(k).values;
    const StoredPixels stored(fileOf(k), map);
    visitVoxelType(info_.voxel_type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      Out* const to = static_cast<Out*>(out);
      stored.forEach(from, pixels, [&](std::size_t i, std::int64_t number) {
        const double value = map.slope * static_cast<double>(number) + map.intercept;
        // Whatever the header said: nothing is cut off.
        if constexpr (std::is_integral_v<Out>)
          if (value < std::numeric_limits<Out>::min() || value > std::numeric_limits<Out>::max())
            throw misfit(k, value);
        to[i] = static_cast<Out>(value);
      });
    });
  }

  Error misfit(std::int64_t k, double value) const {
    const std::string& path = fileOf(k).path;
    const std::string where =
        files_.size() > 1 ? "slice " + std::to_string(k) + ", '" + path + "'"
                          : "frame " + std::to_string(slice(k).frame + 1) + " of '" + path + "'";
    return fileError(path, "cannot read ", where, ": its value ", std::llround(value),
                     " does not fit the ", voxelTypeName(info_.voxel_type),
                     " that the headers suggest; take it as float32", Remedy::kDicomAsFloat32);
  }

  VolumeInfo info_;
  std::vector<DicomFile> files_;
  std::vector<DicomSlice> slices_;
  const CancelFlag* cancel_;
  // Of the file of the slice that was read last:
  std::size_t open_file_ = std::numeric_limits<std::size_t>::max();
  std::optional<InputFile> in_place_;
  std::vector<std::byte> rows_;
  PixelBytes unpacked_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeDicomSource(VolumeInfo info, std::vector<DicomFile> files,
                                              std::vector<DicomSlice> slices,
                                              const CancelFlag* cancel) {
  return std::make_unique<DicomSource>(std::move(info), std::move(files), std::move(slices),
                                       cancel);
}

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
