#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <map>
#include <numbers>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_source.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Nearer than this share of their mean distance, slices are at the same position.
constexpr double kSamePosition = 1e-4;
// Of a voxel: how far a slice may be from where the grid has it, and how far if that is rounding.
constexpr double kMostOffGrid = 0.01, kMostRounding = 0.4;
// Positions of whole millimetres are exact, not rounded.
constexpr double kCoarsestDecimal = 0.1;

bool haveAllPositions(const std::vector<DicomPlace>& places) {
  return std::ranges::all_of(places,
                             [](const DicomPlace& place) { return place.position.has_value(); });
}

// Without positions it cannot be decided: true.
bool areSomeAtOnePosition(const std::vector<DicomPlace>& places, const glm::dvec3& normal) {
  if (!haveAllPositions(places)) return true;
  std::vector<double> heights;
  for (const DicomPlace& place : places) heights.push_back(glm::dot(*place.position, normal));
  std::ranges::sort(heights);
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
  ListText list;
  for (const auto& [stack, count] : counts)
    list.add(quotedText(stack, 40), " (", count, " slices)");
  if (!name.empty())
    throw unusable(path, "it has no stack of the name ", quotedText(name, 40), "; it has ",
                   list.text(), Remedy::kChooseStack);
  throw unusable(path, "it holds ", counts.size(), " stacks of slices: ", list.text(),
                 Remedy::kChooseStack);
}

// `member` of the places takes several values, each of which is a volume.
void chooseOneOf(const std::string& path, const char* what, Remedy remedy,
                 std::vector<std::int64_t> DicomPlace::*member, bool may_differ,
                 std::optional<std::int64_t> choice, std::vector<DicomPlace>& places,
                 VolumeInfo& info, OneOfSeveral VolumeInfo::*taken) {
  std::map<std::vector<std::int64_t>, std::size_t> counts;
  if (may_differ)
    for (const DicomPlace& place : places) ++counts[place.*member];
  const std::size_t count = std::max<std::size_t>(counts.size(), 1);
  if (choice && static_cast<std::uint64_t>(*choice) >= count)
    throw unusable(path, "it has no ", what, " ", *choice, "; it has ", count, ", counted from 0",
                   remedy);
  if (count == 1) return;
  if (!choice)
    throw unusable(path, "it holds ", count, " volumes, of ", what, " 0 to ", count - 1, remedy);
  const std::vector<std::int64_t> key = std::next(counts.begin(), *choice)->first;
  std::erase_if(places, [&](const DicomPlace& place) { return place.*member != key; });
  info.*taken = {*choice, static_cast<std::int64_t>(count)};
  takeNoteOfChoice(concat(what, " ", *choice), info);
}

// The slice that is furthest from where even steps from the first have it, along an axis of the
// grid, in voxels.
struct SliceOffset {
  double voxels = 0, millimetres = 0;
  std::size_t index = 0;
  int axis = 0;
  bool is_rounding = true;  // of the positions, in all slices
};

SliceOffset greatestOffset(const std::vector<DicomPlace>& places, const GridGeometry& geometry,
                           const glm::dvec3& step) {
  double rounding = places.front().rounding;
  for (const DicomPlace& place : places) rounding = std::min(rounding, place.rounding);
  if (rounding > kCoarsestDecimal) rounding = 0;
  SliceOffset greatest;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const glm::dvec3 offset =
        *places[k].position - (*places.front().position + static_cast<double>(k) * step);
    for (int axis = 0; axis < 3; ++axis) {
      const glm::dvec3& along = geometry.direction[axis];
      const double off = std::abs(glm::dot(offset, along));
      const double voxels = off / geometry.spacing[axis];
      // Of the first slice and of this one, half a unit each, in all three numbers.
      const double explained =
          rounding * (std::abs(along.x) + std::abs(along.y) + std::abs(along.z));
      greatest.is_rounding =
          greatest.is_rounding &&
          (voxels <= kMostOffGrid || (off <= explained * (1 + 1e-6) && voxels <= kMostRounding));
      if (voxels > greatest.voxels) greatest = {voxels, off, k, axis, greatest.is_rounding};
    }
  }
  return greatest;
}

}  // namespace

void chooseDicomVolume(const DicomStackWords& words,
                       const std::function<glm::dvec3(const DicomPlace&)>& normal,
                       bool times_differ, const OpenOptions& options,
                       std::vector<DicomPlace>& places, VolumeInfo& info) {
  chooseStack(words.path, options.grid, places, info);
  chooseOneOf(words.path, "time", Remedy::kChooseTime, &DicomPlace::time,
              times_differ || areSomeAtOnePosition(places, normal(places.front())), options.time,
              places, info, &VolumeInfo::time_step);
  chooseOneOf(words.path, "channel", Remedy::kChooseVariant, &DicomPlace::channel,
              areSomeAtOnePosition(places, normal(places.front())), options.channel, places, info,
              &VolumeInfo::channel);
}

