// isobrick bench as a whole; real peers are in peers_test.py.
#include <sys/stat.h>

#include <cstdint>
#include <fstream>

#include "tests/support/command_test.h"

namespace isobrick {
namespace {

using namespace test;

class BenchCommandTest : public CommandTest {
 protected:
  void makeSphere() {
    runWell({"phantom", "sphere", "--voxels", "32", "-o", "sphere.nrrd"});
    runWell({"build", "sphere.nrrd", "--brick", "16"});
  }
  // An executable that says the rows of `list`, and does what `script` says of each.
  std::string makePeers(const std::string& list, const std::string& script) {
    const std::string file = log_.file("peers");
    std::ofstream(file) << "#!/bin/sh\nif [ \"$1\" = --list ]; then printf '" << list
                        << "'; exit; fi\ncase \"$*\" in\n"
                        << script << "\nesac\n";
    chmod(file.c_str(), 0700);
    return file;
  }
  static const Json& rowOf(const Json& bench, const char* name) {
    for (const Json& row : bench["rows"])
      if (row["name"] == name) return row;
    throw std::runtime_error(std::string("no row ") + name);
  }
};

constexpr char kTwoSeconds[] =
    R"(echo '{"triangles":100,"vertices":52,"output_bytes":3000,"load_seconds":0.5,)"
    R"("prepare_seconds":0,"first_seconds":3,"seconds":[2,2,2],"processor_seconds":1,)"
    R"("loaded_rss_bytes":1,"peak_rss_bytes":5,"note":"of the test"}')";

TEST_F(BenchCommandTest, JsonHasAllFiguresWarmAndCold) {
  makeSphere();
  const Json extracted = runForJson({"extract", "sphere.isb", "--iso", "0"});
  for (const std::string cache : {"warm", "cold"}) {
    const Json bench =
        runForJson({"bench", "sphere.isb", "--iso", "0", "--rounds", "2", "--repeat", "3",
                    "--threads", "2", "--rows", "isobrick", "--page-cache", cache});
    EXPECT_EQ(bench["file"], "sphere.isb");
    EXPECT_EQ(bench["dimensions"], Json({32, 32, 32}));
    EXPECT_EQ(bench["voxel_type"], "float32");
    EXPECT_EQ(bench["rounds"], 2);
    EXPECT_GE(bench["cores"], 1);
    EXPECT_GE(bench["load"]["after"], 0);
    ASSERT_EQ(bench["rows"].size(), 1u);
    const Json& row = bench["rows"][0];
    EXPECT_EQ(row["name"], "isobrick");
    EXPECT_EQ(row["cache"], cache);
    EXPECT_EQ(row["threads"], 2);
    EXPECT_EQ(row["triangles"], extracted["triangles"]);
    EXPECT_EQ(row["vertices"], extracted["vertices"]);
    const auto all = row["seconds"]["all"].get<std::vector<double>>();
    ASSERT_EQ(all.size(), cache == "warm" ? 6u : 2u);
    EXPECT_EQ(row["seconds"]["min"], *std::min_element(all.begin(), all.end()));
    EXPECT_EQ(row["seconds"]["max"], *std::max_element(all.begin(), all.end()));
    const double median = row["seconds"]["median"];
    EXPECT_EQ(std::count_if(all.begin(), all.end(), [&](double s) { return s < median; }),
              std::count_if(all.begin(), all.end(), [&](double s) { return s > median; }));
    EXPECT_DOUBLE_EQ(row["mtri_s"], row["triangles"].get<double>() / 1e6 / median);
    EXPECT_DOUBLE_EQ(row["mvoxel_s"], 32 * 32 * 32 / 1e6 / median);
    EXPECT_EQ(row["ratio"], 1.0);
    EXPECT_EQ(row["ratio_to"], "isobrick");
    EXPECT_EQ(row.contains("cached_share_before"), cache == "cold");
    for (const char* key : {"peak_rss_bytes", "loaded_rss_bytes", "output_bytes"})
      EXPECT_GT(row[key], 0) << key;
    for (const char* key : {"first_seconds", "load_seconds", "processor_seconds"})
      EXPECT_GT(row[key]["min"], 0) << key;
    EXPECT_GT(row["busy_cores"], 0);
    if (cache == "cold") {
      EXPECT_GE(row["seconds"]["min"], row["first_seconds"]["min"]) << "opening is part of it";
    }
  }
}

TEST_F(BenchCommandTest, AnAdaptiveQueryHasARowWithItsDistances) {
  makeSphere();
  const Words words = {"bench",    "sphere.isb",
                       "--iso",    "0",
                       "--focus",  "15,15,4",
                       "--radius", "2",
                       "--rounds", "1",
                       "--repeat", "1",
                       "--rows",   "isobrick,isobrick-adaptive"};
  const Json bench = runForJson(words);
  ASSERT_EQ(bench["rows"].size(), 2u);
  EXPECT_FALSE(rowOf(bench, "isobrick").contains("distance"));
  const Json& row = rowOf(bench, "isobrick-adaptive");
  EXPECT_LT(row["triangles"], rowOf(bench, "isobrick")["triangles"]);
  EXPECT_EQ(row["triangles"], runForJson({"extract", "sphere.isb", "--iso", "0", "--focus",
                                          "15,15,4", "--radius", "2"})["triangles"]);
  for (const char* way : {"to_finest", "from_finest"}) {
    const Json& distance = row["distance"][way];
    EXPECT_GT(distance["mean"], 0) << way;
    EXPECT_LE(distance["mean"], distance["p99"]) << way;
    EXPECT_LE(distance["p99"], distance["max"]) << way;
    EXPECT_LT(distance["max"], 11) << way << ": no further than the sphere's radius";
    EXPECT_GT(distance["points"], 100) << way;
  }
  Words without = words;
  without.push_back("--no-distances");
  EXPECT_FALSE(rowOf(runForJson(without), "isobrick-adaptive").contains("distance"));

  const std::string text = runWell(words);
  EXPECT_NE(text.find("isobrick-adaptive"), std::string::npos) << text;
  EXPECT_NE(text.find("voxels from it to the finest surface, and back"), std::string::npos) << text;
}

TEST_F(BenchCommandTest, ASimplificationHasARowIfItIsNamed) {
  makeSphere();
  const Json bench =
      runForJson({"bench", "sphere.isb", "--iso", "0", "--rounds", "1", "--repeat", "1", "--level",
                  "0", "--rows", "isobrick,simplify-0.25,isobrick-adaptive"});
  ASSERT_EQ(bench["rows"].size(), 3u);
  const Json& row = rowOf(bench, "simplify-0.25");
  EXPECT_LT(row["triangles"], rowOf(bench, "isobrick")["triangles"]);
  EXPECT_EQ(row["triangles"],
            runForJson({"extract", "sphere.isb", "--iso", "0", "--simplify", "0.25"})["triangles"]);
  for (const char* way : {"to_finest", "from_finest"}) {
    EXPECT_GT(row["distance"][way]["mean"], 0) << way;
    EXPECT_LE(row["distance"][way]["max"], 0.25) << way;
    // Level 0 everywhere is the finest surface, whatever row it is in.
    EXPECT_LT(rowOf(bench, "isobrick-adaptive")["distance"][way]["max"], 1e-5) << way;
  }
}

TEST_F(BenchCommandTest, PeersHaveRowsAndFlyingEdgesIsTheMeasure) {
  makeSphere();
  const std::string peers = makePeers(
      "vtkFlyingEdges3D exact\\nanother exact\\n",
      "*\"voxels.raw --dims 32,32,32 --type float32 --spacing \"*\" --iso=0.5 --threads 2 "
      "--row \"*) " +
          std::string(kTwoSeconds) + ";;");
  const Words words = {"bench", "sphere.isb", "--iso", "0.5",     "--rounds",
                       "2",     "--threads",  "2",     "--peers", peers};
  const Json bench = runForJson(words);
  ASSERT_EQ(bench["rows"].size(), 3u);
  EXPECT_EQ(bench["rows"][0]["name"], "isobrick");
  const Json& own = bench["rows"][0];
  EXPECT_EQ(own["ratio_to"], "vtkFlyingEdges3D");
  EXPECT_DOUBLE_EQ(own["ratio"], 2 / own["seconds"]["median"].get<double>());
  const Json& row = rowOf(bench, "another");
  EXPECT_EQ(row["triangles"], 100);
  EXPECT_EQ(row["seconds"]["median"], 2.0);
  EXPECT_EQ(row["first_seconds"]["max"], 3.0);
  EXPECT_DOUBLE_EQ(row["mtri_s"], 5e-5);
  EXPECT_EQ(row["processor_seconds"]["median"], 1);
  EXPECT_EQ(row["busy_cores"], 0.5);
  EXPECT_EQ(row["peak_rss_bytes"], 5);
  EXPECT_EQ(row["note"], "of the test");
  EXPECT_EQ(row["seconds"]["all"].size(), 6u);
  const std::string text = runWell(words);
  EXPECT_NE(text.find("how many times as fast as vtkFlyingEdges3D"), std::string::npos) << text;
}

TEST_F(BenchCommandTest, ARowThatFailsOrIsKilledLeavesTheOthers) {
  makeSphere();
  const std::string peers =
      makePeers("good exact\\nfailing approximate\\nkilled exact\\nbabbling exact\\n",
                "*\"--row good\"*) " + std::string(kTwoSeconds) +
                    ";;\n*\"--row failing\"*) echo 'out of luck' >&2; exit 3;;\n"
                    "*\"--row killed\"*) kill -KILL $$;;\n*) echo nonsense;;");
  Words words = {"bench", "sphere.isb", "--iso", "0", "--rounds", "2", "--peers", peers, "--json"};
  const Outcome outcome = run(words);
  EXPECT_EQ(outcome.status, 1);
  EXPECT_EQ(outcome.errorLines(), 1) << outcome.err;
  EXPECT_NE(outcome.err.find("isobrick: row 'failing': 'peers' left with status 3: out of luck"),
            std::string::npos)
      << outcome.err;
  const Json bench = Json::parse(outcome.out);
  ASSERT_EQ(bench["rows"].size(), 5u);
  EXPECT_EQ(rowOf(bench, "good")["seconds"]["all"].size(), 6u);
  EXPECT_TRUE(rowOf(bench, "isobrick").contains("seconds"));
  for (const char* name : {"failing", "killed", "babbling"})
    EXPECT_FALSE(rowOf(bench, name).contains("seconds")) << name;
  EXPECT_NE(rowOf(bench, "killed")["failure"].get<std::string>().find("signal 9"),
            std::string::npos);
  EXPECT_NE(rowOf(bench, "babbling")["failure"].get<std::string>().find("nonsense"),
            std::string::npos);

  words.pop_back();
  const Outcome table = run(words);
  EXPECT_EQ(table.status, 1);
  EXPECT_NE(table.out.find("failing: 'peers' left with status 3"), std::string::npos) << table.out;
}

TEST_F(BenchCommandTest, WhatCannotBeMeasuredIsRefused) {
  makeSphere();
  const Words bench = {"bench", "sphere.isb", "--iso", "0", "--rounds", "1"};
  const auto with = [&](const Words& more) {
    Words words = bench;
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  expectFailure(2, with({"--box", "0,0,0,9,9,9"}), "leave out --box");
  expectFailure(2, with({"--page-cache", "tepid"}), "tepid");
  expectFailure(2, with({"--rounds", "0"}), "--rounds");
  expectFailure(1, with({"--rows", "isobrick,other"}),
                "there is no row 'other'; there are isobrick");
  expectFailure(1, with({"--peers", "/nowhere/peers"}), "cannot run '/nowhere/peers'");
  expectFailure(1, {"bench", "missing.isb", "--iso", "0"}, "missing.isb");
  expectFailure(1, with({"--level", "60", "--rows", "isobrick-adaptive", "--no-distances"}),
                "level");
}

}  // namespace
}  // namespace isobrick
