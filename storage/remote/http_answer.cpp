#include "isobrick/storage/remote/http_answer.h"

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <utility>

#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// A server that asks for a longer pause is not waited for.
constexpr double kLongestPause = 30;

constexpr const char* kChanged = "the file was changed while it was open; open it again";

bool takeInteger(std::string_view& text, std::uint64_t& number) {
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, number);
  if (error != std::errc() || at == text.data()) return false;
  text.remove_prefix(static_cast<std::size_t>(at - text.data()));
  return true;
}

bool takePrefix(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

HttpVerdict never(std::string text) {
  return {.kind = HttpVerdict::Kind::kNever, .text = std::move(text)};
}

// Seconds; a date, or nothing, is no wish.
double pauseOf(const std::string& retry_after) {
  std::string_view text = retry_after;
  std::uint64_t seconds = 0;
  if (!takeInteger(text, seconds) || !text.empty()) return 0;
  return std::min(static_cast<double>(seconds), kLongestPause);
}

// All but 206.
HttpVerdict judgeRefusal(const HttpHead& head) {
  const int status = head.status;
  const std::string number = std::to_string(status);
  // S3 says this of a bucket that another region has, under several statuses.
  if (!head.bucket_region.empty() && (status / 100 == 3 || status == 400))
    return {
        .kind = HttpVerdict::Kind::kRegion,
        .text = "the bucket is in another region; set AWS_REGION to '" + head.bucket_region + "'",
        .bucket_region = head.bucket_region};
  switch (status) {
    case 200:
      return never(
          "the server ignores ranges and sends the whole file; copy the file, or use a server "
          "that serves parts of it");
    case 401:
    case 403:
    case 407:
      return never("the server refuses access (" + number + "); check address and keys");
    case 404:
    case 410:
      return {.kind = HttpVerdict::Kind::kNever,
              .text = "the server has no such file (" + number + "); check the address",
              .is_missing = status == 404};
    case 412:
      return never(kChanged);
    case 408:
    case 425:
    case 429:
    case 500:
    case 502:
    case 503:
    case 504:
      return {.kind = HttpVerdict::Kind::kMayPass,
              .text = "the server is busy or fails (" + number + "); try again later",
              .wait_seconds = pauseOf(head.retry_after)};
    default:
      break;
  }
  if (status / 100 == 3)
    return never("the server redirects to nowhere (" + number + "); check the address");
  if (status / 100 == 2)
    return never("the server answers without the bytes (" + number + "); check the address");
  return never("the server refuses the request (" + number + "); check the address");
}

// A 206 with bytes as they are.
HttpVerdict judgeRange(const HttpHead& head, std::optional<ContentRange>& range) {
  if (head.status != 206) return judgeRefusal(head);
  const std::string encoding = lowercase(head.content_encoding);
  if (!encoding.empty() && encoding != "identity")
    return never("the server packs the bytes (" + encoding + "); switch that off in the server");
  range = parseContentRange(head.content_range);
  if (!range)
    return never("the server does not say which bytes of how many it sends; use another server");
  if (head.content_length && *head.content_length != range->last - range->first + 1)
    return never("the server contradicts itself about how many bytes it sends; try again later");
  return {};
}

// `wanted(total)`: the first and the last byte that were asked for of so many.
template <typename Wanted>
HttpVerdict judgeFirst(const HttpHead& head, RemoteFile& file, Wanted&& wanted) {
  if (head.status == 416) return never("the file is empty; build it again");
  std::optional<ContentRange> range;
  HttpVerdict verdict = judgeRange(head, range);
  if (verdict.kind != HttpVerdict::Kind::kGood) return verdict;
  if (std::pair(range->first, range->last) != wanted(range->total))
    return never("the server sends other bytes than it was asked for; use another server");
  file = {range->total, head.etag, head.last_modified};
  return {};
}

}  // namespace

std::optional<ContentRange> parseContentRange(std::string_view text) {
  ContentRange range;
  if (!takePrefix(text, "bytes ") || !takeInteger(text, range.first) || !takePrefix(text, "-") ||
      !takeInteger(text, range.last) || !takePrefix(text, "/") || !takeInteger(text, range.total) ||
      !text.empty())
    return std::nullopt;
  if (range.first > range.last || range.last >= range.total) return std::nullopt;
  return range;
}

HttpVerdict judgeFirstAnswer(const HttpHead& head, std::uint64_t first, std::uint64_t last,
                             RemoteFile& file) {
  return judgeFirst(
      head, file, [=](std::uint64_t total) { return std::pair(first, std::min(last, total - 1)); });
}

HttpVerdict judgeFirstAnswerOfEnd(const HttpHead& head, std::uint64_t bytes, RemoteFile& file) {
  return judgeFirst(head, file, [=](std::uint64_t total) {
    return std::pair(total - std::min(bytes, total), total - 1);
  });
}

HttpVerdict judgeAnswer(const HttpHead& head, std::uint64_t first, std::uint64_t last,
                        const RemoteFile& file) {
  if (head.status == 416) return never(kChanged);
  std::optional<ContentRange> range;
  HttpVerdict verdict = judgeRange(head, range);
  if (verdict.kind != HttpVerdict::Kind::kGood) return verdict;
  // Servers that know no conditions say it like this; one of several servers may leave a mark out.
  if (range->total != file.bytes || (!head.etag.empty() && head.etag != file.etag) ||
      (!head.last_modified.empty() && head.last_modified != file.last_modified))
    return never(kChanged);
  if (range->first != first || range->last != last)
    return never("the server sends other bytes than it was asked for; use another server");
  return {};
}

std::vector<std::string> sameFileHeaders(const RemoteFile& file) {
  if (!file.etag.empty() && !file.etag.starts_with("W/")) return {"If-Match: " + file.etag};
  if (!file.last_modified.empty()) return {"If-Unmodified-Since: " + file.last_modified};
  return {};
}

}  // namespace isobrick
