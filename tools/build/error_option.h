// The option of what builds a pyramid that says which levels a tolerance can keep.
#pragma once

#include <CLI/CLI.hpp>

#include "isobrick/storage/error_bins.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"

namespace isobrick {

// Sets `level` to what BuildOptions::error_level takes.
inline void addErrorOption(CLI::App& app, int& level) {
  addParsedOption(
      app, "--error", level,
      [](const std::string& text) { return parseInteger(text, kFirstErrorLevel, kMostErrorLevel); },
      "L",
      "Store error bounds of the levels 2 to L (2 or 3), so that extract --tolerance keeps coarser "
      "cells than those of level 1; takes several times as long");
}

}  // namespace isobrick
