#include "isobrick/preprocess/sources/hdf5_choice.h"

#include <algorithm>
#include <array>
#include <map>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/sources/hdf5_objects.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

// The links of a group that are this word and a number, by their numbers.
using NumberedLinks = std::map<std::int64_t, std::string>;
NumberedLinks numberedLinks(hid_t file, const std::string& group, const std::string& word) {
  NumberedLinks links;
  const Hdf5Handle opened(H5Gopen2(file, group.c_str(), H5P_DEFAULT), H5Gclose);
  if (!opened.isValid()) return links;
  for (const std::string& name : linkNames(opened.id()))
    if (name.starts_with(word))
      if (const auto number = numberIn<std::int64_t>(name.substr(word.size())))
        links[*number] = name;
  return links;
}

bool hasGroup(hid_t file, const std::string& name) {
  return Hdf5Handle(H5Gopen2(file, name.c_str(), H5P_DEFAULT), H5Gclose).isValid();
}

// The one of these that is wanted, or that is alone.
NumberedLinks::value_type pick(const std::string& name, const char* kind,
                               const NumberedLinks& links,
                               const std::optional<std::int64_t>& wanted, Remedy remedy) {
  if (!wanted && links.size() == 1) return *links.begin();
  if (wanted)
    if (const auto found = links.find(*wanted); found != links.end()) return *found;
  constexpr std::size_t kMostListed = 12;
  std::string list;
  std::size_t listed = 0;
  for (const auto& [number, link] : links) {
    if (listed++ == kMostListed) break;
    list += (list.empty() ? "" : ", ") + std::to_string(number);
  }
  if (links.size() > kMostListed) list += ", ...";
  throw Error("'" + name + "' has the " + kind + "s " + list +
                  (wanted ? ", and not " + std::to_string(*wanted) : "; one is a volume"),
              {.path = splitHdf5Name(name).first}, {remedy});
}

// Parts of a path between slashes.
std::vector<std::string> partsOf(const std::string& path) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < path.size();) {
    const std::size_t slash = std::min(path.find('/', at), path.size());
    if (slash > at) parts.push_back(path.substr(at, slash - at));
    at = slash + 1;
  }
  return parts;
}

std::optional<std::int64_t> numberBehind(const std::string& text, const std::string& word) {
  if (!text.starts_with(word)) return std::nullopt;
  return numberIn<std::int64_t>(text.substr(word.size()));
}

void noteChoice(Hdf5Choice& choice, const OpenOptions& options) {
  choice.took_time = options.time.has_value();
  choice.took_channel = options.channel.has_value();
  if (options.time) choice.encoding = "time " + std::to_string(*options.time);
  if (options.channel)
    choice.encoding +=
        (choice.encoding.empty() ? "" : ", ") + ("channel " + std::to_string(*options.channel));
}

// ---- BigDataViewer: /t00000/s00/0/cells and /s00/resolutions
// ---------------------------------------

bool isBdv(hid_t file) {
  const NumberedLinks times = numberedLinks(file, "/", "t"), setups = numberedLinks(file, "/", "s");
  return !times.empty() && !setups.empty() &&
         hasGroup(file, "/" + times.begin()->second + "/" + setups.begin()->second + "/0");
}

