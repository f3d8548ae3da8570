// The places that are read by URL.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/remote_options.h"

namespace isobrick {

// Adds headers to a request that prove who asks. Thread-safe.
class RequestSigner {
 public:
  virtual ~RequestSigner() = default;
  // Whole lines for a GET of the URL, now.
  virtual std::vector<std::string> headersFor(const std::string& url) = 0;
  // From now on for that region.
  virtual void useRegion(const std::string& region) = 0;
};

// A name without what nobody else should see: user and password, and the query, in which signatures
// stand.
std::string withoutSecrets(const std::string& url);

}  // namespace isobrick
