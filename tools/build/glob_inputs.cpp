#include "tools/build/glob_inputs.h"

#include <fmt/format.h>
#include <glob.h>

#include <filesystem>
#include <new>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

class GlobMatches {
 public:
  explicit GlobMatches(const std::string& pattern)
      : status_(glob(pattern.c_str(), 0, nullptr, &matches_)) {}
  ~GlobMatches() { globfree(&matches_); }
  GlobMatches(const GlobMatches&) = delete;
  GlobMatches& operator=(const GlobMatches&) = delete;

  std::vector<std::string> paths() const {
    if (status_ == GLOB_NOSPACE) throw std::bad_alloc();
    if (status_ != 0) return {};
    return {matches_.gl_pathv, matches_.gl_pathv + matches_.gl_pathc};
  }

 private:
  glob_t matches_ = {};
  int status_;
};

}  // namespace

bool isInputPattern(const std::string& word) {
  std::error_code ignored;
  return word.find_first_of("*?[") != std::string::npos &&
         !std::filesystem::exists(std::filesystem::symlink_status(word, ignored));
}

std::vector<std::string> expandInputs(const std::vector<std::string>& words) {
  std::vector<std::string> inputs;
  for (const std::string& word : words) {
    if (!isInputPattern(word)) {
      inputs.push_back(word);
      continue;
    }
    const std::vector<std::string> matches = GlobMatches(word).paths();
    if (matches.empty())
      throw Error(
          fmt::format("nothing matches the input '{}'; check the folder and the pattern", word));
    inputs.insert(inputs.end(), matches.begin(), matches.end());
  }
  return inputs;
}

}  // namespace isobrick
