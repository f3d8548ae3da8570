// The names of the files that the viewer writes.
#pragma once

#include <functional>
#include <string>

namespace isobrick {

// The name of a volume's files: "scan" for "scans/scan.nii.gz", "head-256" for "phantom:head:256".
std::string stemOf(const std::string& source);

// A path as the user would write it: with ~ for the folder that $HOME names.
std::string shortPath(const std::string& path);

// The first name STEM-0001.png, STEM-0002.png, ... that no file has, and that `isTaken` does not
// claim. Throws Error if there is none.
std::string freeName(const std::string& stem, const char* extension,
                     const std::function<bool(const std::string&)>& isTaken = {});

}  // namespace isobrick
