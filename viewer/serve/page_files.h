// The files of the page, which are a part of the command: viewer/web/dist when it was built.
#pragma once

#include <string_view>
#include <vector>

namespace isobrick {

struct PageFile {
  std::string_view name;  // "main.js", "main.js.gz"
  std::string_view bytes;
};

// Empty: the command was built without a page. Made by cmake/embed_page.cmake.
const std::vector<PageFile>& pageFiles();

}  // namespace isobrick
