#include "isobrick/preprocess/sources/xml_tree.h"

#include <expat.h>

#include <memory>
#include <new>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"

namespace isobrick {
namespace {

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

}  // namespace

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
    throw unreadable(path, std::string("its XML is not well-formed at line ") +
                               std::to_string(XML_GetCurrentLineNumber(parser.get())) + " (" +
                               XML_ErrorString(XML_GetErrorCode(parser.get())) +
                               "); correct it, or get it again");
  return std::move(builder.open.front().children.front());
}

}  // namespace isobrick
