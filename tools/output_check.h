// The one rule for what commands write: nothing that exists is replaced without --force, --force
// replaces the named output and nothing beside it, and what is read is never written over.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace isobrick {

// --force, as every command that writes has it.
CLI::Option* addForceFlag(CLI::App& app, bool& force);

struct PlannedOutput {
  std::string path;
  // A way to another name for it, for the line that refuses it.
  std::string way_out = "choose another output with -o";
};

// Throws Error where writing the file would replace an input, anything but a file, or, without
// `force`, anything at all. Inputs are files and folders; a name of neither (phantom:head) is none.
void refuseReplacing(const PlannedOutput& output, const std::vector<std::string>& inputs,
                     bool force);
// The same of a volume. A .mhd has its voxels in a .raw beside it: that one goes, with `force`, if
// the header that is replaced names it, and is somebody else's otherwise.
void refuseReplacingVolume(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force);

}  // namespace isobrick
