// Patterns among the inputs of a command. A shell expands them itself, but not where they are
// quoted, and it gives up where they are too many for one command line.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

// True where the word has a wildcard (*, ?, [...]) and no file has that very name.
bool isInputPattern(const std::string& word);

// Every pattern becomes the paths that match it, sorted; all other words stay as they are. Throws
// Error for a pattern that nothing matches.
std::vector<std::string> expandInputs(const std::vector<std::string>& words);

}  // namespace isobrick
