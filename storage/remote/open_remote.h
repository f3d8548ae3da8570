// From a URL to its ranges.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

struct HttpConnections;

// The first request for a file behind a URL, whose answer says how long it is.
struct FirstRequest {
  std::uint64_t bytes = 4096;  // that it brings, at most; they stay as long as the file is open
  bool is_of_end = false;      // the last bytes of the file instead of the first ones
  // Looked at while anything is waited for; then that fails. May be null, and outlives the file.
  const CancelFlag* cancel = nullptr;
};

// A file behind a URL that may be asked for before anybody waits for it.
class RemoteRanges : public RangeReader {
 public:
  // Waits for the first answer; before it returned true, only abandon() may be called of all else.
  // False: the server has no such file (404). Throws Error for all other failures, and
  // Cancelled by `cancel`, which may be null.
  virtual bool waitUntilOpen(const CancelFlag* cancel) = 0;
};

// For the files of one pyramid, or of one store. Null if isobrick was built without HTTP.
std::shared_ptr<HttpConnections> makeHttpConnections(const RemoteOptions& options);

// Sends the first request for `url`, as isRemotePath() has it, and waits for nothing. Throws Error
// if isobrick was built without HTTP, and for an account of S3 that cannot be used.
std::unique_ptr<RemoteRanges> askForRemoteRanges(const std::string& url, const FirstRequest& first,
                                                 const RemoteOptions& options,
                                                 std::shared_ptr<HttpConnections> connections);

// The same, and waits for the answer. Throws Error if the server cannot be reached, has no such
// file or does not serve ranges of it, and if isobrick was built without HTTP.
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url, const RemoteOptions& options,
                                              std::shared_ptr<HttpConnections> connections);

}  // namespace isobrick
