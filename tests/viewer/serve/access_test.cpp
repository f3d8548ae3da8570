// Keys, hosts, origins and targets of requests.
#include "isobrick/viewer/serve/access.h"

#include <gtest/gtest.h>

#include <set>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/url_query.h"

namespace isobrick {
namespace {

constexpr char kLocal[] = "127.0.0.1:8080";

TEST(Access, KeysAreLongAndNewEachTime) {
  std::set<std::string> keys;
  for (int i = 0; i < 100; ++i) keys.insert(newKey());
  EXPECT_EQ(keys.size(), 100u);
  for (const std::string& key : keys) {
    EXPECT_EQ(key.size(), 32u);
    EXPECT_EQ(key.find_first_not_of("0123456789abcdef"), std::string::npos);
  }
}

TEST(Access, TheKeyAloneLetsIn) {
  const Access access("0123", {});
  EXPECT_TRUE(access.isAuthorized("Bearer 0123"));
  for (const char* const wrong : {"", "Bearer", "Bearer ", "0123", "bearer 0123", "Bearer 01234",
                                  "Bearer 012", "Bearer 0124", "Basic 0123", " Bearer 0123"})
    EXPECT_FALSE(access.isAuthorized(wrong)) << wrong;
}

TEST(Access, HostsAreTheServersOwn) {
  Access access("key", {checkedOrigin("HTTPS://scans.example.org")});
  access.addHost("localhost:8080");
  for (const char* const own : {kLocal, "localhost:8080", "LocalHost:8080", "scans.example.org"})
    EXPECT_TRUE(access.isOwnHost(own, kLocal)) << own;
  for (const char* const foreign :
       {"", "127.0.0.1", "127.0.0.1:80", "localhost", "localhost:8080.evil.org", "evil.org:8080",
        "scans.example.org:8080", "127.0.0.1:8080 ", "x127.0.0.1:8080"})
    EXPECT_FALSE(access.isOwnHost(foreign, kLocal)) << foreign;
}

TEST(Access, OriginsAreTheServersOwnOrAllowedOnes) {
  const Access access("key", {checkedOrigin("https://scans.example.org")});
  for (const char* const good : {"", "http://127.0.0.1:8080", "https://scans.example.org"})
    EXPECT_TRUE(access.isAllowedOrigin(good, kLocal)) << good;
  for (const char* const bad :
       {"null", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "http://127.0.0.1",
        "http://scans.example.org", "https://evil.org", "https://scans.example.org.evil.org"})
    EXPECT_FALSE(access.isAllowedOrigin(bad, kLocal)) << bad;
  EXPECT_NE(access.contentPolicy().find("frame-ancestors 'self' https://scans.example.org"),
            std::string::npos);
}

TEST(Access, OriginsHaveNoPath) {
  EXPECT_EQ(checkedOrigin("https://Scans.example.org:8443"), "https://scans.example.org:8443");
  for (const char* const wrong : {"", "scans.example.org", "https://", "https://a/b", "https://a/",
                                  "ftp://a", "https://a b", "https://a;script-src *", "*"})
    EXPECT_THROW(checkedOrigin(wrong), Error) << wrong;
}

TEST(UrlQuery, WordsAreNumbersWithinBounds) {
  const UrlQuery words("iso=-1.5e2&focus=1%2C2,3.5&level=2&pair=1,2&name=a%20b");
  EXPECT_EQ(words.number("iso", -1000, 1000), -150.0);
  EXPECT_EQ(words.point("focus"), glm::dvec3(1, 2, 3.5));
  EXPECT_EQ(words.integer("level", 0, 3), 2);
  EXPECT_EQ((*words.pair("pair"))[1], 2.0);
  EXPECT_EQ(words.text("name"), "a b");
  EXPECT_FALSE(words.number("other", 0, 1));
  EXPECT_THROW(words.number("iso", 0, 1), Error);
  EXPECT_THROW(words.integer("iso", 0, 1), Error);
  EXPECT_THROW(words.point("pair"), Error);
  EXPECT_THROW(words.pair("focus"), Error);
  EXPECT_EQ(UrlQuery("a=1&b=2").normalized(), UrlQuery("b=2&a=1").normalized());
  EXPECT_NE(UrlQuery("a=1&b=2").normalized(), UrlQuery("a=12&b=").normalized());
  for (const char* const wrong : {"a", "=1", "a=1&a=2", "a=%", "a=%4", "a=%zz", "&"})
    EXPECT_THROW(UrlQuery{wrong}, Error) << wrong;
  for (const char* const none : {"x=nan", "x=inf", "x=1e999", "x=1,", "x=", "x=1 ", "x=0x1"})
    EXPECT_THROW(UrlQuery(none).number("x", -1e9, 1e9), Error) << none;
}

TEST(UrlQuery, PathsOfVolumes) {
  EXPECT_EQ(volumePathOf("/api/volume/12/slice.png")->volume, 12u);
  EXPECT_EQ(volumePathOf("/api/volume/12/slice.png")->rest, "/slice.png");
  EXPECT_EQ(volumePathOf("/api/volume/0")->rest, "");
  for (const char* const other : {"/api/volume/", "/api/volume/-1", "/api/volume/1x",
                                  "/api/volumes", "/api/volume/99999999999999999999999", ""})
    EXPECT_FALSE(volumePathOf(other)) << other;
}

}  // namespace
}  // namespace isobrick
