// The options of all commands that build a pyramid.
#pragma once

#include <CLI/CLI.hpp>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error_bins.h"
#include "tools/build/build_report.h"
#include "tools/parse_text.h"
#include "tools/parsed_option.h"

namespace isobrick {

// --codec, --no-curvature and --error.
inline void addStoredOptions(CLI::App& app, BuildOptions& options) {
  Choices<format::Codec> codecs;
  for (const auto codec : {format::Codec::kStored, format::Codec::kLz4, format::Codec::kZstd})
    codecs.emplace_back(codecOptionName(codec), codec);
  addChoiceOption(app, "--codec", options.codec, codecs, "C",
                  "How the bricks of an .isb are packed: none, lz4 or zstd; default: " +
                      codecOptionName(options.codec));
  app.add_flag_callback(
      "--no-curvature", [&options] { options.with_curvature = false; },
      "Leave out what extract needs for --curvature; builds an .isb faster");
  addParsedOption(
      app, "--error", options.error_level,
      [](const std::string& text) { return parseInteger(text, kFirstErrorLevel, kMostErrorLevel); },
      "L",
      "Store error bounds of the levels 2 to L (2 or 3), so that extract --tolerance keeps coarser "
      "cells than those of level 1; takes several times as long");
}

}  // namespace isobrick
