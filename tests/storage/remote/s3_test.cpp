// Names that cannot be forged, accounts, and addresses of objects.
#include <gtest/gtest.h>

#include <map>

#include "isobrick/storage/error.h"
#include "isobrick/storage/remote/s3_object.h"
#include "isobrick/storage/remote/sha256.h"

namespace isobrick::test {
namespace {

// FIPS 180-4's examples, and lengths around a block.
TEST(Sha256Hash, IsThatOfTheStandard) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1'000'000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  EXPECT_EQ(sha256(std::string(55, 'a')),
            "9f4390f8d30c2dd92ec9f095b65e2b9ae9b0a925a5258e241c9f1e910f734318");
  EXPECT_EQ(sha256(std::string(56, 'a')),
            "b35439a4ac6f0948b6d6f9e3c6af0f5f590ce20f1bde7090ef7970686ec6738a");
  EXPECT_EQ(sha256(std::string(64, 'a')),
            "ffe054fe7ae0cb6dc65c3af9b61d5209f439851db43d0ba5997337df154668eb");
}

// Variables and files that a test says.
struct Surroundings {
  std::map<std::string, std::string> variables{{"HOME", "/home/ann"}};
  std::map<std::string, std::string> files;

  S3Surroundings all() const {
    const auto valueIn = [](const auto& map, const std::string& name) {
      const auto found = map.find(name);
      return found == map.end() ? std::string() : found->second;
    };
    return {[=, this](const std::string& name) { return valueIn(variables, name); },
            [=, this](const std::string& path) { return valueIn(files, path); }};
  }
  S3Account account() const { return findS3Account(all()); }
  S3Account google() const { return findGoogleAccount(all()); }
};

TEST(S3Account, IsAnonymousByDefault) {
  const S3Account account = Surroundings().account();
  EXPECT_FALSE(account.keys);
  EXPECT_EQ(account.region, "us-east-1");
  EXPECT_EQ(account.endpoint, "");
}

TEST(S3Account, IsThatOfTheVariables) {
  Surroundings around;
  around.variables["AWS_ACCESS_KEY_ID"] = "id";
  around.variables["AWS_SECRET_ACCESS_KEY"] = "secret";
  around.variables["AWS_SESSION_TOKEN"] = "token";
  around.variables["AWS_DEFAULT_REGION"] = "eu-west-1";
  around.variables["AWS_ENDPOINT_URL"] = "http://host:9000/";
  around.files["/home/ann/.aws/credentials"] = "[default]\naws_access_key_id=other\n";
  S3Account account = around.account();
  ASSERT_TRUE(account.keys);
  EXPECT_EQ(account.keys->id, "id");
  EXPECT_EQ(account.keys->secret, "secret");
  EXPECT_EQ(account.keys->token, "token");
  EXPECT_EQ(account.region, "eu-west-1");
  EXPECT_EQ(account.endpoint, "http://host:9000");
  around.variables["AWS_REGION"] = "eu-west-2";
  around.variables["AWS_ENDPOINT_URL_S3"] = "https://s3.here";
  around.variables["AWS_NO_SIGN_REQUEST"] = "YES";
  account = around.account();
  EXPECT_FALSE(account.keys);
  EXPECT_EQ(account.region, "eu-west-2");
  EXPECT_EQ(account.endpoint, "https://s3.here");
}

TEST(GoogleAccount, IsThatOfItsOwnVariables) {
  Surroundings around;
  around.variables["AWS_ACCESS_KEY_ID"] = "other";
  around.variables["AWS_SECRET_ACCESS_KEY"] = "secret";
  EXPECT_FALSE(around.google().keys);
  EXPECT_EQ(S3Object("gs://scans/a b.isb", around.google()).url(),
            "https://storage.googleapis.com/scans/a%20b.isb");
  around.variables["GS_ACCESS_KEY_ID"] = "id";
  EXPECT_THROW(around.google(), Error);
  around.variables["GS_SECRET_ACCESS_KEY"] = "secret";
  ASSERT_TRUE(around.google().keys);
  EXPECT_EQ(around.google().keys->id, "id");
  around.variables["STORAGE_EMULATOR_HOST"] = "http://127.0.0.1:9000/";
  EXPECT_EQ(S3Object("GS://scans/a.isb", around.google()).url(),
            "http://127.0.0.1:9000/scans/a.isb");
  EXPECT_THROW(S3Object("gs://scans", around.google()), Error);
}

TEST(S3Account, IsThatOfTheProfile) {
  Surroundings around;
  around.files["/home/ann/.aws/credentials"] =
      "# keys\n[default]\naws_access_key_id = one\naws_secret_access_key = two\n\n"
      "[lab]\r\nAWS_ACCESS_KEY_ID=three\r\naws_secret_access_key=fo=ur\r\naws_session_token=t\r\n";
  around.files["/home/ann/.aws/config"] =
      "[default]\nregion = eu-north-1\n[profile lab]\nregion=eu-south-1\n"
      "endpoint_url = https://lab\ns3 =\n  region = none\n[lab]\nregion = wrong\n";
  S3Account account = around.account();
  ASSERT_TRUE(account.keys);
  EXPECT_EQ(account.keys->id, "one");
  EXPECT_EQ(account.keys->token, "");
  EXPECT_EQ(account.region, "eu-north-1");
  around.variables["AWS_PROFILE"] = "lab";
  account = around.account();
  EXPECT_EQ(account.keys->id, "three");
  EXPECT_EQ(account.keys->secret, "fo=ur");
  EXPECT_EQ(account.keys->token, "t");
  EXPECT_EQ(account.region, "eu-south-1");
  EXPECT_EQ(account.endpoint, "https://lab");
  around.files["/elsewhere"] = around.files["/home/ann/.aws/credentials"];
  around.files.erase("/home/ann/.aws/credentials");
  EXPECT_FALSE(around.account().keys);
  around.variables["AWS_SHARED_CREDENTIALS_FILE"] = "/elsewhere";
  EXPECT_TRUE(around.account().keys);
}

TEST(S3Account, OfWhichHalfIsMissingIsRefused) {
  Surroundings around;
  around.variables["AWS_ACCESS_KEY_ID"] = "id";
  EXPECT_THROW(around.account(), Error);
  around.variables.erase("AWS_ACCESS_KEY_ID");
  around.variables["AWS_PROFILE"] = "nowhere";
  EXPECT_THROW(around.account(), Error);
  around.files["/home/ann/.aws/config"] = "[profile nowhere]\nsso_session = x\n";
  EXPECT_THROW(around.account(), Error);
  around.variables["AWS_NO_SIGN_REQUEST"] = "1";
  EXPECT_NO_THROW(around.account());
  around.variables["AWS_ENDPOINT_URL"] = "host:9000";
  EXPECT_THROW(around.account(), Error);
}

TEST(S3Object, HasTheBucketInTheNameOfAmazonsServers) {
  const S3Account account{.keys = {}, .region = "eu-west-1", .endpoint = {}};
  S3Object object("s3://scans/a b/c.isb", account);
  EXPECT_EQ(object.url(), "https://scans.s3.eu-west-1.amazonaws.com/a%20b/c.isb");
  HttpRequest request;
  object.address(request);
  EXPECT_TRUE(request.headers.empty());
  EXPECT_FALSE(request.signature);
  object.useRegion("us-west-2");
  EXPECT_EQ(object.url(), "https://scans.s3.us-west-2.amazonaws.com/a%20b/c.isb");
  object.useRegion("evil.example/");
  EXPECT_EQ(object.url(), "https://scans.s3.us-west-2.amazonaws.com/a%20b/c.isb");
  S3Object dotted("s3://scans.org/c", account);
  EXPECT_EQ(dotted.url(), "https://s3.eu-west-1.amazonaws.com/scans.org/c");
}

TEST(S3Object, HasTheBucketInThePathElsewhere) {
  const S3Account account{.keys = S3Keys{"id", "secret", "token"},
                          .region = "us-east-1",
                          .endpoint = "http://127.0.0.1:9000/base"};
  S3Object object("S3://scans/c.isb", account);
  HttpRequest request;
  object.address(request);
  EXPECT_EQ(request.url, "http://127.0.0.1:9000/base/scans/c.isb");
  EXPECT_FALSE(request.follows_redirects);
  ASSERT_EQ(request.headers.size(), 2u);
  EXPECT_EQ(request.headers[1], "x-amz-security-token: token");
  ASSERT_TRUE(request.signature);
  EXPECT_EQ(request.signature->region, "us-east-1");
}

// Later versions of libcurl do not sign a path as it is, but without them.
TEST(S3Object, ASignedNameHasNoDotsBetweenSlashes) {
  const S3Account account{
      .keys = S3Keys{"id", "secret", ""}, .region = "us-east-1", .endpoint = {}};
  for (const char* const url : {"s3://b/a/../c.isb", "s3://b/./c.isb", "s3://b/a/.."}) {
    EXPECT_THROW(S3Object(url, account), Error) << url;
    EXPECT_NO_THROW(S3Object(url, {.keys = {}, .region = "us-east-1", .endpoint = {}})) << url;
  }
  EXPECT_NO_THROW(S3Object("s3://b/a..b/.c.isb", account));
}

TEST(S3Object, NamesWithoutABucketOrAKeyAreRefused) {
  const S3Account account{.keys = {}, .region = "us-east-1", .endpoint = {}};
  for (const char* const url : {"s3://", "s3://bucket", "s3://bucket/", "s3:///key", "s3://b@d/key",
                                "s3://b:9/key", "s3://b%2f/key"})
    EXPECT_THROW(S3Object(url, account), Error) << url;
  EXPECT_THROW(S3Object("s3://a/b", {.keys = {}, .region = "x.evil", .endpoint = {}}), Error);
}

}  // namespace
}  // namespace isobrick::test
