#include "isobrick/storage/remote/s3_object.h"

#include <algorithm>
#include <ctime>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// S3 takes it in place of the hash of a body; there is none.
constexpr const char* kUnsignedPayload = "UNSIGNED-PAYLOAD";

bool isBucketName(const std::string& name) {
  return !name.empty() && name.size() <= 255 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '.' || c == '_';
  });
}

// A region becomes a part of a host's name.
bool isRegionName(const std::string& name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

// The header Host as libcurl sends it: without the port that the scheme has anyway.
std::string hostHeader(const std::string& scheme, std::string host) {
  const std::string port = lowercase(scheme) == "https" ? ":443" : ":80";
  if (host.ends_with(port)) host.resize(host.size() - port.size());
  return host;
}

}  // namespace

S3Object::S3Object(const std::string& url, S3Account account) : account_(std::move(account)) {
  const std::string place = url.substr(std::min(url.size(), url.find("://") + 3));
  const std::size_t slash = place.find('/');
  bucket_ = place.substr(0, slash);
  if (slash != std::string::npos) key_ = place.substr(slash + 1);
  if (!isBucketName(bucket_) || key_.empty())
    throw Error("cannot open '" + url + "': it names no object; give s3://bucket/key",
                {.path = url});
  if (!isRegionName(account_.region))
    throw Error("cannot open '" + url + "': '" + account_.region +
                    "' is no region; set AWS_REGION to one such as eu-central-1",
                {.path = url});
}

AddressedRequest S3Object::requestNow() {
  const std::lock_guard lock(mutex_);
  std::string base = account_.endpoint;
  std::string path = "/" + encodedPath(key_);
  if (base.empty()) {
    const std::string server = "s3." + account_.region + ".amazonaws.com" +
                               (account_.region.starts_with("cn-") ? ".cn" : "");
    const bool is_in_name = bucket_.find_first_of("._") == std::string::npos;
    base = "https://" + (is_in_name ? bucket_ + "." : "") + server;
    if (!is_in_name) path = "/" + bucket_ + path;
  } else {
    path = "/" + bucket_ + path;
  }
  AddressedRequest addressed{base + path, {}};
  if (!account_.keys) return addressed;

  // An endpoint may have a path of its own.
  const std::size_t host = base.find("://") + 3;
  const std::size_t host_end = std::min(base.find('/', host), base.size());
  UnsignedRequest request;
  request.path = base.substr(host_end) + path;
  request.payload_hash = kUnsignedPayload;
  const std::string time = amzTime(std::time(nullptr));
  request.headers = {
      {"host", hostHeader(base.substr(0, host - 3), base.substr(host, host_end - host))},
      {"x-amz-content-sha256", kUnsignedPayload},
      {"x-amz-date", time}};
  if (!account_.keys->token.empty())
    request.headers.emplace_back("x-amz-security-token", account_.keys->token);
  for (const auto& [name, value] : request.headers)
    if (name != "host") addressed.headers.push_back(name + ": " + value);
  addressed.headers.push_back(
      "Authorization: " + authorizationV4(request, *account_.keys, account_.region, "s3", time));
  return addressed;
}

void S3Object::useRegion(const std::string& region) {
  const std::lock_guard lock(mutex_);
  if (isRegionName(region)) account_.region = region;
}

}  // namespace isobrick
