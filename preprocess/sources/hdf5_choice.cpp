#include <expat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <glm/geometric.hpp>
#include <glm/mat4x4.hpp>
#include <memory>
#include <new>
#include <sstream>
#include <string_view>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/hdf5_dataset.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"

namespace isobrick {
namespace {

struct XmlElement {
  std::string name;
  std::map<std::string, std::string> attributes;
  std::string text;  // between its own tags, without blanks around it
  std::vector<XmlElement> children;

  // The first child of that name, and so on; null if there is none.
  const XmlElement* find(std::initializer_list<std::string_view> path) const;
  // The text of find(); "" if there is none.
  std::string textOf(std::initializer_list<std::string_view> path) const;
  // "" if there is none.
  std::string attribute(const std::string& name) const;
};

constexpr std::uint64_t kMostXmlBytes = std::uint64_t{64} << 20;
constexpr std::size_t kMostXmlDepth = 64;

std::string withoutBlanks(const std::string& text) {
  constexpr const char* kBlanks = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) + 1 - first);
}

// Open elements, the innermost last: an element joins the one around it at its end.
struct XmlBuilder {
  XML_Parser parser;
  std::vector<XmlElement> open = std::vector<XmlElement>(1);

  static void onStart(void* self, const XML_Char* name, const XML_Char** pairs) {
    auto& builder = *static_cast<XmlBuilder*>(self);
    if (builder.open.size() > kMostXmlDepth) {
      XML_StopParser(builder.parser, XML_FALSE);
      return;
    }
    XmlElement& element = builder.open.emplace_back();
    element.name = name;
    for (; *pairs != nullptr; pairs += 2) element.attributes[pairs[0]] = pairs[1];
  }
  static void onEnd(void* self, const XML_Char*) {
    auto& open = static_cast<XmlBuilder*>(self)->open;
    XmlElement element = std::move(open.back());
    open.pop_back();
    element.text = withoutBlanks(element.text);
    open.back().children.push_back(std::move(element));
  }
  static void onText(void* self, const XML_Char* text, int length) {
    static_cast<XmlBuilder*>(self)->open.back().text.append(text, static_cast<std::size_t>(length));
  }
  static void onDoctype(void* self, const XML_Char*, const XML_Char*, const XML_Char*, int) {
    XML_StopParser(static_cast<XmlBuilder*>(self)->parser, XML_FALSE);
  }
};

struct FreeParser {
  void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
};

const XmlElement* XmlElement::find(std::initializer_list<std::string_view> path) const {
  const XmlElement* at = this;
  for (const std::string_view step : path) {
    const XmlElement* next = nullptr;
    for (const XmlElement& child : at->children)
      if (child.name == step && next == nullptr) next = &child;
    if (next == nullptr) return nullptr;
    at = next;
  }
  return at;
}

std::string XmlElement::textOf(std::initializer_list<std::string_view> path) const {
  const XmlElement* const found = find(path);
  return found == nullptr ? "" : found->text;
}

std::string XmlElement::attribute(const std::string& key) const {
  const auto found = attributes.find(key);
  return found == attributes.end() ? "" : found->second;
}

// The root of the file. Throws Error, naming the byte, if it is not well-formed XML, has a
// declaration of types, or more than 64 MiB.
XmlElement readXml(const std::string& path) {
  const InputFile file(path);
  if (file.size() > kMostXmlBytes)
    throw unusable(path, "its XML has more than 64 MiB; take a part of it");
  std::string bytes(static_cast<std::size_t>(file.size()), '\0');
  bytes.resize(file.readAt(0, bytes.data(), bytes.size()));
  const std::unique_ptr<XML_ParserStruct, FreeParser> parser(XML_ParserCreate(nullptr));
  if (!parser) throw std::bad_alloc();
  XmlBuilder builder{parser.get()};
  XML_SetUserData(parser.get(), &builder);
  XML_SetElementHandler(parser.get(), XmlBuilder::onStart, XmlBuilder::onEnd);
  XML_SetCharacterDataHandler(parser.get(), XmlBuilder::onText);
  XML_SetStartDoctypeDeclHandler(parser.get(), XmlBuilder::onDoctype);
  if (XML_Parse(parser.get(), bytes.data(), static_cast<int>(bytes.size()), 1) != XML_STATUS_OK)
    throw unreadable(
        path, "its XML is not well-formed at line ", XML_GetCurrentLineNumber(parser.get()), " (",
        XML_ErrorString(XML_GetErrorCode(parser.get())), "); correct it, or get it again");
  return std::move(builder.open.front().children.front());
}

