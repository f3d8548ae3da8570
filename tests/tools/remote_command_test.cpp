// Commands on pyramids behind HTTP: they take a URL wherever they take a pyramid.
#include <signal.h>

#include <chrono>
#include <thread>

#include "tests/support/command_test.h"
#include "tests/support/range_server.h"

namespace isobrick::test {
namespace {

class RemoteCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    runWell({"build", "phantom:head:64", "-o", "head.isb", "--brick", "16"});
    server_.emplace(work_.path());
    setenv("ISOBRICK_HTTP_TIMEOUT", "1", 1);
  }
  void TearDown() override { unsetenv("ISOBRICK_HTTP_TIMEOUT"); }

  std::string url(const std::string& behaviour = "good") const {
    return server_->url(behaviour + "/head.isb");
  }

  std::optional<RangeServer> server_;
};

TEST_F(RemoteCommandTest, ResultsAreThoseOfTheLocalFile) {
  const Words focus{"--iso", "500", "--focus", "30,30,30", "--radius", "8"};
  const auto with = [&](Words words) {
    words.insert(words.end(), focus.begin(), focus.end());
    return words;
  };
  runWell(with({"extract", "head.isb", "-o", "near.ply"}));
  runWell(with({"extract", url(), "-o", "far.ply"}));
  EXPECT_EQ(readBytes(path("near.ply")), readBytes(path("far.ply")));
  runWell({"render", "head.isb", "--iso", "500", "--size", "64x64", "-o", "near.png"});
  runWell({"render", url(), "--iso", "500", "--size", "64x64", "-o", "far.png"});
  EXPECT_EQ(readBytes(path("near.png")), readBytes(path("far.png")));
  runWell({"convert", "head.isb", "-o", "near.nrrd", "--level", "1"});
  runWell({"convert", url(), "-o", "far.nrrd", "--level", "1"});
  const std::string near = readBytes(path("near.nrrd")), far = readBytes(path("far.nrrd"));
  EXPECT_EQ(near.substr(near.find("\n\n")), far.substr(far.find("\n\n")));
  Json near_info = runForJson({"info", "head.isb"}), far_info = runForJson({"info", url()});
  near_info.erase("pyramid");
  far_info.erase("pyramid");
  EXPECT_EQ(near_info, far_info);
  EXPECT_NE(runWell({"verify", url()}).find("bricks are whole"), std::string::npos);
  EXPECT_EQ(runForJson({"bench", url(), "--iso", "500", "--rounds", "1", "--repeat", "1", "--rows",
                        "isobrick", "--no-distances"})["rows"]
                .size(),
            1u);
  runWell(with({"extract", "head.isb", "--attribute", url(), "-o", "values.ply"}));
}

TEST_F(RemoteCommandTest, TheReportSaysWhatTheNetworkDid) {
  const Json json = runForJson({"extract", url(), "--iso", "500"});
  EXPECT_EQ(json["remote"]["requests"], server_->requests());
  EXPECT_EQ(json["remote"]["open_requests"], 2);
  EXPECT_GT(json["remote"]["bytes"], json["bytes_read"]);
  EXPECT_FALSE(runForJson({"extract", "head.isb", "--iso", "500"}).contains("remote"));
}

TEST_F(RemoteCommandTest, NoReportShowsWhatSignsTheUrl) {
  const std::string signed_url = url() + "?X-Amz-Signature=5ec2e7";
  for (const Words& words :
       {Words{"info", signed_url}, Words{"convert", signed_url, "-o", "a.nrrd"},
        Words{"extract", "head.isb", "--iso", "500", "--attribute", signed_url, "-o", "a.ply"},
        Words{"verify", signed_url}}) {
    for (const bool as_json : {false, true}) {
      Words all = words;
      if (as_json && words[0] != "verify") all.push_back("--json");
      if (words[0] == "convert" || words[0] == "extract") all.push_back("--force");
      const Outcome outcome = run(all);
      EXPECT_EQ(outcome.status, 0) << outcome.err;
      EXPECT_EQ((outcome.out + outcome.err).find("5ec2e7"), std::string::npos)
          << words[0] << "\n"
          << outcome.out << outcome.err;
    }
  }
}

