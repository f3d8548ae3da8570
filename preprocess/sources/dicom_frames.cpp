#include "isobrick/preprocess/sources/dicom_frames.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_stack.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Dimensions that say where a frame is, and those that say when: delays, times and phases of a
// heart's beat.
constexpr std::array<std::uint32_t, 3> kPlaceDimensions = {dicom::kStackId, dicom::kInStackPosition,
                                                           dicom::kImagePosition};
constexpr std::array<std::uint32_t, 7> kTimeDimensions = {dicom::kTemporalPositionIndex,
                                                          0x0020930d,
                                                          0x00209153,
                                                          0x00189074,
                                                          0x00189151,
                                                          0x00209241,
                                                          0x00209254};

std::int64_t integer(const std::string& text, std::int64_t otherwise) {
  char* end = nullptr;
  const long long value = std::strtoll(text.c_str(), &end, 10);
  return end == text.c_str() ? otherwise : value;
}

void refuseOtherImages(const std::string& path, const DicomHeader& header) {
  if (integer(header.value(dicom::kSamplesPerPixel), 1) != 1 ||
      !header.value(dicom::kPhotometricInterpretation).starts_with("MONOCHROME"))
    throw unusable(path, "its frames have colours; convert them to grey values first");
  if (!header.value(dicom::kTotalPixelMatrixColumns).empty())
    throw unusable(path, "its frames are the tiles of one large picture, and no slices");
  const std::int64_t bits = integer(header.value(dicom::kBitsAllocated), 16);
  if (bits != 8 && bits != 16 && bits != 32)
    throw unusable(path, "its pixels have " + std::to_string(bits) +
                             " bits; convert them to 8, 16 or 32 first");
}

// Index values of the frame's dimensions go to its time or its channel.
void sortDimensions(const DicomHeader& header, std::size_t frame, DicomPlace& place) {
  const std::size_t count = header.dimensions.size();
  const std::vector<double> indices =
      decimalStrings(header.value(dicom::kDimensionIndexValues, frame), count);
  if (count == 0 || indices.empty()) return;
  for (std::size_t i = 0; i < count; ++i) {
    const auto pointer = header.dimensions[i].find(dicom::kDimensionIndexPointer);
    if (pointer == header.dimensions[i].end()) continue;
    const auto tag = static_cast<std::uint32_t>(integer(pointer->second, 0));
    const auto isIn = [&](const auto& tags) {
      return std::find(tags.begin(), tags.end(), tag) != tags.end();
    };
    if (isIn(kPlaceDimensions)) continue;
    (isIn(kTimeDimensions) ? place.time : place.channel)
        .push_back(static_cast<std::int64_t>(indices[i]));
  }
}

std::vector<DicomPlace> placesOf(const DicomHeader& header, std::size_t frames,
                                 bool& times_differ) {
  std::vector<DicomPlace> places;
  std::string first_time;
  for (std::size_t frame = 0; frame < frames; ++frame) {
    DicomPlace place;
    place.index = frame;
    place.name = "frame " + std::to_string(frame + 1);
    place.position = dicomPosition(header.value(dicom::kImagePosition, frame));
    place.number = integer(header.value(dicom::kInStackPosition, frame), 0);
    place.stack = header.value(dicom::kStackId, frame);
    const std::string time = header.value(dicom::kTemporalPositionIndex, frame);
    if (frame == 0) first_time = time;
    times_differ = times_differ || time != first_time;
    if (!time.empty()) place.time.push_back(integer(time, 0));
    sortDimensions(header, frame, place);
    places.push_back(std::move(place));
  }
  return places;
}

// The values of an element that all slices are to share; empty where none has it.
std::vector<double> sharedNumbers(const std::string& path, const DicomHeader& header,
                                  const std::vector<std::size_t>& frames, std::uint32_t tag,
                                  std::size_t count, const char* what) {
  const std::vector<double> first = decimalStrings(header.value(tag, frames.front()), count);
  for (const std::size_t frame : frames) {
    const std::vector<double> other = decimalStrings(header.value(tag, frame), count);
    bool same = other.size() == first.size();
    for (std::size_t i = 0; same && i < first.size(); ++i)
      same = std::abs(first[i] - other[i]) < 1e-3;
    if (!same)
      throw unusable(path, "frame " + std::to_string(frame + 1) + " has another " + what +
                               " than frame " + std::to_string(frames.front() + 1) +
                               "; take its frames apart into volumes of one " + what);
  }
  return first;
}

std::vector<std::size_t> framesOf(const std::vector<DicomPlace>& places) {
  std::vector<std::size_t> frames;
  for (const DicomPlace& place : places) frames.push_back(place.index);
  return frames;
}

struct ImagePlane {
  glm::dvec3 row{1, 0, 0}, column{0, 1, 0};
  glm::dvec3 normal() const { return glm::cross(row, column); }
};