std::vector<double> doublesOf(const std::string& text) {
  return numbersOf(text).value_or(std::vector<double>());
}

std::int64_t integerOf(const std::string& text) { return numberIn<std::int64_t>(text).value_or(0); }

std::string hdf5PathOf(const std::string& path, const XmlElement& root) {
  const XmlElement* const loader = root.find({"SequenceDescription", "ImageLoader"});
  const XmlElement* const file = loader == nullptr ? nullptr : loader->find({"hdf5"});
  if (file == nullptr)
    throw unusable(path, "its images lie in ",
                   quotedText(loader == nullptr ? "nothing" : loader->attribute("format"), 40),
                   ", and only 'bdv.hdf5' is read; name the images themselves, or save it as "
                   "XML/HDF5 with Fiji");
  const std::filesystem::path said(file->text);
  if (file->attribute("type") != "relative") return file->text;
  return (std::filesystem::path(path).parent_path() / root.textOf({"BasePath"}) / said)
      .lexically_normal()
      .string();
}

// Transforms of a view: the last one is applied first.
glm::dmat4 placeOf(const std::string& path, const XmlElement& registration) {
  glm::dmat4 place(1.0);
  for (const XmlElement& transform : registration.children) {
    if (transform.name != "ViewTransform") continue;
    const std::vector<double> rows = doublesOf(transform.textOf({"affine"}));
    if (rows.size() != 12)
      throw unusable(path, "a transform of its views is not twelve numbers; correct it");
    glm::dmat4 step(1.0);
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column)
        step[column][row] = rows[static_cast<std::size_t>(4 * row + column)];
    place = place * step;
  }
  return place;
}

}  // namespace

BdvDataset readBdvXml(const std::string& path) {
  const XmlElement root = readXml(path);
  if (root.name != "SpimData")
    throw unusable(path, "it is XML of ", quotedText(root.name, 40),
                   ", and only BigDataViewer's (SpimData) is read; name the volume itself");
  BdvDataset dataset;
  dataset.xml_path = path;
  dataset.hdf5_path = hdf5PathOf(path, root);
  if (const auto* const setups = root.find({"SequenceDescription", "ViewSetups"}))
    for (const XmlElement& setup : setups->children) {
      const std::vector<double> size = doublesOf(setup.textOf({"voxelSize", "size"}));
      if (setup.name != "ViewSetup" || size.size() != 3) continue;
      const std::int64_t id = integerOf(setup.textOf({"id"}));
      dataset.voxel_sizes[id] = {size[0], size[1], size[2]};
      dataset.units[id] = setup.textOf({"voxelSize", "unit"});
    }
  if (const auto* const registrations = root.find({"ViewRegistrations"}))
    for (const XmlElement& view : registrations->children)
      if (view.name == "ViewRegistration")
        dataset
            .places[{integerOf(view.attribute("setup")), integerOf(view.attribute("timepoint"))}] =
            placeOf(path, view);
  return dataset;
}

GridGeometry BdvDataset::geometryOf(std::int64_t setup, std::int64_t time) const {
  GridGeometry geometry;
  const auto size = voxel_sizes.find(setup);
  if (size != voxel_sizes.end()) geometry.spacing = size->second;
  const auto place = places.find({setup, time});
  if (place == places.end()) return geometry;
  glm::dvec3 steps;
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3 column(place->second[axis]);
    steps[axis] = glm::length(column);
    if (!(steps[axis] > 0))
      throw unusable(xml_path, "the place of its view ", setup,
                     " makes an axis vanish; correct it");
    geometry.direction[axis] = column / steps[axis];
  }
  geometry.origin = glm::dvec3(place->second[3]);
  if (size == voxel_sizes.end()) {
    geometry.spacing = steps;
    return geometry;
  }
  // BigStitcher counts in voxels of the least size: all lengths by one factor.
  const glm::dvec3 factors = geometry.spacing / steps;
  constexpr double kMostRelative = 1e-3;
  for (int axis = 1; axis < 3; ++axis)
    if (std::abs(factors[axis] / factors[0] - 1) > kMostRelative)
      throw unusable(xml_path, "its voxels have the size ", pointText(geometry.spacing),
                     " and its view ", setup, " places them ", pointText(steps),
                     " apart, in other proportions; correct one of them");
  geometry.origin *= factors[0];
  return geometry;
}

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
  ListText list;
  for (const auto& [number, link] : links) list.add(number);
  throw fileError(splitHdf5Name(name).first, "'", name, "' has the ", kind, "s ", list.text(),
                  wanted ? ", and not " + std::to_string(*wanted) : "; one is a volume", remedy);
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