TEST_F(RemoteCommandTest, AViewShowsItAsTheLocalFile) {
  for (const std::string& source : {std::string("head.isb"), url()}) {
    writeBytes(path("script.json"),
               R"({"size": [120, 90], "steps": [{"wait": "settled"}, {"picture": "a.png"}]})");
    const Outcome outcome =
        run({"view", source, "--offscreen", "--script", "script.json", "--force"});
    ASSERT_EQ(outcome.status, 0) << outcome.err;
    fs::rename(path("a.png"), path(source == "head.isb" ? "near.png" : "far.png"));
  }
  EXPECT_EQ(readBytes(path("near.png")), readBytes(path("far.png")));
}

TEST_F(RemoteCommandTest, PartsStayInTheCacheFolder) {
  const Words words{"extract",        url(),  "--iso",        "500",
                    "--cache-folder", "kept", "--cache-size", "100M"};
  EXPECT_EQ(runForJson(words)["remote"]["cached_parts"], 0);
  const Json again = runForJson(words);
  EXPECT_GT(again["remote"]["cached_parts"], 0);
  EXPECT_EQ(again["remote"]["requests"], again["remote"]["open_requests"]);
  EXPECT_GT(runForJson({"cache", "--cache-folder", "kept"})["remote_parts"]["bytes"], 0);
  EXPECT_GT(runForJson({"cache", "--cache-folder", "kept", "--clear"})["remote_parts"]["count"], 0);
  EXPECT_EQ(runForJson({"cache", "--cache-folder", "kept"})["remote_parts"]["count"], 0);
}

TEST_F(RemoteCommandTest, FailuresAreOneLine) {
  expectFailure(1, {"info", server_->url("good/missing/none")}, "cannot open 'http://127.0.0.1:");
  expectFailure(1, {"info", url("ignores")}, "ignores ranges");
  expectFailure(1, {"verify", url("fails/404/first")}, "no such file (404); check the address");
  expectFailure(1, {"extract", url("circle"), "--iso", "500"}, "redirects more than 5 times");
  expectFailure(1, {"extract", url("changes/etag"), "--iso", "500"},
                "was changed while it was open");
  expectFailure(1, {"extract", "http://127.0.0.1:1/x.isb", "--iso", "500"}, "cannot be reached");
  expectFailure(1, {"extract", "head.isb", "--iso", "500", "-o", "http://host/x.ply"},
                "isobrick writes files alone");
  expectFailure(1, {"convert", url(), "-o", "s3://bucket/x.nrrd"}, "isobrick writes files alone");
  expectFailure(1, {"build", url(), "-o", "x.isb"}, "behind a URL isobrick reads OME-Zarr alone");
  expectFailure(1, {"info", "s3://bucket"}, "names no object");
  expectFailure(2, {"bench", url(), "--iso", "500", "--page-cache", "cold"}, "no page cache");
}

TEST_F(RemoteCommandTest, CtrlCDoesNotWaitForTheServer) {
  setenv("ISOBRICK_HTTP_TIMEOUT", "60", 1);
  for (const char* const behaviour : {"hangs/1", "hangs/2", "hangs/4", "hangs/body"}) {
    const auto begin = std::chrono::steady_clock::now();
    const pid_t pid = start({isobrickCommand(), "extract", url(behaviour), "--iso", "500"});
    std::this_thread::sleep_for(std::chrono::milliseconds(700));
    kill(pid, SIGINT);
    const Outcome outcome = wait(pid);
    EXPECT_EQ(outcome.status, 130) << behaviour << ": " << outcome.err;
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5)) << behaviour;
  }
}

}  // namespace
}  // namespace isobrick::test