bool sortDicomSlices(const DicomStackWords& words, std::vector<DicomPlace>& places,
                     GridGeometry& geometry, std::vector<std::string>& notes) {
  if (!haveAllPositions(places)) {
    std::ranges::stable_sort(
        places, [](const DicomPlace& a, const DicomPlace& b) { return a.number < b.number; });
    return false;
  }
  const glm::dvec3 normal =
      glm::normalize(glm::cross(geometry.direction[0], geometry.direction[1]));
  const auto height = [&](const DicomPlace& place) { return glm::dot(*place.position, normal); };
  std::ranges::stable_sort(
      places, [&](const DicomPlace& a, const DicomPlace& b) { return height(a) < height(b); });
  const auto count = static_cast<double>(places.size() - 1);
  const glm::dvec3 origin = *places.front().position;
  const glm::dvec3 step = (*places.back().position - origin) / count;
  const double gap = glm::dot(step, normal);
  const auto refuse = [&](std::size_t i, const std::string& why) {
    throw unusable(words.path, places[i - 1].name, " and ", places[i].name, " are ", why);
  };
  for (std::size_t i = 1; i < places.size(); ++i)
    if (!(height(places[i]) - height(places[i - 1]) > kSamePosition * gap) || !std::isfinite(gap))
      refuse(i, "at the same position " + words.same_position);

  geometry.origin = origin;
  geometry.spacing.z = gap;
  geometry.direction[2] = normal;
  const SliceOffset off = greatestOffset(places, geometry, gap * normal);
  if (off.voxels <= kMostOffGrid) return true;
  if (off.is_rounding) {
    notes.push_back("slices are up to " + shortText(off.voxels) +
                    " of a voxel beside their even distances, as positions are rounded");
    return true;
  }
  const double shift = glm::length(step - gap * normal);
  if (const SliceOffset tilted = greatestOffset(places, geometry, step);
      tilted.voxels <= kMostOffGrid || tilted.is_rounding)
    throw unusable(words.path, "each slice is shifted by ", shift,
                   " mm against the one before (a tilted gantry, ",
                   std::atan2(shift, gap) * 180 / std::numbers::pi,
                   " degrees); resample it to a rectangular grid first");
  const auto uneven = [&](std::size_t i) {
    return std::abs(height(places[i]) - height(places[i - 1]) - gap);
  };
  std::size_t at = 1;
  for (std::size_t i = 2; i < places.size(); ++i)
    if (uneven(i) > uneven(at)) at = i;
  if (off.axis == 2)
    refuse(at, concat(height(places[at]) - height(places[at - 1]), " mm apart and others ", gap,
                      " mm on average; ", words.gap));
  throw unusable(words.path, places[off.index].name, " is ", off.millimetres, " mm (", off.voxels,
                 " voxels) beside the line of the others; take it away, or resample the slices");
}

void takeDicomPosition(const std::string& text, DicomPlace& place) {
  const std::vector<double> p = decimalStrings(text, 3);
  if (p.empty()) return;
  place.position = glm::dvec3(p[0], p[1], p[2]);
  // Zeros at the end may be left out: the number with the most decimals tells.
  std::size_t decimals = 0;
  for (std::size_t at = text.find('.'); at != std::string::npos; at = text.find('.', at + 1)) {
    const std::size_t end = text.find_first_not_of("0123456789", at + 1);
    decimals = std::max(decimals, std::min(end, text.size()) - at - 1);
  }
  const bool is_exact = text.find_first_of("eE") != std::string::npos;
  place.rounding = is_exact ? 0 : std::pow(10.0, -static_cast<double>(decimals));
}

std::vector<double> dicomPixelSpacing(const DicomHeader& header, std::size_t frame) {
  for (const std::uint32_t tag :
       {dicom::kPixelSpacing, dicom::kImagerPixelSpacing, dicom::kNominalPixelSpacing})
    if (std::vector<double> spacing = decimalStrings(header.value(tag, frame), 2); !spacing.empty())
      return {spacing[1], spacing[0]};  // between rows first
  return {};
}

double dicomSliceDistance(const DicomHeader& header, std::size_t frame) {
  for (const std::uint32_t tag : {dicom::kSpacingBetweenSlices, dicom::kSliceThickness}) {
    const std::vector<double> distance = decimalStrings(header.value(tag, frame), 1);
    if (!distance.empty() && distance[0] > 0) return distance[0];
  }
  return 0;
}

