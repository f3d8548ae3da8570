// Where this executable lies, beside which others are looked for.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace isobrick {

// Both are empty where the system does not say.
std::filesystem::path ownExecutable();
std::filesystem::path ownFolder();

// The executable of this name that came with this one: beside it, or in libexec once installed.
std::optional<std::string> findOwnExecutable(const std::string& name);
// The same. Throws Error where there is none.
std::string requiredExecutable(const std::string& name);

}  // namespace isobrick