OneOfSeveral oneOf(const NumberedLinks& links, std::int64_t number) {
  const std::int64_t count = std::ssize(links);
  const bool has_gaps = links.begin()->first != 0 || links.rbegin()->first != count - 1;
  return {number, has_gaps ? 0 : count};
}

void noteChoice(Hdf5Choice& choice, const OpenOptions& options) {
  choice.took_time = options.time.has_value();
  choice.took_channel = options.channel.has_value();
  if (options.time) choice.encoding = concat("time ", *options.time);
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
  const NumberedLinks times = numberedLinks(file, "/", "t");
  const auto time = pick(name, "time", times, options.time, Remedy::kChooseTime);
  const NumberedLinks setups = numberedLinks(file, "/" + time.second, "s");
  const auto setup = pick(name, "setup", setups, options.channel, Remedy::kChooseVariant);
  Hdf5Choice choice = bdvLevel(file, "/" + time.second + "/" + setup.second + "/0/cells",
                               setup.second, time.first, setup.first, 0, xml);
  choice.time_step = oneOf(times, time.first);
  choice.channel = oneOf(setups, setup.first);
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
      throw unusableDataset(name, "its size ", pointText(*size),
                            " is none; correct the attributes of the channel");
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

// Colours are three shares, "1.0 0.5 0.0".
std::vector<VolumeChannel> channelsOfImaris(hid_t file, std::int64_t count) {
  std::vector<VolumeChannel> channels;
  for (std::int64_t number = 0; number < count; ++number) {
    const std::string group = concat("/DataSetInfo/", kChannel, number);
    const Hdf5Handle info(H5Gopen2(file, group.c_str(), H5P_DEFAULT), H5Gclose);
    if (!info.isValid()) break;
    VolumeChannel& channel = channels.emplace_back();
    channel.name = Hdf5Attribute(info.id(), "Name").text();
    std::istringstream shares(Hdf5Attribute(info.id(), "Color").text());
    std::array<double, 3> share{};
    if (shares >> share[0] >> share[1] >> share[2]) {
      std::uint32_t color = 0;
      for (const double one : share)
        color =
            color << 8 | static_cast<std::uint32_t>(std::lround(255 * std::clamp(one, 0.0, 1.0)));
      channel.color = color;
    }
  }
  return channels;
}

Hdf5Choice chooseOfImaris(hid_t file, const std::string& name, const std::string& named,
                          const OpenOptions& options) {
  Hdf5Choice choice;
  choice.dataset = named;
  if (named.empty()) {
    const std::string level = std::string("/DataSet/") + kLevel + "0";
    const NumberedLinks times = numberedLinks(file, level, kTimePoint);
    const auto time = pick(name, "time", times, options.time, Remedy::kChooseTime);
    const std::string point = level + "/" + time.second;
    const NumberedLinks channels = numberedLinks(file, point, kChannel);
    const auto channel = pick(name, "channel", channels, options.channel, Remedy::kChooseVariant);
    choice.time_step = oneOf(times, time.first);
    choice.channel = oneOf(channels, channel.first);
    choice.named_channels = channelsOfImaris(file, choice.channel.count);
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
    throw fileError(splitHdf5Name(name).first, "'", splitHdf5Name(name).first, "' has no dataset ",
                    quotedText(named, 100), " that can be opened; it has ",
                    namesText(datasetNames(file)));
  if (isBdv(file)) return chooseOfBdv(file, name, named, xml, options);
  if (isImaris(file)) return chooseOfImaris(file, name, named, options);
  if (!named.empty()) return {.dataset = named};
  const std::vector<std::string> names = datasetNames(file);
  if (names.size() != 1)
    throw fileError(splitHdf5Name(name).first, "which dataset of '", name, "' is unclear: it has ",
                    namesText(names), "; name one, as in ", name, ":/path");
  return {.dataset = names.front()};
}

}  // namespace isobrick
