#include "isobrick/preprocess/sources/dicom_stack.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <map>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_tags.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Nearer than this share of their mean distance, slices are at the same position.
constexpr double kSamePosition = 1e-4;
constexpr double kMostUneven = 0.1, kNotedUneven = 0.01;

bool haveAllPositions(const std::vector<DicomPlace>& places) {
  return std::all_of(places.begin(), places.end(),
                     [](const DicomPlace& place) { return place.position.has_value(); });
}

// Without positions it cannot be decided: true.
bool areSomeAtOnePosition(const std::vector<DicomPlace>& places, const glm::dvec3& normal) {
  if (!haveAllPositions(places)) return true;
  std::vector<double> heights;
  for (const DicomPlace& place : places) heights.push_back(glm::dot(*place.position, normal));
  std::sort(heights.begin(), heights.end());
  const double mean_gap = (heights.back() - heights.front()) /
                          static_cast<double>(std::max<std::size_t>(heights.size(), 2) - 1);
  for (std::size_t i = 1; i < heights.size(); ++i)
    if (heights[i] - heights[i - 1] <= kSamePosition * mean_gap) return true;
  return false;
}

void takeNoteOfChoice(const std::string& what, VolumeInfo& info) {
  info.encoding += (info.encoding.empty() ? "" : "; ") + what;
}

void chooseStack(const std::string& path, const std::string& name, std::vector<DicomPlace>& places,
                 VolumeInfo& info) {
  std::map<std::string, std::size_t> counts;
  for (const DicomPlace& place : places) ++counts[place.stack];
  if (counts.contains(name) && !name.empty()) {
    std::erase_if(places, [&](const DicomPlace& place) { return place.stack != name; });
    return takeNoteOfChoice("stack " + quotedText(name, 40), info);
  }
  if (counts.size() == 1 && name.empty()) return;
  std::string list;
  std::size_t listed = 0;
  constexpr std::size_t kMostListed = 12;
  for (const auto& [stack, count] : counts) {
    if (listed++ == kMostListed) {
      list += ", ...";
      break;
    }
    list += (list.empty() ? "" : ", ") + quotedText(stack, 40) + " (" + std::to_string(count) +
            " slices)";
  }
  if (!name.empty())
    throw unusable(path, "it has no stack of the name " + quotedText(name, 40) + "; it has " + list,
                   {Remedy::kChooseStack});
  throw unusable(path, "it holds " + std::to_string(counts.size()) + " stacks of slices: " + list,
                 {Remedy::kChooseStack});
}

// `member` of the places takes several values, each of which is a volume.
void chooseOneOf(const std::string& path, const char* what, Remedy remedy,
                 std::vector<std::int64_t> DicomPlace::*member, bool may_differ,
                 std::optional<std::int64_t> choice, std::vector<DicomPlace>& places,
                 VolumeInfo& info) {
  std::map<std::vector<std::int64_t>, std::size_t> counts;
  if (may_differ)
    for (const DicomPlace& place : places) ++counts[place.*member];
  const std::size_t count = std::max<std::size_t>(counts.size(), 1);
  if (choice && static_cast<std::uint64_t>(*choice) >= count)
    throw unusable(path,
                   std::string("it has no ") + what + " " + std::to_string(*choice) + "; it has " +
                       std::to_string(count) + ", counted from 0",
                   {remedy});
  if (count == 1) return;
  if (!choice)
    throw unusable(path,
                   "it holds " + std::to_string(count) + " volumes, of " + what + " 0 to " +
                       std::to_string(count - 1),
                   {remedy});
  const std::vector<std::int64_t> key = std::next(counts.begin(), *choice)->first;
  std::erase_if(places, [&](const DicomPlace& place) { return place.*member != key; });
  takeNoteOfChoice(std::string(what) + " " + std::to_string(*choice), info);
}

}  // namespace

void chooseDicomVolume(const DicomStackWords& words,
                       const std::function<glm::dvec3(const DicomPlace&)>& normal,
                       bool times_differ, const OpenOptions& options,
                       std::vector<DicomPlace>& places, VolumeInfo& info) {
  chooseStack(words.path, options.grid, places, info);
  chooseOneOf(words.path, "time", Remedy::kChooseTime, &DicomPlace::time,
              times_differ || areSomeAtOnePosition(places, normal(places.front())), options.time,
              places, info);
  chooseOneOf(words.path, "channel", Remedy::kChooseVariant, &DicomPlace::channel,
              areSomeAtOnePosition(places, normal(places.front())), options.channel, places, info);
}

