#include <expat.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/tiff_file.h"

namespace isobrick {
namespace {

// Planes that lie one behind the other, in the order of their image.
struct OmeRun {
  std::optional<std::int64_t> ifd;             // number of the first one's page
  std::optional<std::int64_t> count;           // of planes
  std::array<std::int64_t, 3> first{0, 0, 0};  // along Z, C and T
  std::string uuid, file;                      // of the file that has them; empty: this one
};

struct OmeImage {
  std::string name;
  std::string order;                           // "XYZCT"
  std::array<std::int64_t, 2> pixels{0, 0};    // along X and Y; 0: not stated
  std::array<std::int64_t, 3> sizes{0, 0, 0};  // along Z, C and T; 0: not stated
  std::int64_t samples = 1;                    // channels that are numbers of one pixel
  std::array<std::string, 3> spacing, units;   // along X, Y and Z; empty: not stated
  bool has_mixed_axis = false;                 // Z, C or T holds another axis, too
  std::vector<OmeRun> runs;
  std::vector<VolumeChannel> channels;
};

struct OmeDocument {
  std::string uuid;           // of the file
  std::string metadata_file;  // which has the description in place of this one
  std::vector<OmeImage> images;
};

// The attributes of an element, as Expat gives them: name, value, name, value, ..., null.
class OmeAttributes {
 public:
  explicit OmeAttributes(const XML_Char** pairs) : pairs_(pairs) {}
  std::string text(std::string_view key) const {
    for (const XML_Char** pair = pairs_; *pair != nullptr; pair += 2)
      if (key == pair[0]) return pair[1];
    return "";
  }
  std::optional<std::int64_t> number(std::string_view key) const {
    const auto number = numberIn<std::int64_t>(text(key));
    return number && *number >= 0 ? number : std::nullopt;
  }

 private:
  const XML_Char** pairs_;
};

constexpr std::string_view kPlaneAxes[] = {"Z", "C", "T"};

class OmeReader {
 public:
  OmeDocument read(const std::string& text) {
    const std::unique_ptr<XML_ParserStruct, Free> parser(XML_ParserCreate(nullptr));
    if (!parser) throw std::bad_alloc();
    parser_ = parser.get();
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, onStart, onEnd);
    XML_SetCharacterDataHandler(parser_, onText);
    XML_SetStartDoctypeDeclHandler(parser_, onDoctype);
    // Of broken XML, the part before is taken.
    static_cast<void>(XML_Parse(parser_, text.data(), static_cast<int>(text.size()), XML_TRUE));
    return std::move(document_);
  }

 private:
  struct Free {
    void operator()(XML_Parser parser) const { XML_ParserFree(parser); }
  };

  static void onStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    const std::string_view full(name);
    static_cast<OmeReader*>(self)->enter(full.substr(full.rfind(':') + 1),
                                         OmeAttributes(attributes));
  }
  static void onEnd(void* self, const XML_Char*) {
    static_cast<OmeReader*>(self)->is_in_uuid_ = false;
  }
  static void onText(void* self, const XML_Char* text, int characters) {
    auto& reader = *static_cast<OmeReader*>(self);
    if (reader.is_in_uuid_)
      reader.runs().back().uuid.append(text, static_cast<std::size_t>(characters));
  }
  static void onDoctype(void* self, const XML_Char*, const XML_Char*, const XML_Char*, int) {
    XML_StopParser(static_cast<OmeReader*>(self)->parser_, XML_FALSE);
  }

  void enter(std::string_view name, const OmeAttributes& attributes) {
    if (name == "OME") document_.uuid = attributes.text("UUID");
    if (name == "BinaryOnly") document_.metadata_file = attributes.text("MetadataFile");
    if (name == "Image") document_.images.emplace_back().name = attributes.text("Name");
    // Annotations behind the images say whether an axis holds two.
    for (const std::string_view axis : kPlaneAxes)
      if (name == "ModuloAlong" + std::string(axis))
        for (OmeImage& image : document_.images) image.has_mixed_axis = true;
    if (document_.images.empty()) return;
    OmeImage& image = document_.images.back();
    if (name == "Pixels") takePixels(attributes, image);
    if (name == "Channel") {
      image.samples =
          std::max<std::int64_t>(image.samples, attributes.number("SamplesPerPixel").value_or(1));
      VolumeChannel& channel = image.channels.emplace_back();
      channel.name = attributes.text("Name");
      // Red, green, blue and opacity, as a signed number of 32 bits.
      if (const auto color = numberIn<std::int64_t>(attributes.text("Color")))
        channel.color = static_cast<std::uint32_t>(*color >> 8 & 0xFFFFFF);
    }
    if (name == "TiffData") {
      OmeRun& run = image.runs.emplace_back();
      run.ifd = attributes.number("IFD");
      run.count = attributes.number("PlaneCount");
      if (!run.count) run.count = attributes.number("NumPlanes");  // its former name
      for (std::size_t axis = 0; axis < 3; ++axis)
        run.first[axis] = attributes.number("First" + std::string(kPlaneAxes[axis])).value_or(0);
    }
    if (name == "UUID" && !image.runs.empty()) {
      runs().back().file = attributes.text("FileName");
      is_in_uuid_ = true;
    }
  }

