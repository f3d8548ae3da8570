// The folder of this executable, beside which others are searched.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <optional>
#include <string>

namespace isobrick {

// Both are empty if the system does not give the path.
std::filesystem::path ownExecutable();
std::filesystem::path ownFolder();

// The file of this name that came with this executable, beside it or in libexec once installed, to
// run or, with R_OK, to read.
std::optional<std::string> findOwn(const std::string& name, int access_mode = X_OK);
// The same. Throws Error if there is none.
std::string requireOwn(const std::string& name, int access_mode = X_OK);
// Becomes that executable, with the words that this one was given. Throws Error if it cannot be
// run.
[[noreturn]] void becomeExecutable(const std::string& name);
// The words, for that: main() notes them.
void noteWords(char** words);

}  // namespace isobrick
