// The one rule for the outputs of commands, and what they do not keep: no existing file is replaced
// without --force, --force replaces the named output and nothing beside it, and an input is never
// written over.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

#include "tools/line_words.h"

namespace isobrick {

// --force, the same in every command that writes.
CLI::Option* addForceFlag(CLI::App& app, bool& force);

struct PlannedOutput {
  std::string path;
  // The way to another name for it, for the line that refuses it.
  std::string way_out = "choose another output with -o";
};

// Throws Error if writing the file would replace an input, anything but a file, or, without
// `force`, anything at all. Inputs are files and folders; a name of neither (phantom:head) is none.
void refuseReplacing(const PlannedOutput& output, const std::vector<std::string>& inputs,
                     bool force);
// The same for an output that is a folder: it is replaced, with `force`, only if `holds_own` says
// so of it: that nothing is in it but what such an output has. A folder that holds an input is not.
void refuseReplacingFolder(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force,
                           const std::function<bool(const std::string& folder)>& holds_own);
// The same for a volume. A .mhd has its voxels in a .raw beside it: that one is replaced, with
// `force`, if the replaced header names it, and is foreign otherwise.
void refuseReplacingVolume(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force);

// A line each on stderr.
inline void warnOfLosses(const std::string& output, const std::vector<std::string>& losses) {
  for (const std::string& loss : losses)
    fmt::print(stderr, "isobrick: warning: '{}': {}\n", oneLine(output), oneLine(loss));
}

}  // namespace isobrick
