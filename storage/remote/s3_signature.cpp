#include "isobrick/storage/remote/s3_signature.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <ctime>

#include "isobrick/storage/remote/sha256.h"

namespace isobrick {

std::string authorizationV4(const UnsignedRequest& request, const S3Keys& keys,
                            const std::string& region, const std::string& service,
                            const std::string& time) {
  auto query = request.query;
  std::sort(query.begin(), query.end());
  std::string query_text;
  for (const auto& [name, value] : query) {
    if (!query_text.empty()) query_text += '&';
    query_text += name;
    query_text += '=';
    query_text += value;
  }
  auto headers = request.headers;
  std::sort(headers.begin(), headers.end());
  std::string header_text, names;
  for (const auto& [name, value] : headers) {
    header_text += name;
    header_text += ':';
    header_text += value;
    header_text += '\n';
    if (!names.empty()) names += ';';
    names += name;
  }
  const std::string canonical = request.method + "\n" + request.path + "\n" + query_text + "\n" +
                                header_text + "\n" + names + "\n" + request.payload_hash;
  const std::string day = time.substr(0, 8);
  const std::string scope = day + "/" + region + "/" + service + "/aws4_request";
  const std::string to_sign =
      "AWS4-HMAC-SHA256\n" + time + "\n" + scope + "\n" + hexText(sha256(canonical));
  std::string key = "AWS4" + keys.secret;
  for (const std::string& word : {day, region, service, std::string("aws4_request")})
    key = bytesOf(hmacSha256(key, word));
  return "AWS4-HMAC-SHA256 Credential=" + keys.id + "/" + scope + ",SignedHeaders=" + names +
         ",Signature=" + hexText(hmacSha256(key, to_sign));
}

std::string encodedPath(std::string_view path) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string text;
  for (const char c : path) {
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_' || c == '~' ||
                          c == '/';
    if (is_plain) {
      text += c;
    } else {
      const auto byte = static_cast<std::uint8_t>(c);
      text += '%';
      text += kDigits[byte >> 4];
      text += kDigits[byte & 15];
    }
  }
  return text;
}

std::string amzTime(std::int64_t seconds) {
  const std::time_t time = seconds;
  std::tm parts{};
  gmtime_r(&time, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y%m%dT%H%M%SZ", &parts);
  return text.data();
}

}  // namespace isobrick