// A level's voxels are means of so many of the finest level.
glm::dvec3 bdvFactors(hid_t file, const std::string& setup, std::int64_t level) {
  const Hdf5Handle dataset(H5Dopen2(file, ("/" + setup + "/resolutions").c_str(), H5P_DEFAULT),
                           H5Dclose);
  const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
  const auto count = H5Sget_simple_extent_npoints(space.id());
  constexpr hssize_t kMost = 3 * 64;
  if (!dataset.isValid() || count > kMost || 3 * (level + 1) > count) return glm::dvec3(1);
  std::vector<double> all(static_cast<std::size_t>(count));
  if (H5Dread(dataset.id(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, all.data()) < 0)
    return glm::dvec3(1);
  const auto at = static_cast<std::size_t>(3 * level);
  return {all[at], all[at + 1], all[at + 2]};
}

Hdf5Choice bdvLevel(hid_t file, const std::string& dataset, const std::string& setup_link,
                    std::int64_t time, std::int64_t setup, std::int64_t level,
                    const BdvDataset* xml) {
  Hdf5Choice choice;
  choice.dataset = dataset;
  choice.is_zyx = choice.holds_uint16 = true;
  if (xml == nullptr && level == 0) return choice;
  GridGeometry geometry;
  if (xml != nullptr) {
    geometry = xml->geometryOf(setup, time);
    const auto unit = xml->units.find(setup);
    if (unit != xml->units.end()) choice.unit = unit->second;
  }
  const glm::dvec3 factors = bdvFactors(file, setup_link, level);
  for (int axis = 0; axis < 3; ++axis)
    geometry.origin +=
        geometry.direction[axis] * (geometry.spacing[axis] * (factors[axis] - 1) / 2);
  geometry.spacing *= factors;
  choice.geometry = geometry;
  return choice;
}

Hdf5Choice chooseOfBdv(hid_t file, const std::string& name, const std::string& named,
                       const BdvDataset* xml, const OpenOptions& options) {
  if (!named.empty()) {
    const auto parts = partsOf(named);
    if (parts.size() == 4 && parts[3] == "cells")
      if (const auto time = numberBehind(parts[0], "t"), setup = numberBehind(parts[1], "s"),
          level = numberIn<std::int64_t>(parts[2]);
          time && setup && level && *level >= 0)
        return bdvLevel(file, named, parts[1], *time, *setup, *level, xml);
    return {.dataset = named};
  }
  const auto time =
      pick(name, "time", numberedLinks(file, "/", "t"), options.time, Remedy::kChooseTime);
  const auto setup = pick(name, "setup", numberedLinks(file, "/" + time.second, "s"),
                          options.channel, Remedy::kChooseVariant);
  Hdf5Choice choice = bdvLevel(file, "/" + time.second + "/" + setup.second + "/0/cells",
                               setup.second, time.first, setup.first, 0, xml);
  noteChoice(choice, options);
  return choice;
}

// ---- Imaris: /DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data
// ---------------------------------

constexpr const char* kLevel = "ResolutionLevel ";
constexpr const char* kTimePoint = "TimePoint ";
constexpr const char* kChannel = "Channel ";

bool isImaris(hid_t file) { return hasGroup(file, "/DataSet") && hasGroup(file, "/DataSetInfo"); }

std::optional<glm::dvec3> threeNumbers(hid_t object, const std::array<const char*, 3>& names) {
  glm::dvec3 values;
  for (int axis = 0; axis < 3; ++axis) {
    const char* const name = names[static_cast<std::size_t>(axis)];
    const Hdf5Attribute attribute(object, name);
    const auto number = numberIn<double>(attribute.text());
    const auto numbers = attribute.numbers(1);
    if (!number && numbers.empty()) return std::nullopt;
    values[axis] = number ? *number : numbers.front();
  }
  return values;
}

// The extents are those of the voxels' outer faces.
void placeImaris(hid_t file, const std::string& name, Hdf5Choice& choice) {
  const std::string group = choice.dataset.substr(0, choice.dataset.rfind('/'));
  const Hdf5Handle channel(H5Gopen2(file, group.c_str(), H5P_DEFAULT), H5Gclose);
  const Hdf5Handle image(H5Gopen2(file, "/DataSetInfo/Image", H5P_DEFAULT), H5Gclose);
  auto size = threeNumbers(channel.id(), {"ImageSizeX", "ImageSizeY", "ImageSizeZ"});
  const auto whole = threeNumbers(image.id(), {"X", "Y", "Z"});
  if (!size && group.find(std::string(kLevel) + "0/") != std::string::npos) size = whole;
  if (!size) return;
  for (int axis = 0; axis < 3; ++axis)
    if (!((*size)[axis] >= 1 && (*size)[axis] <= static_cast<double>(kMaxVoxelsPerAxis)))
      throw Error("cannot use '" + name + "': its size " + pointText(*size) +
                      " is none; correct the attributes of the channel",
                  {.path = splitHdf5Name(name).first});
  choice.voxels = Index3(*size);
  const auto low = threeNumbers(image.id(), {"ExtMin0", "ExtMin1", "ExtMin2"});
  const auto high = threeNumbers(image.id(), {"ExtMax0", "ExtMax1", "ExtMax2"});
  if (!low || !high) return;
  GridGeometry geometry;
  geometry.spacing = (*high - *low) / *size;
  geometry.origin = *low + geometry.spacing / 2.0;
  choice.geometry = geometry;
  choice.unit = Hdf5Attribute(image.id(), "Unit").text();
}

Hdf5Choice chooseOfImaris(hid_t file, const std::string& name, const std::string& named,
                          const OpenOptions& options) {
  Hdf5Choice choice;
  choice.dataset = named;
  if (named.empty()) {
    const std::string level = std::string("/DataSet/") + kLevel + "0";
    const auto time = pick(name, "time", numberedLinks(file, level, kTimePoint), options.time,
                           Remedy::kChooseTime);
    const std::string point = level + "/" + time.second;
    const auto channel = pick(name, "channel", numberedLinks(file, point, kChannel),
                              options.channel, Remedy::kChooseVariant);
    choice.dataset = point + "/" + channel.second + "/Data";
    noteChoice(choice, options);
  }
  const auto parts = partsOf(choice.dataset);
  if (parts.size() == 5 && parts[0] == "DataSet" && parts[4] == "Data") {
    choice.is_zyx = true;
    placeImaris(file, name, choice);
  }
  return choice;
}

// ----------------------------------------------------------------------------------------------------

std::string namesText(const std::vector<std::string>& names) {
  return names.empty() ? "none of three axes" : quotedList(names);
}

}  // namespace

Hdf5Choice chooseHdf5Dataset(hid_t file, const std::string& name, const std::string& named,
                             const BdvDataset* xml, const OpenOptions& options) {
  if (!named.empty() && !Hdf5Handle(H5Dopen2(file, named.c_str(), H5P_DEFAULT), H5Dclose).isValid())
    throw Error("'" + splitHdf5Name(name).first + "' has no dataset " + quotedText(named, 100) +
                    " that can be opened; it has " + namesText(datasetNames(file)),
                {.path = splitHdf5Name(name).first});
  if (isBdv(file)) return chooseOfBdv(file, name, named, xml, options);
  if (isImaris(file)) return chooseOfImaris(file, name, named, options);
  if (!named.empty()) return {.dataset = named};
  const std::vector<std::string> names = datasetNames(file);
  if (names.size() != 1)
    throw Error("which dataset of '" + name + "' is unclear: it has " + namesText(names) +
                    "; name one, as in " + name + ":/path",
                {.path = splitHdf5Name(name).first});
  return {.dataset = names.front()};
}

}  // namespace isobrick