  static void takePixels(const OmeAttributes& attributes, OmeImage& image) {
    image.order = attributes.text("DimensionOrder");
    image.pixels = {attributes.number("SizeX").value_or(0), attributes.number("SizeY").value_or(0)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      image.sizes[axis] = attributes.number("Size" + std::string(kPlaneAxes[axis])).value_or(0);
      const std::string name = std::string("PhysicalSize") + "XYZ"[axis];
      image.spacing[axis] = attributes.text(name);
      image.units[axis] = attributes.text(name + "Unit");
    }
  }

  std::vector<OmeRun>& runs() { return document_.images.back().runs; }

  XML_Parser parser_ = nullptr;
  bool is_in_uuid_ = false;
  OmeDocument document_;
};

// As far as it is XML; nothing if `text` is none of OME.
std::optional<OmeDocument> readOme(const std::string& text) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 30;
  if (text.find("<OME") == std::string::npos && text.find(":OME") == std::string::npos)
    return std::nullopt;
  if (text.size() > kMostBytes) return std::nullopt;
  return OmeReader().read(text);
}

namespace fs = std::filesystem;

double positiveNumber(const std::string& text) {
  const auto number = numberIn<double>(text);
  return number && *number > 0 && std::isfinite(*number) ? *number : 0;
}

// The value of a line "key=value", or "".
std::string imageJValue(const std::string& description, const std::string& key) {
  const std::size_t at = description.find("\n" + key + "=");
  if (at == std::string::npos) return "";
  const std::size_t first = at + key.size() + 2;
  std::string value = description.substr(first, description.find('\n', first) - first);
  if (value.ends_with('\r')) value.pop_back();
  return value;
}
std::int64_t imageJCount(const std::string& description, const std::string& key) {
  return numberIn<std::int64_t>(imageJValue(description, key)).value_or(1);
}

// Of the header of a Zeiss LSM.
template <typename T>
T lsmNumber(const TiffResolution& said, std::size_t at) {
  return said.lsm.size() < at + sizeof(T) ? T{} : loadNumber<T>(said.lsm.data() + at, false);
}

// The schema's unit is the micrometre if none is stated.
TiffLengths omeLengths(const OmeImage& image) {
  TiffLengths lengths;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    lengths.spacing[static_cast<int>(axis)] = positiveNumber(image.spacing[axis]);
    lengths.units[axis] = image.units[axis].empty() ? "micrometer" : image.units[axis];
  }
  if (lengths.spacing.z == 0) lengths.units[2] = lengths.units[0];
  if (lengths.spacing.x == 0 || lengths.spacing.y == 0) return {};
  return lengths;
}

// None: more than any file has.
std::optional<std::int64_t> productOf(std::span<const TiffAxis> axes) {
  constexpr std::int64_t kMost = std::int64_t{1} << 50;
  std::int64_t count = 1;
  for (const TiffAxis& axis : axes) {
    if (axis.count < 1 || axis.count > kMost / count) return std::nullopt;
    count *= axis.count;
  }
  return count;
}

// Of a page that has the pixels of all planes, one behind the other: the planes. None: it has not.
std::vector<TiffPage> planesWithin(const TiffPage& page, std::int64_t count,
                                   std::uint64_t file_bytes) {
  if (!page.pixels_at) return {};
  const std::uint64_t bytes = std::uint64_t{page.form.width} * page.form.height *
                              page.form.samples * storedBytes(*page.form.type());
  if (static_cast<std::uint64_t>(count) > (file_bytes - *page.pixels_at) / bytes) return {};
  std::vector<TiffPage> planes(static_cast<std::size_t>(count), page);
  for (std::size_t i = 0; i < planes.size(); ++i) *planes[i].pixels_at += i * bytes;
  return planes;
}

