// Files of a folder as the slices of a stack. Private to preprocess/sources/.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

// Regular files of the folder, sorted by their bytes. Throws Error if it cannot be read, and for
// links to nowhere, which may be slices (not for those of editors, whose names begin with a dot).
std::vector<std::string> filesInFolder(const std::string& folder);

// "slice9" before "slice10": runs of digits compare as numbers.
bool numericNameLess(const std::string& a, const std::string& b);

}  // namespace isobrick