GridGeometry dicomPlane(const std::string& orientation, const std::vector<double>& pixel_spacing,
                        const OpenOptions& options, const std::string& who,
                        std::vector<std::string>& notes) {
  GridGeometry geometry;
  geometry.unit = LengthUnit::kMillimetre;
  if (const std::vector<double> axes = decimalStrings(orientation, 6); !axes.empty()) {
    geometry.direction[0] = {axes[0], axes[1], axes[2]};
    geometry.direction[1] = {axes[3], axes[4], axes[5]};
    geometry.direction[2] = glm::cross(geometry.direction[0], geometry.direction[1]);
  }
  if (!pixel_spacing.empty())
    geometry.spacing = {pixel_spacing[0], pixel_spacing[1], 1};
  else if (!options.spacing)
    notes.push_back(who + " no pixel spacing: 1 mm is an assumption");
  return geometry;
}

bool areSameForPixels(const std::vector<double>& a, const std::vector<double>& b,
                      std::int64_t pixels, double unit) {
  constexpr double kDigits = 1e-6;  // that decimal strings keep
  const double most =
      std::max(kMostOffGrid / static_cast<double>(std::max<std::int64_t>(pixels, 1)), kDigits);
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [&](double x, double y) {
    return std::abs(x - y) <= most * std::max(unit, std::abs(x));
  });
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
    const auto isIn = [&](const auto& tags) { return std::ranges::find(tags, tag) != tags.end(); };
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
    place.name = concat("frame ", frame + 1);
    if (header.hasGroups()) takeDicomPosition(header.value(dicom::kImagePosition, frame), place);
    place.number = integer(header.value(dicom::kInStackPosition, frame),
                           static_cast<std::int64_t>(header.hasGroups() ? 0 : frame));
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

// Throws Error unless all frames have the same numbers, by `numbersOf` a frame.
template <typename NumbersOf>
void requireShared(const std::string& path, const std::vector<DicomPlace>& places,
                   std::int64_t pixels, double unit, const char* what, NumbersOf numbersOf) {
  const std::size_t first = places.front().index;
  for (const DicomPlace& place : places)
    if (!areSameForPixels(numbersOf(first), numbersOf(place.index), pixels, unit))
      throw unusable(path, "frame ", place.index + 1, " has another ", what, " than frame ",
                     first + 1, "; take its frames apart into volumes of one ", what);
}

// The number of frames, of which the header states the places of all or none.
std::size_t countFrames(const std::string& path, const DicomHeader& header) {
  const auto count = static_cast<std::size_t>(integer(header.value(dicom::kNumberOfFrames), 1));
  if (count > kMaxVoxelsPerAxis)
    throw unusable(path, "it has ", count, " frames, and isobrick takes at most ",
                   kMaxVoxelsPerAxis);
  if (!header.frames.empty() && header.frames.size() != count)
    throw unusable(path, "it says of ", header.frames.size(), " frames where they are, and has ",
                   count);
  return count;
}

// The frames of a dose grid are at distances along its normal.
void placeByOffsets(const DicomHeader& header, const glm::dvec3& normal,
                    std::vector<DicomPlace>& places) {
  const std::vector<double> offsets =
      decimalStrings(header.value(dicom::kGridFrameOffsets), places.size());
  DicomPlace first;
  takeDicomPosition(header.value(dicom::kImagePosition), first);
  if (offsets.empty() || !first.position) return;
  for (std::size_t k = 0; k < places.size(); ++k)
    places[k].position = *first.position + (offsets[k] - offsets[0]) * normal;
}

// Frames that no position, but their order tells apart.
void assumeDistance(const DicomHeader& header, const OpenOptions& options, std::size_t first,
                    VolumeInfo& info) {
  DicomPlace place;
  takeDicomPosition(header.value(dicom::kImagePosition, first), place);
  if (place.position) info.geometry.origin = *place.position;
  if (const double distance = dicomSliceDistance(header, first); distance > 0)
    info.geometry.spacing.z = distance;
  const std::string along = header.value(dicom::kFrameIncrementPointer);
  if (along == std::to_string(dicom::kFrameTime) ||
      along == std::to_string(dicom::kFrameTimeVector))
    info.notes.push_back("frames are steps of time in the file; they were stacked as slices");
  if (!options.spacing)
    info.notes.push_back("frames have no positions: their order and their distance, " +
                         shortText(info.geometry.spacing.z) + " mm, are assumptions");
}

