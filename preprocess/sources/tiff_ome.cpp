#include "isobrick/preprocess/sources/tiff_ome.h"

#include <expat.h>

#include <algorithm>
#include <memory>
#include <new>
#include <string_view>

#include "isobrick/preprocess/number_text.h"

namespace isobrick {
namespace {

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
    if (name == "Channel")
      image.samples =
          std::max<std::int64_t>(image.samples, attributes.number("SamplesPerPixel").value_or(1));
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

}  // namespace

std::optional<OmeDocument> readOme(const std::string& text) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 30;
  if (text.find("<OME") == std::string::npos && text.find(":OME") == std::string::npos)
    return std::nullopt;
  if (text.size() > kMostBytes) return std::nullopt;
  return OmeReader().read(text);
}

}  // namespace isobrick
