// Ranges over HTTP: from a server that is as it should be, and from those that are not.
#include "isobrick/storage/remote/http_ranges.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/open_remote.h"
#include "isobrick/storage/remote_options.h"
#include "tests/support/child_process.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"
#include "tests/support/range_server.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

// Requests that libcurl will refuse from now on, for want of memory.
std::atomic<int> g_refused_requests{0};

}  // namespace
}  // namespace isobrick::test

// The linker leads curl_multi_add_handle() of this executable here first (tests/CMakeLists.txt).
extern "C" {
int __real_curl_multi_add_handle(void* multi, void* easy);
int __wrap_curl_multi_add_handle(void* multi, void* easy) {
  constexpr int kOutOfMemory = 3;  // CURLM_OUT_OF_MEMORY
  if (isobrick::test::g_refused_requests.fetch_sub(1) > 0) return kOutOfMemory;
  isobrick::test::g_refused_requests = 0;
  return __real_curl_multi_add_handle(multi, easy);
}
}

namespace isobrick::test {
namespace {

using Seconds = std::chrono::duration<double>;

constexpr std::size_t kObjectBytes = 3'000'000;

std::unique_ptr<RangeReader> openAlone(const std::string& url, const RemoteOptions& options) {
  return openRemoteRanges(url, options, makeHttpConnections(options));
}

std::size_t threadCount() {
  const std::filesystem::directory_iterator tasks("/proc/self/task");
  return static_cast<std::size_t>(std::distance(begin(tasks), end(tasks)));
}

class HttpRangesTest : public testing::Test {
 protected:
  HttpRangesTest() {
    Random random(1);
    data_.resize(kObjectBytes);
    for (char& byte : data_) byte = static_cast<char>(randomBelow(random, 256));
    writeBytes(folder_.file("data"), data_);
    writeBytes(folder_.file("short"), data_.substr(0, 100));
  }

  std::unique_ptr<RangeReader> open(const std::string& path) const {
    return openAlone(server_.url(path), options_);
  }
  // "" if the bytes are those of the file.
  std::string read(RangeReader& reader, std::uint64_t offset, std::uint64_t bytes) const {
    std::string out(bytes, '\0');
    try {
      reader.read({offset, bytes}, reinterpret_cast<std::byte*>(out.data()));
    } catch (const ReadFailure& failure) {
      return failure.what();
    }
    return out == data_.substr(offset, bytes) ? "" : "other bytes";
  }

