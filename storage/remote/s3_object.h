// An object of S3: the URL behind s3://bucket/key, and signed requests for it.
#pragma once

#include <mutex>
#include <string>

#include "isobrick/storage/remote/remote_address.h"
#include "isobrick/storage/remote/s3_account.h"

namespace isobrick {

// Amazon's own servers have the bucket in their name, other endpoints in the path; and so have
// Amazon's for a bucket with a dot, which no certificate covers.
class S3Object final : public RequestSigner {
 public:
  // `url` is s3://bucket/key. Throws Error if it is not.
  S3Object(const std::string& url, S3Account account);

  AddressedRequest requestNow() override;
  void useRegion(const std::string& region) override;

 private:
  std::string bucket_, key_;
  std::mutex mutex_;  // guards the next one
  S3Account account_;
};

}  // namespace isobrick
