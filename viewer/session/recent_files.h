// What was opened last, remembered from one run to the next.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace isobrick {

inline constexpr std::size_t kMostRecentFiles = 12;

// The list, latest first, with `path` at its head and nowhere else. What a list cannot keep, a path
// that is not absolute or has control characters in it, leaves it as it was.
std::vector<std::string> withRecent(std::vector<std::string> recent, const std::string& path);

// Absolute paths, one a line, as the file has them: at most kMostRecentFiles. What is no such path
// is left out, whoever wrote it.
std::vector<std::string> recentFromText(std::string_view text);
std::string recentToText(const std::vector<std::string>& recent);

// Where the list lies: isobrick/recent in $XDG_STATE_HOME, or in ~/.local/state. Empty where there
// is no such folder to be named.
std::string recentFilesPath();
// Neither throws: a list that cannot be read is empty, and one that cannot be written is lost. At
// most 64 KiB are read, from a regular file.
std::vector<std::string> readRecentFiles(const std::string& path);
void writeRecentFiles(const std::string& path, const std::vector<std::string>& recent);

}  // namespace isobrick
