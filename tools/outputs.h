// The outputs of commands: their names, and the one rule for them: no existing file is replaced
// without --force, --force replaces the named output and nothing beside it, and an input is never
// written over.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

// Whether the pattern has a place "{key}".
bool hasPlace(const std::string& pattern, std::string_view key);

// What may be part of a file's name: a character that means something to file systems or shells
// becomes '-'.
std::string plainName(std::string text);

// The pattern with plainName(value) in all places of that key.
std::string withPlaceFilled(std::string pattern, std::string_view key, const std::string& value);

// Whether it names the folder of a pyramid of many files (.isbs).
bool isDividedName(const std::string& path);

// "bone-500.ply" for "bone.ply" and 500.
std::string nameWith(const std::string& output, const std::string& what);

// The outputs of several inputs: the pattern with the stem of each in its place {name}, or behind
// its stem; of one input without that place the pattern itself; all empty if it is. Throws
// UsageError if two were the same.
std::vector<std::string> outputsOfEach(const std::string& pattern,
                                       const std::vector<std::string>& inputs);

// The last part of a path or a URL without its endings: "head" for "scans/head.nii.gz"
// and "scans/head.ome.zarr/".
std::string inputStem(const std::string& path);

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
// `force`, if the replaced header names it, or that of a run which was killed between the two; it
// is foreign otherwise.
void refuseReplacingVolume(const PlannedOutput& output, const std::vector<std::string>& inputs,
                           bool force);

// What they do not keep: a line each on stderr.
void warnOfLosses(const std::string& output, const std::vector<std::string>& losses);

}  // namespace isobrick
