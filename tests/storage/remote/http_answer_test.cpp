// Answers of servers, good and bad, without a network.
#include "isobrick/storage/remote/http_answer.h"

#include <gtest/gtest.h>

namespace isobrick::test {
namespace {

using Kind = HttpVerdict::Kind;

HttpHead goodHead() {
  return {.status = 206,
          .content_range = "bytes 100-199/1000",
          .content_encoding = {},
          .etag = "\"a\"",
          .last_modified = "then",
          .retry_after = {},
          .bucket_region = {},
          .content_length = 100};
}
const RemoteFile kFile{1000, "\"a\"", "then"};

TEST(ContentRange, IsTakenInOneFormAlone) {
  const auto range = parseContentRange("bytes 5-9/20");
  ASSERT_TRUE(range);
  EXPECT_EQ(range->first, 5u);
  EXPECT_EQ(range->last, 9u);
  EXPECT_EQ(range->total, 20u);
  EXPECT_TRUE(parseContentRange("bytes 0-18446744073709551613/18446744073709551614"));
  for (const char* const text :
       {"", "bytes", "bytes ", "bytes 5-9", "bytes 5-9/", "bytes 5-9/*", "bytes */20",
        "bytes 9-5/20", "bytes 5-20/20", "bytes 5-9/20 ", "bytes 5-9/20x", "bytes -5-9/20",
        "bytes +5-9/20", "lines 5-9/20", "bytes=5-9/20", "bytes 5-9/18446744073709551616",
        "bytes 5 - 9/20", "bytes 0-0/0", "bytes 0x5-9/20"})
    EXPECT_FALSE(parseContentRange(text)) << text;
}

TEST(HttpAnswer, TheRangeThatWasAskedForIsGood) {
  EXPECT_EQ(judgeAnswer(goodHead(), 100, 199, kFile).kind, Kind::kGood);
  HttpHead head = goodHead();
  head.content_length.reset();
  head.content_encoding = "Identity";
  head.etag.clear();
  head.last_modified.clear();
  EXPECT_EQ(judgeAnswer(head, 100, 199, kFile).kind, Kind::kGood);
}

TEST(HttpAnswer, TheFirstOneSaysWhatTheFileIs) {
  RemoteFile file;
  EXPECT_EQ(judgeFirstAnswer(goodHead(), 100, 199, file).kind, Kind::kGood);
  EXPECT_EQ(file.bytes, 1000u);
  EXPECT_EQ(file.etag, "\"a\"");
  EXPECT_EQ(file.last_modified, "then");
  HttpHead head = goodHead();
  head.content_range = "bytes 0-9/10";
  head.content_length = 10;
  EXPECT_EQ(judgeFirstAnswer(head, 0, 4095, file).kind, Kind::kGood) << "a file that is shorter";
  head.content_range = "bytes 0-9/1000";
  EXPECT_EQ(judgeFirstAnswer(head, 0, 4095, file).kind, Kind::kNever);
}

struct BadAnswer {
  const char* name;
  void (*spoil)(HttpHead&);
  Kind kind;
  const char* text;
};

class HttpAnswerRefused : public testing::TestWithParam<BadAnswer> {};

TEST_P(HttpAnswerRefused, WithAReasonAndAnAdvice) {
  HttpHead head = goodHead();
  GetParam().spoil(head);
  const HttpVerdict verdict = judgeAnswer(head, 100, 199, kFile);
  EXPECT_EQ(verdict.kind, GetParam().kind);
  EXPECT_NE(verdict.text.find(GetParam().text), std::string::npos) << verdict.text;
  EXPECT_NE(verdict.text.find(';'), std::string::npos) << verdict.text;
}

const BadAnswer kBadAnswers[] = {
    {"Whole", [](HttpHead& h) { h.status = 200; }, Kind::kNever, "ignores ranges"},
    {"NoContent", [](HttpHead& h) { h.status = 204; }, Kind::kNever, "without the bytes (204)"},
    {"Redirect", [](HttpHead& h) { h.status = 302; }, Kind::kNever, "redirects to nowhere"},
    {"Forbidden", [](HttpHead& h) { h.status = 403; }, Kind::kNever, "refuses access (403)"},
    {"Missing", [](HttpHead& h) { h.status = 404; }, Kind::kNever, "no such file (404)"},
    {"Teapot", [](HttpHead& h) { h.status = 418; }, Kind::kNever, "refuses the request (418)"},
    {"NotThatFile", [](HttpHead& h) { h.status = 412; }, Kind::kNever, "was changed"},
    {"Shorter", [](HttpHead& h) { h.status = 416; }, Kind::kNever, "was changed"},
    {"Nonsense", [](HttpHead& h) { h.status = 0; }, Kind::kNever, "refuses the request (0)"},
    {"Busy", [](HttpHead& h) { h.status = 503; }, Kind::kMayPass, "busy or fails (503)"},
    {"TooMany", [](HttpHead& h) { h.status = 429; }, Kind::kMayPass, "busy or fails (429)"},
    {"Packed", [](HttpHead& h) { h.content_encoding = "gzip"; }, Kind::kNever, "packs the bytes"},
    {"NoRange", [](HttpHead& h) { h.content_range.clear(); }, Kind::kNever, "does not say which"},
    {"OtherRange", [](HttpHead& h) { h.content_range = "bytes 101-200/1000"; }, Kind::kNever,
     "other bytes"},
    {"Less",
     [](HttpHead& h) {
       h.content_range = "bytes 100-149/1000";
       h.content_length = 50;
     },
     Kind::kNever, "other bytes"},
    {"OtherLength", [](HttpHead& h) { h.content_length = 99; }, Kind::kNever, "contradicts"},
    {"OtherTotal", [](HttpHead& h) { h.content_range = "bytes 100-199/1001"; }, Kind::kNever,
     "was changed"},
    {"OtherTag", [](HttpHead& h) { h.etag = "\"b\""; }, Kind::kNever, "was changed"},
    {"OtherTime", [](HttpHead& h) { h.last_modified = "now"; }, Kind::kNever, "was changed"},
    {"OtherRegion",
     [](HttpHead& h) {
       h.status = 301;
       h.bucket_region = "eu-west-1";
     },
     Kind::kRegion, "AWS_REGION"},
};
INSTANTIATE_TEST_SUITE_P(All, HttpAnswerRefused, testing::ValuesIn(kBadAnswers),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(HttpAnswer, APauseIsBounded) {
  HttpHead head = goodHead();
  head.status = 503;
  const auto pauseFor = [&](const char* text) {
    head.retry_after = text;
    return judgeAnswer(head, 100, 199, kFile).wait_seconds;
  };
  EXPECT_EQ(pauseFor("3"), 3);
  EXPECT_EQ(pauseFor("100000000000"), 30);
  EXPECT_EQ(pauseFor("-3"), 0);
  EXPECT_EQ(pauseFor("Tue, 24 Nov 2026 10:00:00 GMT"), 0);
  EXPECT_EQ(pauseFor(""), 0);
}

TEST(HttpAnswer, AStrongTagIsTheCondition) {
  using Lines = std::vector<std::string>;
  EXPECT_EQ(sameFileHeaders({10, "\"a\"", "then"}), Lines{"If-Match: \"a\""});
  EXPECT_EQ(sameFileHeaders({10, "W/\"a\"", "then"}), Lines{"If-Unmodified-Since: then"});
  EXPECT_EQ(sameFileHeaders({10, "", "then"}), Lines{"If-Unmodified-Since: then"});
  EXPECT_EQ(sameFileHeaders({10, "W/\"a\"", ""}), Lines{});
}

}  // namespace
}  // namespace isobrick::test
