// The options of all commands that build a pyramid.
#pragma once

#include <CLI/CLI.hpp>

#include "isobrick/preprocess/pyramid_builder.h"
#include "tools/build/build_report.h"
#include "tools/parse_text.h"
#include "tools/shared_options.h"

namespace isobrick {

// --codec and --no-curvature.
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
}

}  // namespace isobrick
