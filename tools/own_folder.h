// The folder of this executable, beside which others are searched.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace isobrick {

// Both are empty if the system does not give the path.
std::filesystem::path ownExecutable();
std::filesystem::path ownFolder();

// The executable of this name that came with this one: beside it, or in libexec once installed.
std::optional<std::string> findOwnExecutable(const std::string& name);
// The same. Throws Error if there is none.
std::string requiredExecutable(const std::string& name);
// The same of a file that is no program.
std::string requiredFile(const std::string& name);
// Becomes it, with the words that this one was given. Throws Error if it cannot be run.
[[noreturn]] void becomeExecutable(const std::string& name);
// The words, for that: main() notes them.
void noteWords(char** words);

}  // namespace isobrick
