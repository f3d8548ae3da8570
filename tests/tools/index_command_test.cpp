// `isobrick build --index`: level 0 stays in the scan, and every command takes the index.
#include "tests/support/command_test.h"
#include "tests/support/range_server.h"

namespace isobrick::test {
namespace {

class IndexCommandTest : public CommandTest {
 protected:
  // The words of an extraction write the same bytes of both.
  void expectSameMesh(const std::string& whole, const std::string& index, Words query) {
    query.insert(query.begin(), "extract");
    std::vector<std::string> meshes;
    for (const std::string& file : {whole, index}) {
      Words words = query;
      words.insert(words.begin() + 1, file);
      for (const char* word : {"-o", "mesh.ply", "--force"}) words.emplace_back(word);
      runWell(words);
      meshes.push_back(readBytes(path("mesh.ply")));
    }
    EXPECT_GT(meshes.front().size(), 10000u);
    EXPECT_TRUE(meshes.front() == meshes.back());
  }
};

TEST_F(IndexCommandTest, AnIndexIsAPyramidOfLessBytes) {
  runWell({"phantom", "head", "--voxels", "100", "-o", "head.nrrd"});
  runWell({"build", "head.nrrd", "-o", "whole.isb", "--codec", "none"});
  const Json built =
      runForJson({"build", "--index", "head.nrrd", "-o", "index.isb", "--codec", "none"});
  EXPECT_EQ(built["index"], true);
  EXPECT_LT(fs::file_size(path("index.isb")), fs::file_size(path("whole.isb")) / 3);
  const Json again = runForJson({"build", "--index", "head.nrrd", "-o", "index.isb"});
  EXPECT_EQ(again["skipped"], false);  // another codec
  EXPECT_EQ(runForJson({"build", "--index", "head.nrrd", "-o", "index.isb"})["skipped"], true);

  const Json info = runForJson({"info", "index.isb"});
  EXPECT_EQ(info["level0"]["path"], "head.nrrd");
  EXPECT_GT(info["codecs"]["samples"]["source"], 0);
  EXPECT_EQ(info["bytes"]["samples_level0"], 0);
  EXPECT_EQ(runForJson({"info", "whole.isb"})["level0"], nullptr);
  runWell({"verify", "index.isb"});

  expectSameMesh("whole.isb", "index.isb", {"--iso", "900"});
  expectSameMesh("whole.isb", "index.isb",
                 {"--iso", "900", "--focus", "50,50,50", "--radius", "20", "--memory", "1M"});
  expectSameMesh("whole.isb", "index.isb", {"--iso", "900", "--no-map"});
  for (const char* file : {"whole.isb", "index.isb"})
    runWell({"convert", file, "-o", std::string(file) + ".mha"});
  EXPECT_TRUE(readBytes(path("whole.isb.mha")) == readBytes(path("index.isb.mha")));
  for (const char* part : {"1/2", "2/2"})
    runWell({"extract", "index.isb", "--iso", "900", "--part", part, "-o",
             std::string("share") + part[0] + ".isbm"});
  runWell({"merge", "share1.isbm", "share2.isbm", "-o", "merged.ply"});
  runWell({"extract", "whole.isb", "--iso", "900", "-o", "mesh.ply", "--force"});
  EXPECT_TRUE(readBytes(path("merged.ply")) == readBytes(path("mesh.ply")));
}

TEST_F(IndexCommandTest, WhatCannotBeOneIsRefused) {
  runWell({"phantom", "head", "--voxels", "40", "-o", "head.nrrd"});
  runWell({"convert", "head.nrrd", "-o", "head.nii.gz"});
  expectFailure(1, {"build", "--index", "head.nii.gz"}, "build a pyramid of it in place");
  expectFailure(1, {"build", "--index", "phantom:head:40"}, "is no file");
  expectFailure(1, {"build", "--index", "head.nrrd", "--denoise", "1"}, "one by one");
  expectFailure(2, {"build", "--index", "head.nrrd", "--resume"}, "--resume");

  runWell({"build", "--index", "head.nrrd"});
  fs::last_write_time(path("head.nrrd"), fs::file_time_type::clock::now());
  expectFailure(1, {"extract", "head.isb", "--iso", "900"}, "changed since 'head.isb' was built");
}

TEST_F(IndexCommandTest, OfAStoreBehindAUrl) {
  runWell({"phantom", "head", "--voxels", "100", "-o", "head.nrrd"});
  runWell({"convert", "head.nrrd", "-o", "head.ome.zarr"});
  runWell({"build", "head.ome.zarr", "-o", "whole.isb"});
  const RangeServer server(work_.path());
  runWell({"build", "--index", server.url("good/head.ome.zarr"), "-o", "index.isb"});
  expectSameMesh("whole.isb", "index.isb", {"--iso", "900"});
  expectSameMesh("whole.isb", "index.isb", {"--iso", "900", "--box", "10,10,10,60,60,60"});

  // Metadata of another edition: the same store, so nothing else tells.
  writeBytes(path("head.ome.zarr/zarr.json"), readBytes(path("head.ome.zarr/zarr.json")) + " ");
  expectFailure(1, {"extract", "index.isb", "--iso", "900"},
                "the server has another edition of it");
}

}  // namespace
}  // namespace isobrick::test
