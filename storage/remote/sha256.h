// SHA-256 (FIPS 180-4) and HMAC (RFC 2104): for signatures, and for names that cannot be forged.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace isobrick {

using Sha256 = std::array<std::uint8_t, 32>;

Sha256 sha256(std::string_view text);
Sha256 hmacSha256(std::string_view key, std::string_view text);

// 64 digits, small letters.
std::string hexText(const Sha256& hash);
// Its bytes as a key.
std::string bytesOf(const Sha256& hash);

}  // namespace isobrick
