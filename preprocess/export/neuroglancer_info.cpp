#include "isobrick/preprocess/export/neuroglancer_info.h"

#include <fstream>
#include <iterator>

#include "isobrick/preprocess/shallow_json.h"

namespace isobrick {

std::string neuroglancerTypeOf(const std::string& folder) {
  std::ifstream in(folder + "/info", std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const auto info = parseShallowJson(text);
  const auto type = info.is_object() ? info.find("@type") : info.end();
  return type != info.end() && type->is_string() ? type->get<std::string>() : "";
}

}  // namespace isobrick
