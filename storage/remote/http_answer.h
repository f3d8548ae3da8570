// Whether a server's answer is the range that was asked for. Servers are hostile until then.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/remote/http_transfers.h"

namespace isobrick {

// A file behind a URL as the first answer describes it; all later answers must be of the same.
struct RemoteFile {
  std::uint64_t bytes = 0;
  std::string etag, last_modified;  // as the server sent them; empty: it did not
};

// "bytes FIRST-LAST/TOTAL".
struct ContentRange {
  std::uint64_t first = 0, last = 0, total = 0;
};
// Nothing for all other texts, an unknown total among them.
std::optional<ContentRange> parseContentRange(std::string_view text);

// The step that follows the head of an answer.
struct HttpVerdict {
  enum class Kind {
    kGood,     // the bytes that were asked for follow
    kMayPass,  // ask again later
    kRegion,   // ask again, as one of that region (S3)
    kNever,    // the same request would not do better
  };
  Kind kind = Kind::kGood;
  std::string text = {};           // of what is wrong, and behind a semicolon what to do
  double wait_seconds = 0;         // that the server asks for, of kMayPass
  std::string bucket_region = {};  // of kRegion
  bool is_missing = false;         // kNever, as the server has no such file
};

// The answer to the first request, of the bytes first .. last. Sets `file` if it is good; fewer
// bytes are good if the file has no more.
HttpVerdict judgeFirstAnswer(const HttpHead& head, std::uint64_t first, std::uint64_t last,
                             RemoteFile& file);
// The same to a first request of the last `bytes` bytes.
HttpVerdict judgeFirstAnswerOfEnd(const HttpHead& head, std::uint64_t bytes, RemoteFile& file);
// The answer to one of the later requests, for a range within `file`.
HttpVerdict judgeAnswer(const HttpHead& head, std::uint64_t first, std::uint64_t last,
                        const RemoteFile& file);

// Headers by which a server refuses (412) when the file is not that one any more. A weak ETag does
// for comparing alone, so then the time of the last change stands in.
std::vector<std::string> sameFileHeaders(const RemoteFile& file);

}  // namespace isobrick