class ImageFinder {
 public:
  ImageFinder(const std::string& path, const OpenOptions& options) : options_(options) {
    TiffFile file(path);
    said_ = file.resolution();
    pages_ = file.pages(options);
    description_ = std::exchange(pages_.front().description, {});
    file_bytes_ = InputFile(path).size();
    found_.paths = {path};
  }

  TiffImages find() {
    if (const auto ome = readOme(description_))
      findOme(*ome);
    else if (!said_.lsm.empty())
      findLsm();
    else if (description_.starts_with("ImageJ="))
      findImageJ();
    else if (isShape(description_))
      findShapes();
    // Some write each slice as an image of its own.
    if (std::ranges::all_of(found_.images,
                            [](const TiffImage& image) { return image.planes.size() == 1; })) {
      found_.images.clear();
      findForms();
    }
    for (TiffImage& image : found_.images)
      if (image.lengths.spacing.x == 0) image.lengths = tiffLengths(said_, description_);
    return std::move(found_);
  }

  static bool isShape(const std::string& description) {
    return description.starts_with("{\"shape\"");
  }

 private:
  const std::string& path() const { return found_.paths.front(); }

  std::vector<TiffPage> wholePages() const {
    std::vector<TiffPage> pages;
    std::ranges::copy_if(pages_, std::back_inserter(pages),
                         [](const TiffPage& page) { return !page.is_smaller; });
    return pages;
  }

  Error contradiction(const std::vector<TiffAxis>& said, std::int64_t pages) const {
    if (!pages_.front().unread.empty()) return unusable(path(), pages_.front().unread);
    ListText counts(" x ");
    for (const TiffAxis& axis : said) counts.add(axis.count);
    return unusable(path(), "its description says ", counts.text(), " planes, and it has ", pages,
                    "; get the whole file again, or save it anew");
  }

  void findImageJ() {
    static const std::map<std::string, std::string> kOrders = {
        {"ctz", "ZTC"}, {"zct", "TCZ"}, {"ztc", "CTZ"}, {"tcz", "ZCT"}, {"tzc", "CZT"}};
    const auto order = kOrders.find(imageJValue(description_, "order"));
    std::map<char, std::int64_t> counts = {{'C', imageJCount(description_, "channels")},
                                           {'Z', imageJCount(description_, "slices")},
                                           {'T', imageJCount(description_, "frames")}};
    TiffImage image;
    image.planes = wholePages();
    if (image.planes.empty()) return;
    const TiffPage first = image.planes.front();
    // Bio-Formats calls the numbers of a pixel channels.
    if (first.form.samples > 1 && counts['C'] == first.form.samples) {
      image.has_channels = first.form.is_separate;
      counts['C'] = 1;
    }
    const bool is_plain = counts['C'] == 1 && counts['T'] == 1;
    if (is_plain && counts['Z'] == 1) counts['Z'] = imageJCount(description_, "images");
    for (const char axis : order == kOrders.end() ? "TZC" : order->second)
      image.axes.push_back({axis, counts[axis]});
    const auto said = productOf(image.axes);
    if (said && *said > 1 && image.planes.size() == 1)
      if (auto planes = planesWithin(first, *said, file_bytes_); !planes.empty())
        image.planes = std::move(planes);
    // A plain stack that lost slices, or got some, is one still.
    const std::int64_t planes = std::ssize(image.planes);
    if (is_plain && (planes > 1 || counts['Z'] == 1))
      image.axes = {{'Z', planes}};
    else if (said != planes)
      throw contradiction(image.axes, planes);
    found_.images.push_back(std::move(image));
  }

