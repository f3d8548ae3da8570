// An object of S3: the URL behind s3://bucket/key, and the account that requests for it are signed
// by; and one of Google's storage, gs://bucket/key, which speaks the same language.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "isobrick/storage/remote/http_transfers.h"

namespace isobrick {

struct S3Keys {
  std::string id, secret;
  std::string token;  // of a session; empty: none
};

// By the usual variables and profiles.
struct S3Account {
  std::optional<S3Keys> keys;  // nothing: anonymous
  std::string region;          // never empty
  std::string endpoint;        // "https://host:port" without a slash at the end; empty: Amazon's
};

// The value of a variable, and the text of a file; both "" for none. Tests bring their own.
struct S3Surroundings {
  std::function<std::string(const std::string& name)> variable;
  std::function<std::string(const std::string& path)> file;
};
S3Surroundings systemSurroundings();

// Each from the first place that has it:
//
//   keys      AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN; the profile in the
//             credentials file (AWS_SHARED_CREDENTIALS_FILE, ~/.aws/credentials), then in the
//             configuration (AWS_CONFIG_FILE, ~/.aws/config); else anonymous, and also if
//             AWS_NO_SIGN_REQUEST is YES, TRUE or 1
//   region    AWS_REGION, AWS_DEFAULT_REGION, the profile; else us-east-1
//   endpoint  AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL, the profile (endpoint_url); else Amazon's
//   profile   AWS_PROFILE, AWS_DEFAULT_PROFILE; else default
//
// Throws Error for half of a pair of keys, for a profile that is named and is not there, and for
// one that says how to get keys (a role, single sign-on, a program) in place of keys.
S3Account findS3Account(const S3Surroundings& surroundings);

// True for gs://, in small or capital letters.
bool isGoogleUrl(const std::string& url);
// Keys are those for S3 that Google gives ("HMAC keys"): GS_ACCESS_KEY_ID and GS_SECRET_ACCESS_KEY;
// else anonymous. The endpoint is that of STORAGE_EMULATOR_HOST, else Google's. Throws Error for
// half of a pair.
S3Account findGoogleAccount(const S3Surroundings& surroundings);

// Amazon's own servers have the bucket in their name, other endpoints in the path; and so have
// Amazon's for a bucket with a dot, which no certificate covers.
// Thread-safe.
class S3Object {
 public:
  // `url` is s3://bucket/key or gs://bucket/key. Throws Error if it is not.
  S3Object(const std::string& url, S3Account account);

  std::string url() const;
  // Sets the URL, and what signs the request, if there are keys.
  void address(HttpRequest& request) const;
  // The bucket is in that region.
  void useRegion(const std::string& region);
  // With that region.
  S3Account account() const;

 private:
  std::string bucket_, key_;
  mutable std::mutex mutex_;  // guards the next one
  S3Account account_;
};

}  // namespace isobrick
