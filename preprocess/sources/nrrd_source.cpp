// NRRD: a text header, and numbers behind it or in other files, of any number of axes.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/header_text.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_array.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// The names of each, without "int" behind another word.
const std::map<std::string, StoredType>& nrrdTypes() {
  static const std::map<std::string, StoredType> kTypes = {
      {"signed char", StoredType::kInt8},      {"int8", StoredType::kInt8},
      {"int8_t", StoredType::kInt8},           {"uchar", StoredType::kUint8},
      {"unsigned char", StoredType::kUint8},   {"uint8", StoredType::kUint8},
      {"uint8_t", StoredType::kUint8},         {"short", StoredType::kInt16},
      {"signed short", StoredType::kInt16},    {"int16", StoredType::kInt16},
      {"int16_t", StoredType::kInt16},         {"ushort", StoredType::kUint16},
      {"unsigned short", StoredType::kUint16}, {"uint16", StoredType::kUint16},
      {"uint16_t", StoredType::kUint16},       {"int", StoredType::kInt32},
      {"signed", StoredType::kInt32},          {"int32", StoredType::kInt32},
      {"int32_t", StoredType::kInt32},         {"uint", StoredType::kUint32},
      {"unsigned", StoredType::kUint32},       {"uint32", StoredType::kUint32},
      {"uint32_t", StoredType::kUint32},       {"longlong", StoredType::kInt64},
      {"long long", StoredType::kInt64},       {"signed long long", StoredType::kInt64},
      {"int64", StoredType::kInt64},           {"int64_t", StoredType::kInt64},
      {"ulonglong", StoredType::kUint64},      {"unsigned long long", StoredType::kUint64},
      {"uint64", StoredType::kUint64},         {"uint64_t", StoredType::kUint64},
      {"float", StoredType::kFloat32},         {"double", StoredType::kFloat64}};
  return kTypes;
}

// A space of the world, of so many axes, of which one may be time.
struct NrrdSpace {
  const char *name, *short_name;
  int axes;
  glm::dvec3 to_lps;  // by axis
};
constexpr NrrdSpace kNrrdSpaces[] = {{"right-anterior-superior", "ras", 3, {-1, -1, 1}},
                                     {"left-anterior-superior", "las", 3, {1, -1, 1}},
                                     {"left-posterior-superior", "lps", 3, {1, 1, 1}},
                                     {"right-anterior-superior-time", "rast", 4, {-1, -1, 1}},
                                     {"left-anterior-superior-time", "last", 4, {1, -1, 1}},
                                     {"left-posterior-superior-time", "lpst", 4, {1, 1, 1}},
                                     {"scanner-xyz", "", 3, {1, 1, 1}},
                                     {"scanner-xyz-time", "", 4, {1, 1, 1}},
                                     {"3d-right-handed", "", 3, {1, 1, 1}},
                                     {"3d-left-handed", "", 3, {1, 1, 1}},
                                     {"3d-right-handed-time", "", 4, {1, 1, 1}},
                                     {"3d-left-handed-time", "", 4, {1, 1, 1}}};

// What the fields say, in turn.
class NrrdReader {
 public:
  NrrdReader(const std::string& path, HeaderText header)
      : path_(path), header_(std::move(header)) {}

  std::unique_ptr<VolumeSource> open(const OpenOptions& options) {
    takeSizes();
    takeSpace();
    nameAxes();
    VolumeInfo info;
    info.source = path_;
    info.format = "NRRD";
    StoredArray array;
    for (const NrrdAxis& axis : axes_) array.axes.push_back({axis.size, axis.use});
    array.stored.type = type();
    takeFiles(array);
    info.voxels = volumeVoxels(path_, array.axes);
    info.geometry = oneGrid(path_, places(), info.voxels, info.notes);
    takeLengthUnits(units(), info);
    return openStoredArray(std::move(info), array, options);
  }

 private:
  using Use = StoredAxis::Use;
  struct NrrdAxis {
    std::int64_t size = 1;
    Use use = Use::kUnnamed;
    std::optional<glm::dvec3> direction;
    bool is_along_time = false;  // in a space that has it
    double spacing = std::numeric_limits<double>::quiet_NaN(), least = spacing, greatest = spacing;
    std::string centre, kind;
  };

  Error wrong(const std::string& field, const std::string& text, const std::string& what) const {
    return HeaderText::wrong(path_, field, text, what);
  }
  std::string value(const std::string& name) const { return header_.value(name); }

