// From a URL to its ranges.
#pragma once

#include <memory>
#include <string>

#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

struct HttpConnections;

// For the files of one pyramid. Null if isobrick was built without HTTP.
std::shared_ptr<HttpConnections> makeHttpConnections(const RemoteOptions& options);

// `url` as isRemotePath() has it. Throws Error if the server cannot be reached, has no such file or
// does not serve ranges of it, and if isobrick was built without HTTP.
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url, const RemoteOptions& options,
                                              std::shared_ptr<HttpConnections> connections);

}  // namespace isobrick