bool sortDicomSlices(const DicomStackWords& words, std::vector<DicomPlace>& places,
                     GridGeometry& geometry, std::vector<std::string>& notes) {
  if (!haveAllPositions(places)) {
    std::stable_sort(places.begin(), places.end(),
                     [](const DicomPlace& a, const DicomPlace& b) { return a.number < b.number; });
    return false;
  }
  const glm::dvec3 normal = glm::cross(geometry.direction[0], geometry.direction[1]);
  const auto height = [&](const DicomPlace& place) { return glm::dot(*place.position, normal); };
  std::stable_sort(places.begin(), places.end(),
                   [&](const DicomPlace& a, const DicomPlace& b) { return height(a) < height(b); });
  const glm::dvec3 step =
      (*places.back().position - *places.front().position) / static_cast<double>(places.size() - 1);
  const double mean_gap = glm::dot(step, normal);
  const auto fail = [&](std::size_t i, const std::string& why) {
    return unusable(words.path, places[i - 1].name + " and " + places[i].name + " are " + why);
  };
  for (std::size_t i = 1; i < places.size(); ++i)
    if (!(height(places[i]) - height(places[i - 1]) > kSamePosition * mean_gap) ||
        !std::isfinite(mean_gap))
      throw fail(i, "at the same position " + words.same_position);
  double greatest_deviation = 0;
  std::size_t at = 1;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const double deviation = std::abs(height(places[i]) - height(places[i - 1]) - mean_gap);
    if (deviation <= greatest_deviation) continue;
    greatest_deviation = deviation;
    at = i;
  }
  if (greatest_deviation > kMostUneven * mean_gap)
    throw fail(at, std::to_string(height(places[at]) - height(places[at - 1])) +
                       " mm apart and others " + std::to_string(mean_gap) + " mm on average; " +
                       words.gap);
  if (greatest_deviation > kNotedUneven * mean_gap)
    notes.push_back("slice distances differ by up to " + std::to_string(greatest_deviation) +
                    " mm; their mean was used");
  geometry.origin = *places.front().position;
  geometry.spacing.z = glm::length(step);
  geometry.direction[2] = step / geometry.spacing.z;
  return true;
}

std::optional<glm::dvec3> dicomPosition(const std::string& text) {
  const std::vector<double> p = decimalStrings(text, 3);
  if (p.empty()) return std::nullopt;
  return glm::dvec3(p[0], p[1], p[2]);
}

namespace {

// Dimensions for the place of a frame, and those for its time: delays, times and phases of a
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

// The values of an element that all slices are to share; empty if none has it.
std::vector<double> sharedNumbers(const std::string& path, const DicomHeader& header,
                                  const std::vector<std::size_t>& frames, std::uint32_t tag,
                                  std::size_t count, const char* what) {
  const std::vector<double> first = decimalStrings(header.value(tag, frames.front()), count);
  for (const std::size_t frame : frames) {
    const std::vector<double> other = decimalStrings(header.value(tag, frame), count);
    if (!areNear(first, other))
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

// The number of frames, of which the header states the places of all or none.
std::size_t countFrames(const std::string& path, const DicomHeader& header) {
  const auto count = static_cast<std::size_t>(integer(header.value(dicom::kNumberOfFrames), 1));
  if (count > kMaxVoxelsPerAxis)
    throw unusable(path, "it has " + std::to_string(count) +
                             " frames, and isobrick takes at most " +
                             std::to_string(kMaxVoxelsPerAxis));
  if (!header.frames.empty() && header.frames.size() != count)
    throw unusable(path, "it says of " + std::to_string(header.frames.size()) +
                             " frames where they are, and has " + std::to_string(count));
  return count;
}

// Sorts the frames of one volume, and takes the geometry from them.
void placeFrames(const DicomStackWords& words, const DicomHeader& header,
                 const OpenOptions& options, std::vector<DicomPlace>& places, VolumeInfo& info) {
  const std::vector<std::size_t> frames = framesOf(places);
  sharedNumbers(words.path, header, frames, dicom::kImageOrientation, 6, "orientation");
  const std::vector<double> pixel_spacing =
      sharedNumbers(words.path, header, frames, dicom::kPixelSpacing, 2, "pixel spacing");
  const ImagePlane plane = planeOf(header.value(dicom::kImageOrientation, frames.front()));
  GridGeometry& geometry = info.geometry;
  geometry.unit = LengthUnit::kMillimetre;
  geometry.direction = glm::dmat3(plane.row, plane.column, plane.normal());
  if (!pixel_spacing.empty())  // between rows first
    geometry.spacing = {pixel_spacing[1], pixel_spacing[0], 1};
  else if (!options.spacing)
    info.notes.push_back("the file has no pixel spacing: 1 mm is an assumption");
  if (sortDicomSlices(words, places, geometry, info.notes)) return;
  for (const std::uint32_t tag : {dicom::kSliceThickness, dicom::kSpacingBetweenSlices}) {
    const std::vector<double> distance = decimalStrings(header.value(tag, frames.front()), 1);
    if (!distance.empty() && distance[0] > 0) geometry.spacing.z = distance[0];
  }
  if (!options.spacing)
    info.notes.push_back("frames have no positions: their order and their distance, " +
                         shortText(geometry.spacing.z) + " mm, are assumptions");
}

}  // namespace

bool hasDicomFrames(const DicomHeader& header) {
  return header.hasGroups() && integer(header.value(dicom::kNumberOfFrames), 1) > 1;
}

DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options) {
  refuseOtherImages(path, header);
  DicomFrames volume;
  volume.frames_in_file = countFrames(path, header);
  VolumeInfo& info = volume.info;
  info.source = path;
  info.format = "DICOM";
  const DicomStackWords words = {
      path, "and of the same time (several echoes, or copies); take them apart into files",
      "find the missing frames or resample the volume"};

  bool times_differ = false;
  std::vector<DicomPlace> places = placesOf(header, volume.frames_in_file, times_differ);
  const auto normalOf = [&](const DicomPlace& place) {
    return planeOf(header.value(dicom::kImageOrientation, place.index)).normal();
  };
  chooseDicomVolume(words, normalOf, times_differ, options, places, info);
  if (places.size() < 2)
    throw unusable(path, "the volume is a single slice; choose one of several slices");
  placeFrames(words, header, options, places, info);
  info.voxels = {integer(header.value(dicom::kColumns), 0), integer(header.value(dicom::kRows), 0),
                 static_cast<std::int64_t>(places.size())};
  checkVoxelCounts(path, info.voxels);
  tidyGeometry(path, info.geometry, info.voxels, info.notes);

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