  // The first page of a series of tifffile says the shape of all of it.
  void findShapes() {
    pages_.front().description = description_;
    for (std::size_t at = 0; at < pages_.size();) {
      const TiffPage first = pages_[at];
      TiffImage image = shapedImage(first);
      const auto said = productOf(image.axes);
      std::size_t pages = 1;  // of the series, up to the next one's description
      while (at + pages < pages_.size() && pages_[at + pages].description.empty()) ++pages;
      if (said && *said > 1 && pages == 1)
        image.planes = planesWithin(first, *said, file_bytes_);
      else if (said && *said == static_cast<std::int64_t>(pages))
        image.planes.assign(pages_.begin() + static_cast<std::ptrdiff_t>(at),
                            pages_.begin() + static_cast<std::ptrdiff_t>(at + pages));
      if (image.planes.empty()) throw contradiction(image.axes, static_cast<std::int64_t>(pages));
      if (!first.is_smaller) found_.images.push_back(std::move(image));
      at += pages;
    }
  }

  // Name and axes by a description of tifffile.
  TiffImage shapedImage(const TiffPage& page) const {
    TiffImage image;
    image.has_channels = page.form.is_separate;
    const nlohmann::json json = parseShallowJson(page.description);
    image.name = textOf(member(json, "name"));
    const std::string names = textOf(member(json, "axes"));
    for (const auto& count : member(json, "shape"))
      image.axes.push_back({'Q', count.is_number_integer() ? count.get<std::int64_t>() : 0});
    for (std::size_t i = 0; names.size() == image.axes.size() && i < names.size(); ++i)
      image.axes[i].name = names[i];
    // The last axes are those of a page.
    const std::int64_t numbers =
        std::int64_t{page.form.width} * page.form.height * page.form.samples;
    std::size_t outside = image.axes.size();
    while (outside > 0 && productOf(std::span(image.axes).subspan(outside)) != numbers) --outside;
    image.axes.resize(outside);
    return image;
  }

  void findOme(OmeDocument ome) {
    files_[fs::path(path()).filename().string()] = 0;
    file_pages_.push_back(pages_);
    if (ome.images.empty() && !ome.metadata_file.empty()) {
      const InputFile companion(besidePath(ome.metadata_file), path());
      std::string text(std::min(companion.size(), kMostCompanionBytes), '\0');
      text.resize(companion.readAt(0, text.data(), text.size()));
      ome = readOme(text).value_or(OmeDocument{});
      ome.uuid.clear();  // the companion's own
      found_.paths.push_back(companion.path());
      file_pages_.emplace_back();
    }
    for (const OmeImage& said : ome.images) {
      TiffImage image = omeImage(said, ome);
      if (!image.planes.empty()) found_.images.push_back(std::move(image));
    }
  }

  TiffImage omeImage(const OmeImage& said, const OmeDocument& ome) {
    TiffImage image;
    image.name = said.name;
    image.lengths = omeLengths(said);
    image.named_channels = said.channels;
    image.has_channels = true;
    // Without a list of planes, or with sizes that are missing, the pages are what they are.
    // Some do not say that channels are the numbers of a pixel.
    const std::int64_t samples = said.samples == 1 && said.sizes[1] == pages_.front().form.samples
                                     ? said.sizes[1]
                                     : said.samples;
    const std::int64_t channels = said.sizes[1] / samples;
    if (said.order.size() != 5 || channels < 1) return image;
    for (const char name : {said.order[4], said.order[3], said.order[2]})
      image.axes.push_back({name, name == 'C' ? channels : said.sizes[name == 'Z' ? 0 : 2]});
    const auto count = productOf(image.axes);
    if (!count || *count > kMostPlanes) return image;
    if (said.has_mixed_axis)
      image.unread = "one of its axes holds another one (ModuloAlong); save each as an image";
    image.planes.resize(static_cast<std::size_t>(*count));
    static const OmeRun kAll;
    for (const OmeRun& run : said.runs.empty() ? std::span(&kAll, 1) : std::span(said.runs)) {
      const auto file = fileOf(run, ome);
      if (!file) {
        image.lacks = run.file;
        continue;
      }
      const std::vector<TiffPage>& pages = file_pages_[*file];
      std::int64_t plane = 0;
      for (const TiffAxis& axis : image.axes) {
        const std::int64_t first = run.first[axis.name == 'Z' ? 0 : axis.name == 'C' ? 1 : 2];
        plane = first < axis.count ? plane * axis.count + first : *count;
      }
      const std::int64_t from = run.ifd.value_or(0);
      std::int64_t planes = run.count.value_or(run.ifd ? 1 : std::ssize(pages));
      planes = std::min({planes, *count - plane, std::ssize(pages) - from});
      for (std::int64_t i = 0; i < planes; ++i) {
        TiffPage& to = image.planes[static_cast<std::size_t>(plane + i)];
        to = pages[static_cast<std::size_t>(from + i)];
        to.file = *file;
        if (said.pixels[0] != to.form.width || said.pixels[1] != to.form.height)
          image.unread = "its description and its pages have two sizes; save it anew";
      }
    }
    return image;
  }

