// The places that are read by URL.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/remote_options.h"

namespace isobrick {

// The address of a request, and its headers, a whole line each.
struct AddressedRequest {
  std::string url;
  std::vector<std::string> headers;
};

// Makes signed requests for one file. Thread-safe.
class RequestSigner {
 public:
  virtual ~RequestSigner() = default;
  // A GET, valid for some minutes from now on.
  virtual AddressedRequest requestNow() = 0;
  // The file is in that region.
  virtual void useRegion(const std::string& region) = 0;
};

// A name without its secrets: user and password, and the query, in which signatures stand.
std::string withoutSecrets(const std::string& url);

}  // namespace isobrick
