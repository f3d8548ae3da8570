// From a URL to its ranges.
#pragma once

#include <memory>
#include <string>

#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {

// `url` as isRemotePath() has it. Throws Error if the server cannot be reached, has no such file or
// does not serve ranges of it, and if isobrick was built without HTTP.
std::unique_ptr<RangeReader> openRemoteRanges(const std::string& url, const RemoteOptions& options);

}  // namespace isobrick
