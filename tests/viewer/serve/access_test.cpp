// Keys, hosts, origins and paths of requests.
#include "isobrick/viewer/serve/access.h"

#include <gtest/gtest.h>

#include <set>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/serve/served_volumes.h"

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
  for (const char* const wrong :
       {"", "Bearer", "Bearer ", "0123", "bearer 0123", "Bearer 01234", "Bearer 012", "Bearer 0124",
        "Bearer 1123", "Basic 0123", " Bearer 0123"})
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
  EXPECT_NE(access.contentPolicy().find(
                "frame-ancestors 'self' vscode-webview: vscode-file: https://scans.example.org"),
            std::string::npos);
}

TEST(Access, OriginsHaveNoPath) {
  EXPECT_EQ(checkedOrigin("https://Scans.example.org:8443"), "https://scans.example.org:8443");
  for (const char* const wrong : {"", "scans.example.org", "https://", "https://a/b", "https://a/",
                                  "ftp://a", "https://a b", "https://a;script-src *", "*"})
    EXPECT_THROW(checkedOrigin(wrong), Error) << wrong;
}

TEST(ServedVolumes, PathsNameAVolume) {
  EXPECT_EQ(volumePathOf("/api/volume/12/slice.png")->volume, 12u);
  EXPECT_EQ(volumePathOf("/api/volume/12/slice.png")->rest, "/slice.png");
  EXPECT_EQ(volumePathOf("/api/volume/0")->rest, "");
  for (const char* const other : {"/api/volume/", "/api/volume/-1", "/api/volume/1x",
                                  "/api/volumes", "/api/volume/99999999999999999999999", ""})
    EXPECT_FALSE(volumePathOf(other)) << other;
}

}  // namespace
}  // namespace isobrick
