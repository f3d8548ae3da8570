#include "isobrick/storage/remote/open_remote.h"

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/remote_address.h"

#if ISOBRICK_WITH_HTTP
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/remote/http_ranges.h"
#include "isobrick/storage/remote/s3_object.h"
#endif

namespace isobrick {

#if ISOBRICK_WITH_HTTP
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url,
                                              const RemoteOptions& options) {
  std::unique_ptr<RequestSigner> signer;
  if (lowercase(url.substr(0, 5)) == "s3://")
    signer = std::make_unique<S3Object>(url, findS3Account(systemSurroundings()));
  return std::make_unique<HttpRanges>(withoutSecrets(url), url, std::move(signer), options);
}
#else
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url, const RemoteOptions&) {
  const std::string name = withoutSecrets(url);
  throw Error("cannot open '" + name +
                  "': isobrick was built without HTTP; copy the file, or build isobrick with "
                  "ISOBRICK_WITH_HTTP",
              {.path = name});
}
#endif

}  // namespace isobrick
