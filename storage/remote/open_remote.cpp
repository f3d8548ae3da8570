#include "isobrick/storage/remote/open_remote.h"

#include "isobrick/storage/error.h"

#if ISOBRICK_WITH_HTTP
#include "isobrick/storage/remote/http_ranges.h"
#include "isobrick/storage/remote/s3_object.h"
#endif

namespace isobrick {

#if ISOBRICK_WITH_HTTP
std::shared_ptr<HttpConnections> makeHttpConnections(const RemoteOptions& options) {
  return std::make_shared<HttpConnections>(options);
}

std::unique_ptr<RemoteRanges> askForRemoteRanges(const std::string& url, const FirstRequest& first,
                                                 const RemoteOptions& options,
                                                 std::shared_ptr<HttpConnections> connections) {
  std::unique_ptr<S3Object> object;
  if (isBucketPath(url)) object = std::make_unique<S3Object>(url, connections->account(url));
  return std::make_unique<HttpRanges>(withoutSecrets(url), url, std::move(object), first, options,
                                      std::move(connections));
}
#else
std::shared_ptr<HttpConnections> makeHttpConnections(const RemoteOptions&) { return nullptr; }

std::unique_ptr<RemoteRanges> askForRemoteRanges(const std::string& url, const FirstRequest&,
                                                 const RemoteOptions&,
                                                 std::shared_ptr<HttpConnections>) {
  const std::string name = withoutSecrets(url);
  throw Error("cannot open '" + name +
                  "': isobrick was built without HTTP; copy the file, or build isobrick with "
                  "ISOBRICK_WITH_HTTP",
              {.path = name});
}
#endif

std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url, const RemoteOptions& options,
                                              std::shared_ptr<HttpConnections> connections) {
  auto ranges = askForRemoteRanges(url, {}, options, std::move(connections));
  const std::string name = withoutSecrets(url);
  if (!ranges->waitUntilOpen(options.cancel))
    throw Error("cannot open '" + name + "': the server has no such file (404); check the address",
                {.path = name});
  return ranges;
}

}  // namespace isobrick