// Sorts the frames of one volume, and takes the geometry from them.
void placeFrames(const DicomStackWords& words, const DicomHeader& header,
                 const OpenOptions& options, std::vector<DicomPlace>& places, VolumeInfo& info) {
  const std::int64_t pixels = std::max(info.voxels.x, info.voxels.y);
  requireShared(words.path, places, pixels, 1, "orientation", [&](std::size_t frame) {
    return decimalStrings(header.value(dicom::kImageOrientation, frame), 6);
  });
  requireShared(words.path, places, pixels, 0, "pixel spacing",
                [&](std::size_t frame) { return dicomPixelSpacing(header, frame); });
  const std::size_t first = places.front().index;
  info.geometry = dicomPlane(header.value(dicom::kImageOrientation, first),
                             dicomPixelSpacing(header, first), options, "the file has", info.notes);
  if (!header.hasGroups()) placeByOffsets(header, info.geometry.direction[2], places);
  if (!sortDicomSlices(words, places, info.geometry, info.notes))
    assumeDistance(header, options, first, info);
}

}  // namespace

std::string faultOfPixels(const DicomHeader& header) {
  if (header.value(dicom::kRows).empty())  // it was not walked to its end
    return "it does not say the size of its pictures, or its header is packed; convert it with its "
           "own software";
  const std::string photometric = header.value(dicom::kPhotometricInterpretation);
  if (integer(header.value(dicom::kSamplesPerPixel), 1) != 1 || photometric == "PALETTE COLOR")
    return "its pixels have colours; convert them to grey values first";
  if (!header.value(dicom::kTotalPixelMatrixColumns).empty())
    return "its frames are the tiles of one large picture, and no slices";
  const std::int64_t bits = integer(header.value(dicom::kBitsAllocated), 16);
  if (bits != 8 && bits != 16 && bits != 32)
    return concat("its pixels have ", bits, " bits; convert them to 8, 16 or 32 first");
  return "";
}

DicomFile dicomFile(const std::string& path, const DicomHeader& header) {
  DicomFile file;
  file.path = path;
  file.stamp = header.stamp;
  file.syntax = header.value(dicom::kTransferSyntax);
  file.pixels_at = header.pixels_at;
  file.packed_bytes = header.packed_bytes;
  file.columns = integer(header.value(dicom::kColumns), 0);
  file.rows = integer(header.value(dicom::kRows), 0);
  file.frames = std::max<std::int64_t>(integer(header.value(dicom::kNumberOfFrames), 1), 1);
  file.values = dicomValueMap(header);
  return file;
}

DicomFrames arrangeDicomFrames(const std::string& path, const DicomHeader& header,
                               const OpenOptions& options) {
  if (const std::string fault = faultOfPixels(header); !fault.empty()) throw unusable(path, fault);
  const DicomFile file = dicomFile(path, header);
  const std::size_t frames = countFrames(path, header);
  if (frames == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  if (!header.hasGroups() &&
      (options.time.value_or(0) != 0 || options.channel.value_or(0) != 0 || !options.grid.empty()))
    throw unusable(path,
                   "it does not say of its frames to which time, channel or stack they belong; "
                   "leave out the choice of one");
  DicomFrames volume;
  VolumeInfo& info = volume.info;
  info.source = path;
  info.format = "DICOM";
  const DicomStackWords words = {
      path, "and of the same time (several echoes, or copies); take them apart into files",
      "find the missing frames or resample the volume"};

  bool times_differ = false;
  std::vector<DicomPlace> places = placesOf(header, frames, times_differ);
  const auto normalOf = [&](const DicomPlace& place) {
    std::vector<std::string> unsaid;
    return dicomPlane(header.value(dicom::kImageOrientation, place.index), {}, options, "", unsaid)
        .direction[2];
  };
  if (header.hasGroups()) chooseDicomVolume(words, normalOf, times_differ, options, places, info);
  if (places.size() < 2)
    throw unusable(path, "the volume is a single slice; choose one of several slices");
  info.voxels = {file.columns, file.rows, static_cast<std::int64_t>(places.size())};
  checkVoxelCounts(path, info.voxels);
  placeFrames(words, header, options, places, info);
  tidyGeometry(path, info.geometry, info.voxels, info.notes);

  std::vector<DicomValueMap> maps;
  for (const DicomPlace& place : places) {
    maps.push_back(dicomValueMap(header, place.index));
    volume.slices.push_back({0, place.index, maps.back()});
  }
  takeDicomVoxelType(maps, options.dicom_float32, info);
  noteMonochrome1(header.value(dicom::kPhotometricInterpretation), info.notes);
  return volume;
}

}  // namespace isobrick
