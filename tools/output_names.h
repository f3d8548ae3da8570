// The names of several outputs of one command, by one pattern: "scan-{channel}.isb".
#pragma once

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

}  // namespace isobrick