  // The number of the file that has the planes, and its pages; none if it is not beside.
  std::optional<std::uint32_t> fileOf(const OmeRun& run, const OmeDocument& ome) {
    const bool is_own = run.file.empty() || (!run.uuid.empty() && run.uuid == ome.uuid);
    const std::string name = fs::path(is_own ? path() : run.file).filename().string();
    if (const auto known = files_.find(name); known != files_.end()) return known->second;
    auto& file = files_[name];
    const std::string beside = besidePath(name);
    if (!inputIsThere(beside)) return file;
    file = static_cast<std::uint32_t>(found_.paths.size());
    found_.paths.push_back(beside);
    file_pages_.push_back(TiffFile(beside).pages(options_));
    return file;
  }

  std::string besidePath(const std::string& name) const {
    return (fs::path(path()).parent_path() / fs::path(name).filename()).string();
  }

  void findLsm() {
    TiffImage image;
    image.planes = wholePages();
    image.has_channels = true;
    image.axes = {{'T', lsmNumber<std::int32_t>(said_, 24)},
                  {'Z', lsmNumber<std::int32_t>(said_, 16)}};
    if (productOf(image.axes) == std::ssize(image.planes))
      found_.images.push_back(std::move(image));
  }

  // Each form of pages is an image.
  void findForms() {
    for (TiffPage& page : wholePages()) {
      auto image = std::ranges::find_if(found_.images, [&](const TiffImage& other) {
        return other.planes.front().form == page.form;
      });
      if (image == found_.images.end()) image = found_.images.emplace(image);
      image->planes.push_back(std::move(page));
      image->axes = {{'Z', std::ssize(image->planes)}};
    }
  }

  static constexpr std::int64_t kMostPlanes = std::int64_t{1} << 24;
  static constexpr std::uint64_t kMostCompanionBytes = std::uint64_t{1} << 28;

  const OpenOptions& options_;
  std::vector<TiffPage> pages_;
  std::string description_;
  TiffResolution said_;
  std::uint64_t file_bytes_ = 0;
  TiffImages found_;
  // Of OME-TIFF: the numbers of files by their names, and their pages.
  std::map<std::string, std::optional<std::uint32_t>> files_;
  std::vector<std::vector<TiffPage>> file_pages_;
};

}  // namespace

TiffImages findTiffImages(const std::string& path, const OpenOptions& options) {
  return ImageFinder(path, options).find();
}

bool namesOtherFiles(const std::string& description) {
  const auto ome = readOme(description);
  std::set<std::string> files;
  for (const OmeImage& image : ome ? ome->images : std::vector<OmeImage>())
    for (const OmeRun& run : image.runs) files.insert(run.file);
  return files.size() > 1;
}

TiffLengths tiffLengths(const TiffResolution& said, const std::string& description) {
  if (const auto ome = readOme(description); ome && !ome->images.empty())
    if (TiffLengths lengths = omeLengths(ome->images.front()); lengths.spacing.x > 0)
      return lengths;
  constexpr std::size_t kVoxelAt = 40;
  const glm::dvec3 voxel(lsmNumber<double>(said, kVoxelAt), lsmNumber<double>(said, kVoxelAt + 8),
                         lsmNumber<double>(said, kVoxelAt + 16));
  if (voxel.x > 0 && voxel.y > 0 && voxel.z > 0 && std::isfinite(voxel.x + voxel.y + voxel.z))
    return {voxel, {"meter", "meter", "meter"}};
  TiffLengths lengths;
  if (said.x > 0 && said.y > 0) lengths.spacing = {1 / said.x, 1 / said.y, 0};
  std::string unit = said.unit == 2 ? "inch" : said.unit == 3 ? "centimeter" : "";
  if (description.starts_with("ImageJ=")) {
    unit = imageJValue(description, "unit");
    if (unit == "pixel" || unit == "pixels") unit.clear();
    lengths.spacing.z = positiveNumber(imageJValue(description, "spacing"));
  }
  if (lengths.spacing.x > 0) lengths.units = {unit, unit, unit};
  return lengths;
}

}  // namespace isobrick