  const TemporaryFolder folder_;
  std::string data_;
  const RangeServer server_{folder_.path()};
  RemoteOptions options_{.cache_folder = {}, .stall_seconds = 1, .tries = 3};
};

// The server signs what it received, as S3 does: the decoded key, encoded anew.
TEST_F(HttpRangesTest, ServersThatCheckSignaturesAcceptOurs) {
  const std::map<std::string, std::string> keys{{"AWS_ACCESS_KEY_ID", "id"},
                                                {"AWS_SECRET_ACCESS_KEY", "se/cret+key"},
                                                {"AWS_REGION", "eu-south-1"},
                                                {"AWS_ENDPOINT_URL", server_.url("signed")}};
  for (const auto& [name, value] : keys) setenv(name.c_str(), value.c_str(), 1);
  for (const char* const token : {"", "to/ken+=="})
    for (const char* const name : {"data", "date=2026-11-01 a+b.isb", "é ~'()!*&$@,;:.isb"}) {
      setenv("AWS_SESSION_TOKEN", token, 1);
      writeBytes(folder_.file(name), data_);
      const auto reader = openAlone("s3://bucket/a=b/c d/" + std::string(name), options_);
      EXPECT_EQ(read(*reader, 100'000, 50'000), "") << "with a condition, which is signed too";
    }
  setenv("AWS_SECRET_ACCESS_KEY", "another", 1);
  EXPECT_THROW(openAlone("s3://bucket/data", options_), Error);
  for (const auto& [name, value] : keys) unsetenv(name.c_str());
  unsetenv("AWS_SESSION_TOKEN");
}

// As those of a pyramid of many files.
TEST_F(HttpRangesTest, FilesShareOneThreadAndOneWindow) {
  std::thread([] {}).join();  // with the first thread ThreadSanitizer starts one of its own
  const std::size_t threads_before = threadCount();
  const auto connections = makeHttpConnections(options_);
  std::vector<std::unique_ptr<RangeReader>> readers;
  for (int i = 0; i < 40; ++i)
    readers.push_back(openRemoteRanges(server_.url("good/data"), options_, connections));
  EXPECT_LE(threadCount(), threads_before + 1);
  // 120 MB are announced.
  for (const auto& reader : readers) {
    const std::array<ByteRange, 1> all{{{5000, kObjectBytes - 5000}}};
    reader->announce(all);
  }
  const auto aheadBytes = [&] {
    const std::lock_guard lock(connections->mutex);
    return connections->ahead_bytes;
  };
  EXPECT_LE(aheadBytes(), HttpRanges::kMostAheadBytes);
  EXPECT_GT(aheadBytes(), HttpRanges::kMostAheadBytes / 2);
  for (std::size_t i = 0; i < readers.size(); i += 2) readers[i].reset();
  for (std::size_t i = 1; i < readers.size(); i += 2)
    EXPECT_EQ(read(*readers[i], 5000, kObjectBytes - 5000), "");
  readers.clear();
  EXPECT_EQ(aheadBytes(), 0u);
}

TEST_F(HttpRangesTest, ReadsAnyRange) {
  const auto reader = open("good/data");
  ASSERT_EQ(reader->size(), kObjectBytes);
  EXPECT_NE(reader->identity(), "");
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t offset = randomBelow(random, kObjectBytes);
    const std::uint64_t bytes = 1 + randomBelow(random, i < 90 ? 1000 : 2'500'000);
    EXPECT_EQ(read(*reader, offset, std::min(bytes, kObjectBytes - offset)), "");
  }
  EXPECT_EQ(read(*reader, 0, kObjectBytes), "");
  EXPECT_EQ(read(*reader, kObjectBytes - 1, 1), "");
  EXPECT_EQ(reader->counters().repeated, 0u);
}

TEST_F(HttpRangesTest, TheFirstBytesComeWithTheOpening) {
  const auto reader = open("good/data");
  EXPECT_EQ(read(*reader, 0, 512), "");
  EXPECT_EQ(reader->counters().requests, 1u);
  const auto shorter = open("good/short");
  EXPECT_EQ(shorter->size(), 100u);
  EXPECT_EQ(read(*shorter, 0, 100), "");
  EXPECT_EQ(shorter->counters().requests, 1u);
}

TEST_F(HttpRangesTest, TheFirstRequestMayBeOfTheEnd) {
  const auto connections = makeHttpConnections(options_);
  const auto ask = [&](const std::string& path, std::uint64_t bytes) {
    return askForRemoteRanges(server_.url(path), {.bytes = bytes, .is_of_end = true}, options_,
                              connections);
  };
  const auto reader = ask("good/data", 8196);
  ASSERT_TRUE(reader->waitUntilOpen(nullptr));
  EXPECT_EQ(reader->size(), kObjectBytes);
  EXPECT_EQ(read(*reader, kObjectBytes - 8196, 8196), "");
  EXPECT_EQ(reader->counters().requests, 1u);
  EXPECT_EQ(read(*reader, kObjectBytes - 8197, 100), "");
  EXPECT_EQ(read(*reader, 0, 100), "");
  EXPECT_EQ(reader->counters().requests, 3u);
  const auto shorter = ask("good/short", 8196);
  ASSERT_TRUE(shorter->waitUntilOpen(nullptr));
  EXPECT_EQ(read(*shorter, 0, 100), "") << "all of it is its end";
  EXPECT_EQ(shorter->counters().requests, 1u);
  const auto broken = ask("fails/503/first/data", 8196);
  EXPECT_THROW(broken->waitUntilOpen(nullptr), Error);
  EXPECT_EQ(broken->counters().requests, 3u);
}

TEST_F(HttpRangesTest, OnlyNoSuchFileIsMissing) {
  const auto connections = makeHttpConnections(options_);
  const auto ask = [&](const std::string& path) {
    return askForRemoteRanges(server_.url(path), {}, options_, connections);
  };
  const auto missing = ask("good/none"), gone = ask("fails/410/first/data"),
             forbidden = ask("fails/403/first/data");
  EXPECT_FALSE(missing->waitUntilOpen(nullptr));
  EXPECT_FALSE(missing->waitUntilOpen(nullptr)) << "asked again";
  EXPECT_THROW(gone->waitUntilOpen(nullptr), Error);
  EXPECT_THROW(forbidden->waitUntilOpen(nullptr), Error);
}

// As the chunks of a volume, which lie in a file each.
TEST_F(HttpRangesTest, ManyFilesAreAskedForAtOnce) {
  const RangeServer server(folder_.path(), {"--waves", "200"});
  const auto connections = makeHttpConnections(options_);
  std::vector<std::unique_ptr<RemoteRanges>> files;
  for (int i = 0; i < 20; ++i)
    files.push_back(askForRemoteRanges(server.url("good/data"), {.bytes = kObjectBytes + 1},
                                       options_, connections));
  for (const auto& file : files) {
    ASSERT_TRUE(file->waitUntilOpen(nullptr));
    EXPECT_EQ(read(*file, 0, kObjectBytes), "");
  }
  EXPECT_EQ(server.requests(), 20u);
  EXPECT_LE(server.waves(), 2u);
}

TEST_F(HttpRangesTest, AReadEndsWithTheFlag) {
  CancelFlag cancel;
  const auto reader = askForRemoteRanges(server_.url("hangs/2/data"), {.cancel = &cancel},
                                         {.stall_seconds = 60}, makeHttpConnections(options_));
  ASSERT_TRUE(reader->waitUntilOpen(&cancel));
  std::thread later([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    cancel.request();
  });
  EXPECT_NE(read(*reader, 10'000, 10), "");
  later.join();
}

TEST_F(HttpRangesTest, ManyThreadsReadAtOnce) {
  const auto reader = open("good/data");
  std::vector<std::thread> threads;
  for (unsigned t = 0; t < 16; ++t)
    threads.emplace_back([&, t] {
      Random random(t);
      for (int i = 0; i < 20; ++i) {
        // A few places, so that some want the same range.
        const std::uint64_t offset = 10'000 + 50'000 * randomBelow(random, 20);
        if (i % 3 == 0) {
          const ByteRange ahead{offset + 50'000, 20'000};
          reader->announce({&ahead, 1});
        }
        EXPECT_EQ(read(*reader, offset, 20'000), "");
      }
    });
  for (std::thread& thread : threads) thread.join();
}

TEST_F(HttpRangesTest, AnnouncedNeighboursComeInOneRequest) {
  const auto reader = open("good/data");
  std::vector<ByteRange> ranges;
  for (std::uint64_t i = 0; i < 10; ++i) ranges.push_back({100'000 + 10'000 * i, 9'500});
  ranges.push_back({2'000'000, 1000});
  reader->announce(ranges);
  for (const ByteRange& range : ranges) EXPECT_EQ(read(*reader, range.offset, range.bytes), "");
  EXPECT_EQ(reader->counters().requests, 3u) << "the opening, the neighbours, the other";
  EXPECT_EQ(read(*reader, 100'000, 9'500), "") << "once more, from the server";
  EXPECT_EQ(reader->counters().requests, 4u);
}

TEST_F(HttpRangesTest, WhatIsAnnouncedAndNeverReadIsBounded) {
  const TemporaryFolder folder;
  writeBytes(folder.file("long"), std::string(std::size_t{100} << 20, 'x'));
  const RangeServer server(folder.path());
  const auto reader = openAlone(server.url("good/long"), options_);
  for (std::uint64_t i = 0; i < 99; ++i) {
    const ByteRange range{(i << 20) + 5000, std::uint64_t{1} << 20};
    reader->announce({&range, 1});
  }
  std::this_thread::sleep_for(Seconds(0.3));
  EXPECT_LE(reader->counters().bytes, (std::uint64_t{66} << 20));
}

TEST_F(HttpRangesTest, RoundTripsAreSideBySide) {
  const RangeServer server(folder_.path(), {"--waves", "150"});
  const auto reader = openAlone(server.url("good/data"), {.cache_folder = {}});
  std::vector<ByteRange> ranges;
  for (std::uint64_t i = 0; i < 12; ++i) ranges.push_back({100'000 + 200'000 * i, 10'000});
  reader->announce(ranges);
  for (const ByteRange& range : ranges) EXPECT_EQ(read(*reader, range.offset, range.bytes), "");
  EXPECT_EQ(read(*reader, 5000, 2'900'000), "") << "in pieces, all at once";
  EXPECT_EQ(server.waves(), 3u);
}

// ---- failures

struct BadServer {
  const char* name;
  const char* path;
  const char* text;
};
std::string nameOf(const testing::TestParamInfo<BadServer>& test) { return test.param.name; }

class HttpServersRefused : public HttpRangesTest, public testing::WithParamInterface<BadServer> {};

TEST_P(HttpServersRefused, WhenTheFileIsOpened) {
  try {
    open(GetParam().path);
    FAIL() << "was opened";
  } catch (const Error& error) {
    const std::string what = error.what();
    EXPECT_EQ(what.rfind("cannot open 'http://127.0.0.1:", 0), 0u) << what;
    EXPECT_NE(what.find(GetParam().text), std::string::npos) << what;
    EXPECT_NE(what.find("; "), std::string::npos) << "what to do: " << what;
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, HttpServersRefused,
    testing::Values(
        BadServer{"WholeFile", "ignores/data", "ignores ranges"},
        BadServer{"WholeFileWithoutEnd", "ignores-without-end/data", "ignores ranges"},
        BadServer{"OtherRange", "other-range/first/data", "other bytes"},
        BadServer{"NoHttp", "no-http/data", "does not answer as HTTP has it"},
        BadServer{"NoStatus", "no-http/version/data", "does not answer as HTTP has it"},
        BadServer{"Circle", "circle/data", "redirects more than 5 times"},
        BadServer{"SixRedirects", "redirect/6/good/data", "redirects more than 5 times"},
        BadServer{"Nowhere", "nowhere/data", "redirects to nowhere (302)"},
        BadServer{"NowhereInWords", "nowhere/empty/data", "redirects to nowhere (302)"},
        BadServer{"ToALocalFile", "elsewhere/file/data", "not"},
        BadServer{"ToFtp", "elsewhere/ftp/data", "not"},
        BadServer{"Hangs", "hangs/1/data", "the server hangs"},
        BadServer{"Missing", "fails/404/first/data", "no such file (404)"},
        BadServer{"Forbidden", "fails/403/first/data", "refuses access (403)"},
        BadServer{"Broken", "fails/500/first/data", "busy or fails (500) (tried 3 times)"},
        BadServer{"Packed", "packed/data", "packs the bytes (gzip)"},
        BadServer{"UnknownTotal", "content-range/unknown/data", "does not say which bytes"},
        BadServer{"NoContentRange", "content-range/none/data", "does not say which bytes"},
        BadServer{"Words", "content-range/words/data", "does not say which bytes"},
        BadServer{"Reversed", "content-range/reversed/data", "does not say which bytes"},
        BadServer{"Huge", "content-range/huge/data", "does not say which bytes"},
        BadServer{"Negative", "content-range/negative/data", "does not say which bytes"},
        BadServer{"ShortTotal", "content-range/short/data", "does not say which bytes"},
        BadServer{"OtherUnits", "content-range/units/data", "does not say which bytes"},
        BadServer{"Multipart", "multipart/data", "does not say which bytes"},
        BadServer{"HeadersWithoutEnd", "headers-without-end/data", "headers without end"},
        BadServer{"Empty", "empty/data", "is empty"},
        BadServer{"NeedsAPassword", "secret/data", "refuses access (401)"}),
    nameOf);

TEST_F(HttpRangesTest, AServerThatIsNotThereIsSaidAtOnce) {
  const auto begin = std::chrono::steady_clock::now();
  for (const std::string url : {"http://127.0.0.1:1/data", "https://127.0.0.1:1/data"}) try {
      openAlone(url, options_);
      FAIL() << url;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("cannot be reached"), std::string::npos)
          << error.what();
    }
  EXPECT_LT(Seconds(std::chrono::steady_clock::now() - begin).count(), 3);
}

class HttpReadsRefused : public HttpRangesTest, public testing::WithParamInterface<BadServer> {};

TEST_P(HttpReadsRefused, WhenARangeIsRead) {
  const auto reader = open(GetParam().path);
  // With many readers at once, all of them are told, and nobody waits for ever.
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      const std::string why = read(*reader, 100'000 + 400'000 * t, 50'000);
      EXPECT_EQ(why.rfind("cannot be read: ", 0), 0u) << why;
      EXPECT_NE(why.find(GetParam().text), std::string::npos) << why;
      EXPECT_NE(why.find("; "), std::string::npos) << "what to do: " << why;
    });
  for (std::thread& thread : threads) thread.join();
}

INSTANTIATE_TEST_SUITE_P(
    All, HttpReadsRefused,
    testing::Values(BadServer{"OtherRange", "other-range/data", "other bytes"},
                    BadServer{"PartOfRange", "part-of-range/data", "other bytes"},
                    BadServer{"TooLittle", "too-little/data", "fewer bytes"},
                    BadServer{"TooLittleUnsaid", "too-little-unsaid/data", "fewer bytes"},
                    BadServer{"TooMuch", "too-much/data", "more bytes"},
                    BadServer{"Contradicts", "contradicts/data", "contradicts itself"},
                    BadServer{"Hangs", "hangs/2/data", "the server hangs"},
                    BadServer{"HangsInTheBody", "hangs/body/data", "the server hangs"},
                    BadServer{"Busy", "fails/503/always/data", "busy or fails (503)"},
                    BadServer{"Resets", "resets/1000/data", "breaks off"},
                    BadServer{"Ends", "ends/data", "breaks off"},
                    BadServer{"Forbidden", "fails/403/always/data", "refuses access (403)"},
                    BadServer{"OtherTag", "changes/etag/data", "was changed"},
                    BadServer{"OtherTagUnsaid", "changes/silent-etag/data", "was changed"},
                    BadServer{"OtherWeakTag", "changes/weak-etag/data", "was changed"},
                    BadServer{"OtherTime", "changes/time/data", "was changed"},
                    BadServer{"OtherTimeUnsaid", "changes/silent-time/data", "was changed"},
                    BadServer{"OtherSize", "changes/size/data", "was changed"},
                    BadServer{"Cut", "cut/data", "was changed"}),
    nameOf);

// ---- what passes

class HttpServersBorneWith : public HttpRangesTest,
                             public testing::WithParamInterface<BadServer> {};

TEST_P(HttpServersBorneWith, AndTheBytesAreRight) {
  const auto reader = open(GetParam().path);
  for (std::uint64_t i = 0; i < 5; ++i) EXPECT_EQ(read(*reader, 100'000 + 400'000 * i, 50'000), "");
}

INSTANTIATE_TEST_SUITE_P(All, HttpServersBorneWith,
                         testing::Values(BadServer{"Busy", "fails/503/2/data", ""},
                                         BadServer{"TooMany", "fails/429/2/data", ""},
                                         BadServer{"Resets", "resets/2/data", ""},
                                         BadServer{"TooLittle", "too-little/2/data", ""},
                                         BadServer{"Redirects", "redirect/5/good/data", ""},
                                         BadServer{"RedirectsThatForget", "redirect-once/data", ""},
                                         BadServer{"NoMarks", "without-marks/data", ""},
                                         BadServer{"WeakTag", "weak/data", ""},
                                         BadServer{"Slow", "slow/300/data", ""}),
                         nameOf);

TEST_F(HttpRangesTest, ARedirectIsFollowedOnce) {
  const auto reader = open("redirect/3/good/data");
  for (std::uint64_t i = 0; i < 3; ++i) EXPECT_EQ(read(*reader, 100'000 + 400'000 * i, 1000), "");
  EXPECT_EQ(server_.requests(), 3u + 1 + 3);
}

TEST_F(HttpRangesTest, WhatFailedIsAskedForAgainByTheNextReader) {
  options_.tries = 1;
  const auto reader = open("fails/500/1/data");
  EXPECT_NE(read(*reader, 100'000, 1000), "");
  EXPECT_EQ(read(*reader, 100'000, 1000), "");
}

// What libcurl does not take on is never answered, so nobody may wait for it.
TEST_F(HttpRangesTest, ARequestThatCannotBeSentFailsAtOnce) {
  g_refused_requests = 1000;
  try {
    open("good/data");
    FAIL() << "opened";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("cannot be sent"), std::string::npos) << error.what();
  }
  g_refused_requests = 0;
  const auto reader = open("good/data");
  g_refused_requests = 1000;
  EXPECT_NE(read(*reader, 2'000'000, 1000).find("cannot be sent"), std::string::npos);
  g_refused_requests = 0;
  EXPECT_EQ(read(*reader, 2'000'000, 1000), "");
}

TEST_F(HttpRangesTest, ReadersOfAnAbandonedFileWaitForNothing) {
  options_.stall_seconds = 60;
  const auto reader = open("hangs/2/data");
  const auto begin = std::chrono::steady_clock::now();
  std::thread closer([&] {
    std::this_thread::sleep_for(Seconds(0.2));
    reader->abandon();
  });
  EXPECT_NE(read(*reader, 100'000, 1000), "");
  closer.join();
  EXPECT_NE(read(*reader, 100'000, 1000), "");
  EXPECT_LT(Seconds(std::chrono::steady_clock::now() - begin).count(), 5);
}

TEST_F(HttpRangesTest, PasswordsAreSentAndNotShown) {
  const std::string url = "http://ann:pass@127.0.0.1:" + std::to_string(server_.port());
  EXPECT_EQ(read(*openAlone(url + "/secret/data?token=hidden", options_), 5000, 1000), "");
  try {
    openAlone(url + "/fails/404/first/data?token=hidden", options_);
    FAIL();
  } catch (const Error& error) {
    const std::string what = error.what();
    EXPECT_EQ(what.find("pass"), std::string::npos) << what;
    EXPECT_EQ(what.find("hidden"), std::string::npos) << what;
  }
}

TEST_F(HttpRangesTest, ProxiesAreThoseOfTheVariables) {
  setenv("http_proxy", ("http://127.0.0.1:" + std::to_string(server_.port())).c_str(), 1);
  // The server knows no such path: what a proxy is asked for is the whole URL.
  EXPECT_THROW(openAlone("http://isobrick.invalid/good/data", options_), Error);
  EXPECT_EQ(server_.stats()["requests"][0]["path"], "http://isobrick.invalid/good/data");
  unsetenv("http_proxy");
}

TEST_F(HttpRangesTest, CertificatesAreChecked) {
  const std::string pem = folder_.file("server.pem");
  const std::string make =
      "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=127.0.0.1 -addext "
      "subjectAltName=IP:127.0.0.1 -keyout '" +
      folder_.file("key") + "' -out '" + folder_.file("certificate") + "' 2>/dev/null && cat '" +
      folder_.file("key") + "' '" + folder_.file("certificate") + "' >'" + pem + "'";
  ASSERT_EQ(std::system(make.c_str()), 0);
  const RangeServer server(folder_.path(), {"--certificate", pem});
  try {
    openAlone(server.url("good/data"), options_);
    FAIL() << "nobody vouches for it";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("certificate"), std::string::npos) << error.what();
  }
  setenv("CURL_CA_BUNDLE", folder_.file("certificate").c_str(), 1);
  EXPECT_EQ(read(*openAlone(server.url("good/data"), options_), 5000, 100'000), "");
  unsetenv("CURL_CA_BUNDLE");
}

TEST(RemotePath, IsAUrlThatIsobrickReads) {
  for (const char* const path : {"http://a/b", "https://a/b", "s3://a/b", "HTTPS://A/B"})
    EXPECT_TRUE(isRemotePath(path)) << path;
  for (const char* const path : {"", "http", "http:/a/b", "ftp://a/b", "a/http://b", "/a/b.isb"})
    EXPECT_FALSE(isRemotePath(path)) << path;
}

TEST(RemotePath, IsShownWithoutSecrets) {
  EXPECT_EQ(withoutSecrets("https://a:b@c/d@e?f=g#h"), "https://c/d@e");
  EXPECT_EQ(withoutSecrets("https://c/d"), "https://c/d");
  EXPECT_EQ(withoutSecrets("s3://bucket/key?of@all"), "s3://bucket/key?of@all");
  EXPECT_EQ(withoutSecrets("https://a@b"), "https://b");
  EXPECT_EQ(withoutSecrets("a@b?c"), "a@b?c");
}

}  // namespace
}  // namespace isobrick::test
