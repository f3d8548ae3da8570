// Commands that take a volume as they take a pyramid, and `isobrick cache`, which has what they
// built.
#include <sys/file.h>

#include <cstdint>
#include <fstream>

#include "tests/support/command_test.h"

namespace isobrick::test {
namespace {

class CacheCommandTest : public CommandTest {
 protected:
  void SetUp() override {
    unsetenv("ISOBRICK_CACHE_SIZE");
    makeSphere("sphere.nrrd", 40);
  }
  void TearDown() override { unsetenv("ISOBRICK_CACHE_SIZE"); }

  void makeSphere(const std::string& name, int size) {
    runWell({"phantom", "sphere", "--voxels", std::to_string(size), "-o", name});
  }
  std::string folder() const { return log_.file("cache") + "/isobrick"; }
  std::set<std::string> cached() const {
    std::set<std::string> names;
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(folder(), ignored))
      names.insert(entry.path().filename().string());
    return names;
  }
  // The pyramid of the volume; it is built if it is not there.
  std::string pyramidOf(const std::string& volume) {
    runWell({"extract", volume, "--iso", "0", "--level", "1"});
    return runForJson({"info", volume})["pyramid"].get<std::string>();
  }
};

TEST_F(CacheCommandTest, AFullCacheIsSaidBeforeItGrows) {
  const Words words = {"extract", "sphere.nrrd", "--iso", "0", "--level", "1"};
  fs::create_directories(folder());
  writeBytes(folder() + "/0123456789abcdef.isb", "");
  fs::resize_file(folder() + "/0123456789abcdef.isb", 9'000'000'000);  // without blocks
  const std::string warned = run(words).err;
  EXPECT_NE(warned.find("isobrick: warning: the cache in '" + folder()), std::string::npos);
  EXPECT_NE(warned.find("XDG_CACHE_HOME"), std::string::npos);
  EXPECT_EQ(run(words).err, "") << "it is there already";
}

TEST_F(CacheCommandTest, AVolumeIsTakenAsItsPyramid) {
  runWell({"extract", "sphere.nrrd", "--iso", "0", "--level", "1", "-o", "of_volume.ply"});
  EXPECT_FALSE(fs::exists(path("sphere.isb")));
  ASSERT_EQ(cached().size(), 1u);
  fs::create_directory(path("built"));
  runWell({"build", "sphere.nrrd", "-o", "built/s.isb"});
  runWell({"extract", "built/s.isb", "--iso", "0", "--level", "1", "-o", "of_pyramid.ply"});
  EXPECT_EQ(readBytes(path("of_volume.ply")), readBytes(path("of_pyramid.ply")));
  runWell({"render", "sphere.nrrd", "--iso", "0", "--size", "64x64", "-o", "of_volume.png"});
  runWell({"render", "built/s.isb", "--iso", "0", "--size", "64x64", "-o", "of_pyramid.png"});
  EXPECT_EQ(readBytes(path("of_volume.png")), readBytes(path("of_pyramid.png")));
  Json of_volume = runForJson({"info", "sphere.nrrd"}),
       of_pyramid = runForJson({"info", "built/s.isb"});
  for (Json* info : {&of_volume, &of_pyramid}) {
    info->erase("pyramid");
    info->erase("provenance");
    info->erase("bytes");
  }
  EXPECT_EQ(of_volume, of_pyramid);
  EXPECT_EQ(runForJson({"bench", "sphere.nrrd", "--iso", "0", "--rounds", "1", "--repeat", "1",
                        "--rows", "isobrick", "--no-distances"})["rows"]
                .size(),
            1u);
  runWell({"extract", "phantom:torus:32", "--iso", "0", "--level", "1", "--attribute",
           "sphere.nrrd", "-o", "t.ply"});
  EXPECT_EQ(cached().size(), 2u);
}

TEST_F(CacheCommandTest, AVolumeIsFoundAgainUntilItChanges) {
  const std::string first = pyramidOf("sphere.nrrd");
  const auto time = fs::last_write_time(first);
  fs::create_directory(path("moved"));
  fs::rename(path("sphere.nrrd"), path("moved/ball.nrrd"));
  EXPECT_EQ(pyramidOf("moved/ball.nrrd"), first);
  EXPECT_EQ(fs::last_write_time(first), time);
  const std::string content = readBytes(path("moved/ball.nrrd"));
  std::ofstream(path("moved/ball.nrrd"), std::ios::binary)
      << content.substr(0, content.size() - 4) << std::string(4, '\0');
  EXPECT_NE(pyramidOf("moved/ball.nrrd"), first);
  EXPECT_NE(pyramidOf("phantom:sphere:40"), first);
  // Another place in the world is another pyramid.
  runWell({"extract", "moved/ball.nrrd", "--spacing", "2,3,4", "--iso", "0", "--level", "1"});
  EXPECT_EQ(cached().size(), 4u);
}

TEST_F(CacheCommandTest, APyramidBesideTheVolumeIsUsedIfItIsUpToDate) {
  runWell({"build", "sphere.nrrd"});
  EXPECT_EQ(fs::path(pyramidOf("sphere.nrrd")).filename(), "sphere.isb");
  runWell({"build", "sphere.nrrd", "--codec", "none"});
  EXPECT_EQ(fs::path(pyramidOf("sphere.nrrd")).parent_path(), folder());
}

TEST_F(CacheCommandTest, WordsSayHowToReadAVolume) {
  std::ofstream(path("a.raw"), std::ios::binary) << std::string(3 * 4 * 5, '\1');
  EXPECT_EQ(runForJson({"info", "a.raw", "--raw-dims", "3,4,5", "--raw-type", "u8"})["dimensions"],
            (Json{3, 4, 5}));
  expectFailure(1, {"info", "a.raw"}, "--raw-dims");
  expectFailure(1, {"extract", "a.raw", "--iso", "1"}, "--raw-dims");
  runWell({"build", "sphere.nrrd"});
  for (const Words& words :
       {Words{"info", "sphere.isb"}, {"extract", "sphere.isb", "--iso", "0"}}) {
    Words all = words;
    all.insert(all.end(), {"--spacing", "1,1,1"});
    expectFailure(2, all, "leave it out of a pyramid");
  }
  std::ofstream(path("rubbish.nrrd")) << "rubbish";
  expectFailure(1, {"extract", "rubbish.nrrd", "--iso", "0"}, "rubbish.nrrd");
  expectFailure(1, {"extract", "missing.nrrd", "--iso", "0"}, "missing.nrrd");
  expectFailure(1, {"extract", "typo.raw", "--raw-dims", "3,4,5", "--raw-type", "u8", "--iso", "1"},
                "cannot open 'typo.raw': No such file or directory");
  EXPECT_EQ(cached().size(), 0u);
}

// 512^3 voxels were 205 MB in the home folder, for a look at the header.
TEST_F(CacheCommandTest, InfoReadsHeadersAndBuildsNothing) {
  const Json facts = runForJson({"info", "sphere.nrrd"});
  EXPECT_EQ(cached(), std::set<std::string>{});
  EXPECT_FALSE(fs::exists(path("sphere.isb")));
  EXPECT_EQ(facts["pyramid"], Json());
  EXPECT_EQ(facts["format"], "NRRD");
  EXPECT_EQ(facts["sampled_voxels"], 40 * 40 * 40);
  EXPECT_EQ(facts["bytes"]["total"], Json());
  const std::string text = runWell({"info", "sphere.nrrd"});
  EXPECT_NE(text.find("sphere.nrrd: 40 x 40 x 40 "), std::string::npos) << text;
  EXPECT_NE(text.find("pyramid    none yet"), std::string::npos) << text;
  // What both have is the same once there is a pyramid.
  const std::string pyramid = pyramidOf("sphere.nrrd");
  const Json info = runForJson({"info", "sphere.nrrd"});
  EXPECT_EQ(info["pyramid"], pyramid);
  for (const char* key : {"dimensions", "voxel_type", "spacing", "origin", "length_unit",
                          "direction", "value_range", "levels"})
    EXPECT_EQ(info[key], facts[key]) << key;
  EXPECT_EQ(info["bytes"]["raw"], facts["bytes"]["raw"]);
}

// A tenth of the home folder goes there only if the user says so.
TEST_F(CacheCommandTest, LargeVolumesWantAFolderByName) {
  const auto failure = [&](const std::string& most) {
    return run({"build", "sphere.nrrd", "--into-cache", folder(), "--cache-most", most});
  };
  const Outcome refused = failure("1000");
  EXPECT_EQ(refused.status, 1);
  EXPECT_NE(refused.err.find("--cache-folder"), std::string::npos) << refused.err;
  EXPECT_EQ(cached(), std::set<std::string>{});
  EXPECT_EQ(failure("1M").status, 0);
  EXPECT_EQ(failure("1000").status, 0);  // it is there
  // 8.6 GB; nothing of it is read.
  expectFailure(1, {"extract", "phantom:sphere:2048", "--iso", "0", "--level", "1", "-o", "a.ply"},
                "'phantom:sphere:2048' has ");
}

// What cannot be continued there is begun anew, as nobody says how to go on.
TEST_F(CacheCommandTest, ALeftBuildThatCannotBeContinuedIsBegunAnew) {
  const std::string pyramid = pyramidOf("sphere.nrrd");
  fs::remove(pyramid);
  std::ofstream(pyramid + ".partial") << std::string(5000, '\0');
  EXPECT_EQ(pyramidOf("sphere.nrrd"), pyramid);
  EXPECT_EQ(cached().size(), 1u);
}

TEST_F(CacheCommandTest, ItIsListedAndCleared) {
  EXPECT_EQ(runForJson({"cache"})["pyramids"], Json::array());
  const std::string pyramid = pyramidOf("sphere.nrrd");
  std::ofstream(folder() + "/other.isb") << "somebody's";
  std::ofstream(folder() + "/0123456789abcdef.isb.partial") << "unfinished";
  std::ofstream(folder() + "/0123456789abcdef.isb.lock") << "";
  const Json json = runForJson({"cache"});
  ASSERT_EQ(json["pyramids"].size(), 2u);
  EXPECT_EQ(json["folder"], folder());
  EXPECT_EQ(json["bound_bytes"], std::uint64_t{32} << 30);
  EXPECT_EQ(json["bytes"], fs::file_size(pyramid) + 10);
  for (const Json& entry : json["pyramids"]) {
    EXPECT_EQ(entry["whole"], entry["path"] == pyramid);
    EXPECT_EQ(entry["source"], entry["path"] == pyramid ? path("sphere.nrrd") : "");
  }
  const std::string text = runWell({"cache"});
  EXPECT_NE(text.find(path("sphere.nrrd")), std::string::npos) << text;
  EXPECT_NE(text.find("(unfinished)"), std::string::npos) << text;
  const Json removed = runForJson({"cache", "--clear"});
  EXPECT_EQ(removed["removed"], 2);
  EXPECT_EQ(removed["removed_bytes"], json["bytes"]);
  EXPECT_EQ(cached(), std::set<std::string>{"other.isb"});
}

TEST_F(CacheCommandTest, TheLeastRecentlyUsedGoesFirst) {
  makeSphere("b.nrrd", 41);
  makeSphere("c.nrrd", 42);
  const std::string a = pyramidOf("sphere.nrrd"), b = pyramidOf("b.nrrd");
  EXPECT_EQ(pyramidOf("sphere.nrrd"), a);  // used once more
  setenv("ISOBRICK_CACHE_SIZE", std::to_string(fs::file_size(a) + fs::file_size(b) * 3 / 2).c_str(),
         1);
  const std::string c = pyramidOf("c.nrrd");
  EXPECT_TRUE(fs::exists(a));
  EXPECT_FALSE(fs::exists(b));
  EXPECT_TRUE(fs::exists(c));
  // The newest stays, however large it is.
  setenv("ISOBRICK_CACHE_SIZE", "1", 1);
  const std::string new_b = pyramidOf("b.nrrd");
  EXPECT_EQ(cached(), std::set<std::string>{fs::path(new_b).filename().string()});
  setenv("ISOBRICK_CACHE_SIZE", "much", 1);
  expectFailure(1, {"cache"}, "ISOBRICK_CACHE_SIZE");
}

TEST_F(CacheCommandTest, WhatIsUsedIsKept) {
  const std::string pyramid = pyramidOf("sphere.nrrd");
  const int user = open(pyramid.c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(flock(user, LOCK_SH), 0);
  EXPECT_EQ(runForJson({"cache", "--clear"})["in_use"], 1);
  setenv("ISOBRICK_CACHE_SIZE", "1", 1);
  pyramidOf("phantom:sphere:30");
  EXPECT_TRUE(fs::exists(pyramid));
  close(user);
  EXPECT_EQ(runForJson({"cache", "--clear"})["in_use"], 0);
  EXPECT_EQ(cached(), std::set<std::string>{});
}

// One builds, the others wait and take what it built.
TEST_F(CacheCommandTest, SeveralProcessesShareOne) {
  std::vector<pid_t> processes;
  for (int i = 0; i < 4; ++i)
    processes.push_back(
        start({isobrickCommand(), "extract", "phantom:head:96", "--iso", "1324", "--level", "1"}));
  for (const pid_t process : processes) EXPECT_EQ(wait(process).status, 0);
  EXPECT_EQ(cached().size(), 1u);
}

TEST_F(CacheCommandTest, WhatIsDamagedIsBuiltAgain) {
  const std::string pyramid = pyramidOf("sphere.nrrd");
  const std::string whole = readBytes(pyramid);
  fs::resize_file(pyramid, 1000);
  EXPECT_EQ(pyramidOf("sphere.nrrd"), pyramid);
  EXPECT_EQ(fs::file_size(pyramid), whole.size());
  setenv("XDG_CACHE_HOME", path("sphere.nrrd").c_str(), 1);
  expectFailure(1, {"extract", "sphere.nrrd", "--iso", "0", "--level", "1", "-o", "a.ply"},
                "XDG_CACHE_HOME");
}

TEST_F(CacheCommandTest, AFileAloneIsOpenedInTheViewer) {
  std::ofstream(path("script.json"))
      << R"({"size": [120, 90], "steps": [{"wait": "settled"}, {"picture": "a.png"}]})";
  runWell({"sphere.nrrd", "--offscreen", "--script", "script.json", "--out-dir", "frames"});
  EXPECT_GT(fs::file_size(path("frames/a.png")), 100u);
  expectFailure(2, {"missing.nrrd"}, "unknown subcommand or option 'missing.nrrd'");
}

}  // namespace
}  // namespace isobrick::test
