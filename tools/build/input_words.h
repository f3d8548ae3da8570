// Words for volumes that a command took over from `isobrick` (tools/volume_input.h).
#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/build/open_input.h"
#include "tools/command.h"
#include "tools/volume_input.h"

namespace isobrick {

// The words that say how to read the volume, as `isobrick build` reads them.
class InputWords {
 public:
  explicit InputWords(const VolumeInput& input) {
    addOpenOptions(parser_, options_);
    std::vector<std::string> words = wordsForBuild(input);
    std::reverse(words.begin(), words.end());  // as CLI11 wants them
    try {
      parser_.parse(std::move(words));
    } catch (const CLI::ParseError& error) {
      throw UsageError(error.what());
    }
    options_.path = input.path;
  }
  InputWords(const InputWords&) = delete;

  const CLI::App& parser() const { return parser_; }
  const InputOptions& options() const { return options_; }
  // Of these surfaces, if the volume is smoothed, how far they move; null otherwise.
  std::shared_ptr<std::vector<SurfaceShift>> watch(
      const std::vector<std::optional<double>>& isovalues) {
    if (options_.derivation.denoise == 0) return nullptr;
    const auto shifts = std::make_shared<std::vector<SurfaceShift>>();
    for (const std::optional<double>& isovalue : isovalues)
      shifts->push_back({.isovalue = *isovalue});
    return options_.derivation.shifts = shifts;
  }

 private:
  CLI::App parser_;
  InputOptions options_;
};

}  // namespace isobrick
