#include "isobrick/storage/remote/open_remote.h"

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/remote_address.h"

#if ISOBRICK_WITH_HTTP
#include "isobrick/storage/remote/http_ranges.h"
#endif

namespace isobrick {

#if ISOBRICK_WITH_HTTP
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url,
                                              const RemoteOptions& options) {
  return std::make_unique<HttpRanges>(withoutSecrets(url), url, nullptr, options);
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
