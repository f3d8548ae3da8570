// MetaImage: a text header, and numbers behind it or in other files.
#include <algorithm>
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

// LONG is of 4 bytes, as MetaIO has it.
const std::map<std::string, StoredType>& metaImageTypes() {
  static const std::map<std::string, StoredType> kTypes = {
      {"met_char", StoredType::kInt8},         {"met_ascii_char", StoredType::kInt8},
      {"met_uchar", StoredType::kUint8},       {"met_short", StoredType::kInt16},
      {"met_ushort", StoredType::kUint16},     {"met_int", StoredType::kInt32},
      {"met_uint", StoredType::kUint32},       {"met_long", StoredType::kInt32},
      {"met_ulong", StoredType::kUint32},      {"met_long_long", StoredType::kInt64},
      {"met_ulong_long", StoredType::kUint64}, {"met_float", StoredType::kFloat32},
      {"met_double", StoredType::kFloat64}};
  return kTypes;
}

class MetaImageReader {
 public:
  MetaImageReader(const std::string& path, HeaderText header)
      : path_(path), header_(std::move(header)) {}

  std::unique_ptr<VolumeSource> open(const OpenOptions& options) {
    VolumeInfo info;
    info.source = path_;
    info.format = "MetaImage";
    StoredArray array;
    takeAxes(array);
    takeFiles(array);
    info.voxels = volumeVoxels(path_, array.axes);
    info.geometry = oneGrid(path_, places(), info.voxels, info.notes);
    const bool states_unit = header_.fields.contains("distanceunits");
    const std::string stated = value("distanceunits");
    const std::string unit = !states_unit ? "mm" : stated == "?" ? "" : stated;
    takeLengthUnits({unit, unit, unit}, info);
    return openStoredArray(std::move(info), array, options);
  }

 private:
  std::string value(const std::string& name) const { return header_.value(name); }
  // Of the first of these that the header has.
  std::string firstOf(std::initializer_list<const char*> names) const {
    for (const char* name : names)
      if (header_.fields.contains(name)) return value(name);
    return "";
  }
  bool isTrue(const std::string& name, bool otherwise) const {
    const std::string text = value(name);
    return text.empty() ? otherwise : text[0] == 'T' || text[0] == 't' || text[0] == '1';
  }
  Error wrong(const std::string& field, const std::string& text, const std::string& what) const {
    return HeaderText::wrong(path_, field, text, what);
  }

  void takeAxes(StoredArray& array) {
    using Use = StoredAxis::Use;
    const auto sizes = wholeNumbersOf(value("dimsize"));
    const auto axes = wholeNumberOf(value("ndims"));
    constexpr std::int64_t kMostAxes = 10;  // of MetaIO
    if (!sizes || sizes->empty() || !axes || *axes > kMostAxes || *axes != std::ssize(*sizes) ||
        std::ranges::any_of(*sizes, [](std::int64_t size) { return size < 1; }))
      throw wrong("DimSize", value("dimsize"), "is not as many counts as its NDims says");
    sizes_ = *sizes;
    std::int64_t channels = 1;
    if (const std::string text = value("elementnumberofchannels"); !text.empty()) {
      const auto count = wholeNumberOf(text);
      if (!count || *count < 1) throw wrong("ElementNumberOfChannels", text, "is no count");
      channels = *count;
    }
    array.axes = {{channels, Use::kValues}};
    for (std::size_t i = 0; i < sizes_.size(); ++i)
      array.axes.push_back({sizes_[i], i < 3 ? Use::kSpace : i == 3 ? Use::kTime : Use::kValues});
    std::string name = lowercase(value("elementtype"));
    if (name.ends_with("_array")) name.resize(name.size() - 6);
    const auto type = metaImageTypes().find(name);
    if (type == metaImageTypes().end())
      throw wrong("ElementType", value("elementtype"), "is none that is read");
    array.stored.type = type->second;
  }

  void takeFiles(StoredArray& array) const {
    NumberFiles& files = array.files;
    files.header_path = path_;
    const bool is_text = !isTrue("binarydata", true);
    files.form = isTrue("compresseddata", false) ? NumberFiles::Form::kGzip
                 : is_text                       ? NumberFiles::Form::kText
                                                 : NumberFiles::Form::kBytes;
    // Of two fields that contradict each other, MetaIO believes the first.
    array.stored.big_endian =
        !is_text && isTrue("elementbyteordermsb", isTrue("binarydatabyteordermsb", false));
    files.paths = metaImageDataFiles(path_, header_, sizes_);
    if (lowercase(value("elementdatafile")) == "local") files.first_byte = header_.endIn(path_);
    if (!header_.fields.contains("headersize")) return;
    const auto skip = wholeNumberOf(value("headersize"));
    if (!skip || *skip < NumberFiles::kAllBefore)
      throw wrong("HeaderSize", value("headersize"), "is no count of bytes");
    // In front of what is packed.
    if (*skip == NumberFiles::kAllBefore)
      files.skipped_bytes = NumberFiles::kAllBefore;
    else
      files.first_byte += static_cast<std::uint64_t>(*skip);
  }

  // A row of the matrix is the direction of an axis. CenterOfRotation and AnatomicalOrientation
  // move nothing, as in ITK.
  StatedPlaces places() const {
    const std::size_t axes = sizes_.size();
    const auto numbers = [&](std::initializer_list<const char*> names, std::size_t count,
                             double otherwise) {
      const std::string text = firstOf(names);
      if (text.empty()) return std::vector<double>(count, otherwise);
      const auto found = numbersOf(text);
      if (!found || found->size() < count)
        throw wrong(*names.begin(), text, concat("is not ", count, " numbers"));
      return *found;
    };
    const std::vector<double> spacing = numbers({"elementspacing", "elementsize"}, axes, 1);
    const std::vector<double> origin = numbers({"offset", "position", "origin"}, axes, 0);
    std::vector<double> matrix =
        numbers({"transformmatrix", "rotation", "orientation"}, axes * axes, 0);
    if (firstOf({"transformmatrix", "rotation", "orientation"}).empty())
      for (std::size_t i = 0; i < axes; ++i) matrix[i * axes + i] = 1;
    StatedPlaces places;
    for (std::size_t axis = 0; axis < std::min<std::size_t>(axes, 3); ++axis) {
      for (std::size_t row = 0; row < std::min<std::size_t>(axes, 3); ++row)
        places.steps[static_cast<int>(axis)][static_cast<int>(row)] =
            matrix[axis * axes + row] * spacing[axis] + 0.0;  // no negative zeros
      places.origin[static_cast<int>(axis)] = origin[axis];
    }
    return places;
  }

  std::string path_;
  HeaderText header_;
  std::vector<std::int64_t> sizes_;
};

}  // namespace

bool isMetaImageFile(const std::string& path) {
  const std::string ending = lowerExtension(path);
  return ending == ".mhd" || ending == ".mha";
}

std::unique_ptr<VolumeSource> openMetaImageSource(const std::string& path,
                                                  const OpenOptions& options) {
  static_cast<void>(InputFile(path));  // says what is wrong with a path
  auto header = readMetaImageHeader(path);
  if (!header)
    throw unreadable(
        path,
        "it has no ElementDataFile, the last line of a MetaImage header; get the whole file again");
  return MetaImageReader(path, std::move(*header)).open(options);
}

}  // namespace isobrick