  void takeSizes() {
    const std::string text = value("sizes");
    const auto sizes = wholeNumbersOf(text);
    const auto dimension = wholeNumberOf(value("dimension"));
    constexpr std::size_t kMostAxes = 16;  // of the format
    if (!sizes || sizes->empty() || sizes->size() > kMostAxes || !dimension ||
        *dimension != std::ssize(*sizes) ||
        std::ranges::any_of(*sizes, [](std::int64_t size) { return size < 1; }))
      throw wrong("sizes", text, "are not as many counts as its dimension says");
    axes_.resize(sizes->size());
    for (std::size_t i = 0; i < axes_.size(); ++i) axes_[i].size = (*sizes)[i];
    take("spacings", [](NrrdAxis& axis, double number) { axis.spacing = number; });
    take("axismins", [](NrrdAxis& axis, double number) { axis.least = number; });
    take("axismaxs", [](NrrdAxis& axis, double number) { axis.greatest = number; });
    const std::vector<std::string> kinds = wordsOf(lowercase(value("kinds")));
    const std::vector<std::string> centres =
        wordsOf(lowercase(value("centers") + value("centerings")));
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      if (kinds.size() == axes_.size() && kinds[i] != "???" && kinds[i] != "none")
        axes_[i].kind = kinds[i];
      if (centres.size() == axes_.size()) axes_[i].centre = centres[i];
    }
  }

  template <typename Set>
  void take(const std::string& field, Set set) {
    if (!header_.fields.contains(field)) return;
    const auto numbers = numbersOf(value(field));
    if (!numbers || numbers->size() != axes_.size())
      throw wrong(field, value(field), "are not one number for each axis");
    for (std::size_t i = 0; i < axes_.size(); ++i) set(axes_[i], (*numbers)[i]);
  }

  // The vectors of the axes, turned to LPS.
  void takeSpace() {
    const std::string name = lowercase(value("space"));
    for (const NrrdSpace& space : kNrrdSpaces)
      if (!name.empty() && (name == space.name || name == space.short_name)) space_ = space;
    if (!name.empty() && space_.axes == 0)
      throw unusable(path_, "its space ", quotedText(name, 40),
                     " is not read; convert it to left-posterior-superior");
    if (const auto axes = wholeNumberOf(value("spacedimension")))
      space_.axes = static_cast<int>(std::clamp<std::int64_t>(*axes, 0, 16));
    if (!header_.fields.contains("spacedirections")) return;
    const std::string text = value("spacedirections");
    if (space_.axes != 3 && space_.axes != 4)
      throw unusable(path_, "its space has ", space_.axes,
                     " axes, and volumes of 3 are read; convert it first");
    std::size_t at = 0, axis = 0;
    for (; axis < axes_.size(); ++axis) {
      at = text.find_first_not_of(" \t", at);
      if (at == std::string::npos) break;
      if (text.compare(at, 4, "none") == 0) {
        at += 4;
        continue;
      }
      const std::size_t end = text.find(')', at);
      const auto vector = vectorIn(text.substr(at, end == std::string::npos ? end : end + 1 - at));
      if (!vector) throw wrong("space directions", text, "are not one vector for each axis");
      if (!std::isnan((*vector)[0])) {  // that of a vector that is none
        axes_[axis].is_along_time = vector->size() == 4 && (*vector)[3] != 0;
        axes_[axis].direction = toLps(*vector);
      }
      at = end + 1;
    }
    if (axis != axes_.size() || text.find_first_not_of(" \t", at) != std::string::npos)
      throw wrong("space directions", text, "are not one vector for each axis");
    has_directions_ = true;
  }

  // "(1,2,3)", of as many numbers as the space has axes.
  std::optional<std::vector<double>> vectorIn(std::string text) const {
    if (!text.starts_with('(') || !text.ends_with(')')) return std::nullopt;
    std::ranges::replace_if(
        text, [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
    auto numbers = numbersOf(text);
    if (numbers && std::ssize(*numbers) != space_.axes) return std::nullopt;
    return numbers;
  }

  glm::dvec3 toLps(const std::vector<double>& v) const {
    return glm::dvec3(v[0], v[1], v[2]) * space_.to_lps + 0.0;  // no negative zeros
  }

  // Which are of space: those with a direction, or of that kind, or the first three.
  void nameAxes() {
    const bool has_kinds =
        std::ranges::any_of(axes_, [](const NrrdAxis& axis) { return !axis.kind.empty(); });
    int of_space = 0;
    for (NrrdAxis& axis : axes_) {
      const bool may_be = has_directions_ ? axis.direction && !axis.is_along_time
                          : has_kinds     ? axis.kind == "domain" || axis.kind == "space"
                                          : axis.kind.empty();
      if (may_be && of_space < 3) {
        axis.use = Use::kSpace;
        ++of_space;
      } else if (axis.kind == "time" || axis.is_along_time || (may_be && !axis.kind.empty())) {
        axis.use = Use::kTime;
      } else if (!axis.kind.empty() && axis.kind != "list" && axis.kind != "domain" &&
                 axis.kind != "stub" && axis.kind != "scalar") {
        axis.use = Use::kValues;
      }
    }
  }

  StatedPlaces places() const {
    StatedPlaces places;
    int to = 0;
    for (const NrrdAxis& axis : axes_) {
      if (axis.use != Use::kSpace) continue;
      if (has_directions_) {
        places.steps[to] = *axis.direction;
      } else {
        const bool is_node = axis.centre == "node";
        const double extent = axis.greatest - axis.least;
        double step = axis.spacing;
        if (std::isnan(step) && !std::isnan(extent) && axis.size > 1)
          step = extent / static_cast<double>(is_node ? axis.size - 1 : axis.size);
        if (std::isnan(step)) step = 1;
        places.steps[to][to] = step;
        if (!std::isnan(axis.least)) places.origin[to] = axis.least + (is_node ? 0 : step / 2);
      }
      ++to;
    }
    const std::string text = value("spaceorigin");
    if (space_.axes == 0 || text.empty() || text == "none") return places;
    const auto origin = vectorIn(text);
    if (!origin) throw wrong("space origin", text, "is no vector of its space");
    if (!std::isnan((*origin)[0])) places.origin = toLps(*origin);
    return places;
  }

  // Of the world's axes, "" if none is stated. Spaces of patients and scanners are in millimetres
  // unless they say otherwise: the format takes them from DICOM and NIfTI.
  std::array<std::string, 3> units() const {
    const bool has_own = header_.fields.contains("spaceunits");
    std::vector<std::string> texts = quotedTexts(value(has_own ? "spaceunits" : "units"));
    if (!has_own && space_.name != nullptr && std::string(space_.name)[0] != '3')
      return {"mm", "mm", "mm"};
    if (!has_own && texts.size() == axes_.size()) {
      std::vector<std::string> of_space;
      for (std::size_t i = 0; i < axes_.size(); ++i)
        if (axes_[i].use == Use::kSpace) of_space.push_back(texts[i]);
      texts = of_space;
    }
    if (texts.size() < 3) return {};
    for (std::string& text : texts)
      if (text == "none" || text == "???") text.clear();
    return {texts[0], texts[1], texts[2]};
  }

  StoredType type() const {
    std::string name = lowercase(value("type"));
    if (name == "block")
      throw unusable(path_,
                     "its voxels are blocks of bytes without a meaning (type: block), which are "
                     "not read; write numbers");
    if (name.ends_with(" int") && name != "unsigned int" && name != "signed int")
      name.resize(name.size() - 4);  // "short int", "unsigned long long int"
    if (name == "unsigned int" || name == "signed int") name.resize(name.size() - 4);
    const auto found = nrrdTypes().find(name);
    if (found == nrrdTypes().end()) throw wrong("type", value("type"), "is none of the format's");
    return found->second;
  }

  void takeFiles(StoredArray& array) const {
    NumberFiles& files = array.files;
    files.header_path = path_;
    const std::string encoding = lowercase(value("encoding"));
    using Form = NumberFiles::Form;
    if (encoding == "gzip" || encoding == "gz")
      files.form = Form::kGzip;
    else if (encoding == "ascii" || encoding == "text" || encoding == "txt")
      files.form = Form::kText;
    else if (encoding == "hex")
      files.form = Form::kHex;
    else if (encoding == "bzip2" || encoding == "bz2")
      files.form = Form::kBzip2;
    else if (encoding != "raw")
      throw wrong("encoding", value("encoding"), "is none of the format's");
    const std::string endian = lowercase(value("endian"));
    if (files.form != Form::kText) {
      if (storedBytes(array.stored.type) > 1 && endian != "big" && endian != "little")
        throw wrong("endian", endian, "is neither big nor little");
      array.stored.big_endian = endian == "big";
    }
    std::vector<std::int64_t> sizes;
    for (const NrrdAxis& axis : axes_) sizes.push_back(axis.size);
    files.paths = nrrdDataFiles(path_, header_, sizes);
    if (!header_.fields.contains("datafile")) files.first_byte = header_.endIn(path_);
    const auto skip = [&](const std::string& field, std::int64_t least) -> std::int64_t {
      if (!header_.fields.contains(field)) return 0;
      const auto count = wholeNumberOf(value(field));
      if (!count || *count < least) throw wrong(field, value(field), "is no count");
      return *count;
    };
    files.skipped_lines = static_cast<std::uint64_t>(skip("lineskip", 0));
    files.skipped_bytes = skip("byteskip", NumberFiles::kAllBefore);
  }

  std::string path_;
  HeaderText header_;
  std::vector<NrrdAxis> axes_;
  NrrdSpace space_{nullptr, nullptr, 0, {1, 1, 1}};
  bool has_directions_ = false;
};

}  // namespace

bool isNrrdFile(const std::string& path) { return readNrrdHeader(path).has_value(); }

std::unique_ptr<VolumeSource> openNrrdSource(const std::string& path, const OpenOptions& options) {
  auto header = readNrrdHeader(path);
  if (!header) throw unreadable(path, "it is no NRRD file; check the path");
  return NrrdReader(path, std::move(*header)).open(options);
}

}  // namespace isobrick