ImagePlane planeOf(const std::string& orientation) {
  const std::vector<double> axes = decimalStrings(orientation, 6);
  if (axes.empty()) return {};
  return {{axes[0], axes[1], axes[2]}, {axes[3], axes[4], axes[5]}};
}

void noteValueMaps(const std::vector<DicomValueMap>& maps, std::vector<std::string>& notes) {
  const auto differs = [&](const DicomValueMap& map) {
    return map.slope != maps.front().slope || map.intercept != maps.front().intercept;
  };
  if (std::any_of(maps.begin(), maps.end(), differs))
    notes.push_back("rescale slope and intercept, which differ, were applied to each frame");
  else if (maps.front().slope != 1 || maps.front().intercept != 0)
    notes.push_back("rescale slope and intercept were applied to the stored values");
}

}  // namespace

bool hasDicomFrames(const DicomHeader& header) {
  return header.hasGroups() && integer(header.value(dicom::kNumberOfFrames), 1) > 1;
}

DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options) {
  refuseOtherImages(path, header);
  const auto count = static_cast<std::size_t>(integer(header.value(dicom::kNumberOfFrames), 1));
  if (count > kMaxVoxelsPerAxis)
    throw unusable(path, "it has " + std::to_string(count) +
                             " frames, and isobrick takes at most " +
                             std::to_string(kMaxVoxelsPerAxis));
  if (!header.frames.empty() && header.frames.size() != count)
    throw unusable(path, "it says of " + std::to_string(header.frames.size()) +
                             " frames where they are, and has " + std::to_string(count));
  DicomFrames volume;
  volume.frames_in_file = count;
  VolumeInfo& info = volume.info;
  info.source = path;
  info.format = "DICOM";
  const DicomStackWords words = {
      path, "and of the same time (several echoes, or copies); take them apart into files",
      "find the missing frames or resample the volume"};

  bool times_differ = false;
  std::vector<DicomPlace> places = placesOf(header, count, times_differ);
  const auto planeOfPlace = [&](const DicomPlace& place) {
    return planeOf(header.value(dicom::kImageOrientation, place.index));
  };
  chooseDicomVolume(
      words, [&](const DicomPlace& place) { return planeOfPlace(place).normal(); }, times_differ,
      options, places, info);
  if (places.size() < 2)
    throw unusable(path, "the volume is a single slice; choose one of several slices");

  const std::vector<std::size_t> chosen = framesOf(places);
  sharedNumbers(path, header, chosen, dicom::kImageOrientation, 6, "orientation");
  const std::vector<double> pixel_spacing =
      sharedNumbers(path, header, chosen, dicom::kPixelSpacing, 2, "pixel spacing");
  const ImagePlane plane = planeOfPlace(places.front());
  GridGeometry& geometry = info.geometry;
  geometry.unit = LengthUnit::kMillimetre;
  geometry.direction = glm::dmat3(plane.row, plane.column, plane.normal());
  if (!pixel_spacing.empty())  // between rows first
    geometry.spacing = {pixel_spacing[1], pixel_spacing[0], 1};
  else if (!options.spacing)
    info.notes.push_back("the file has no pixel spacing: 1 mm is an assumption");
  if (const auto step = sortDicomSlices(words, plane.normal(), places, info.notes)) {
    geometry.origin = *places.front().position;
    geometry.spacing.z = glm::length(*step);
    geometry.direction[2] = *step / geometry.spacing.z;
  } else {
    for (const std::uint32_t tag : {dicom::kSliceThickness, dicom::kSpacingBetweenSlices}) {
      const std::vector<double> distance = decimalStrings(header.value(tag, chosen.front()), 1);
      if (!distance.empty() && distance[0] > 0) geometry.spacing.z = distance[0];
    }
    if (!options.spacing)
      info.notes.push_back("frames have no positions: their order and their distance, " +
                           shortText(geometry.spacing.z) + " mm, are assumptions");
  }
  info.voxels = {integer(header.value(dicom::kColumns), 0), integer(header.value(dicom::kRows), 0),
                 static_cast<std::int64_t>(places.size())};
  checkVoxelCounts(path, info.voxels);
  tidyGeometry(path, geometry, info.notes);

  volume.frames = framesOf(places);
  for (const std::size_t frame : volume.frames) volume.maps.push_back(dicomValueMap(header, frame));
  DicomVoxelType type = dicomVoxelType(volume.maps);
  if (options.dicom_float32 && type.type != VoxelType::kFloat32)
    type = {VoxelType::kFloat32, "values became float32, as was asked"};
  info.voxel_type = type.type;
  if (!type.note.empty()) info.notes.push_back(std::move(type.note));
  noteValueMaps(volume.maps, info.notes);
  noteMonochrome1(header.value(dicom::kPhotometricInterpretation), info.notes);
  return volume;
}

}  // namespace isobrick
