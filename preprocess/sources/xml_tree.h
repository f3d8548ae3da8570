// Small XML files as trees. Private to preprocess/sources/.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

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

// The root of the file. Throws Error, naming the byte, if it is not well-formed XML, has a
// declaration of types, or more than 64 MiB.
XmlElement readXml(const std::string& path);

}  // namespace isobrick
