#include "isobrick/viewer/state/text_file.h"

#include <fstream>
#include <sstream>

#include "isobrick/storage/error.h"

namespace isobrick {

std::string readTextFile(const std::string& path, const char* what) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (!file || !(text << file.rdbuf()))
    throw Error("cannot read the " + std::string(what) + " '" + path + "'; is it there?", {path});
  return text.str();
}

}  // namespace isobrick
