// Signatures of requests, version 4, as Amazon S3 and those that speak its protocol want them.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace isobrick {

struct S3Keys {
  std::string id, secret;
  std::string token;  // of a session; empty: none
};

// A request without a body, as far as it is signed.
struct UnsignedRequest {
  std::string method = "GET";
  std::string path;                                          // encoded: encodedPath()
  std::vector<std::pair<std::string, std::string>> query;    // encoded names and values
  std::vector<std::pair<std::string, std::string>> headers;  // small letters; host among them
  std::string payload_hash;                                  // 64 digits, or what stands for them
};

// "https://docs.aws.amazon.com/AmazonS3/latest/API/sig-v4-header-based-auth.html": the value of the
// header "Authorization". `time` is as of amzTime(), and a header x-amz-date has it too.
std::string authorizationV4(const UnsignedRequest& request, const S3Keys& keys,
                            const std::string& region, const std::string& service,
                            const std::string& time);

// Every byte but letters, digits, - . _ ~ and / as %XX.
std::string encodedPath(std::string_view path);

// "20261124T103000Z", in UTC; seconds since 1970.
std::string amzTime(std::int64_t seconds);

}  // namespace isobrick
