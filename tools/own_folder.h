// Where this executable lies, beside which others are looked for.
#pragma once

#include <filesystem>

namespace isobrick {

// Both are empty where the system does not say.
std::filesystem::path ownExecutable();
std::filesystem::path ownFolder();

}  // namespace isobrick
