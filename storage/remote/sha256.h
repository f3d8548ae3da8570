// SHA-256 (FIPS 180-4): for names that cannot be forged.
#pragma once

#include <string>
#include <string_view>

namespace isobrick {

// 64 digits, small letters.
std::string sha256(std::string_view text);

}  // namespace isobrick
