// How a pyramid behind a URL is read.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "isobrick/storage/error.h"

namespace isobrick {

// Choices for a file behind a URL; without effect on a local file.
struct RemoteOptions {
  // Folder in which parts of remote pyramids stay on disk; empty: none stay. It is made if it is
  // not there, and may be shared by any number of processes. A part in it is checked against the
  // pyramid's checksums each time it is used.
  std::string cache_folder = {};
  // Bound on the bytes in that folder. The parts that were used least recently go.
  std::uint64_t cache_bytes = std::uint64_t{4} << 30;
  // A server that sends nothing for this long hangs. 0: what the variable ISOBRICK_HTTP_TIMEOUT
  // says, or 20.
  double stall_seconds = 0;
  // How often a request is sent, if its failure may pass: a time limit, a broken connection, 429,
  // 500, 502, 503 or 504. At least 1.
  int tries = 5;
  // Looked at while the server is waited for the first time; then Cancelled is thrown. May be null,
  // and outlives the opening alone.
  const CancelFlag* cancel = nullptr;
};

// The work of the network for an open pyramid so far; all zero for a local file.
struct RemoteCounters {
  std::uint64_t requests = 0;      // sent, those that were repeated among them
  std::uint64_t repeated = 0;      // of these, sent again
  std::uint64_t bytes = 0;         // that servers sent, without headers
  std::uint64_t cached_parts = 0;  // that came from the folder of RemoteOptions
  std::uint64_t cached_bytes = 0;  // of these
};

// True for what is read as a URL: http://, https://, s3:// and gs://, in small or capital letters.
bool isRemotePath(std::string_view path);
// True for s3:// and gs://, behind which a bucket and a key stand: a '?' belongs to the key.
bool isBucketPath(std::string_view path);
// A URL without its secrets: user and password, and the query, in which signatures stand.
std::string withoutSecrets(const std::string& url);

}  // namespace isobrick
