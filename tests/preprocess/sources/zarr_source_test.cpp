// Zarr stores whose files cannot be opened: only what is not there is the fill value.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/open_faults.h"
#include "tests/support/range_server.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

// Chunks of 64: three along x, two along y and z.
constexpr Index3 kZarrVoxels(130, 65, 65);

class ZarrSourceTest : public VolumeFilesTest {
 protected:
  void SetUp() override {
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<std::uint8_t>>(
        kZarrVoxels,
        std::vector<std::uint8_t>(static_cast<std::size_t>(elementCount(kZarrVoxels)), 9)));
    ExportOptions options;
    options.zarr_version = 2;  // a file for each chunk
    exportVolume(levels, store_, options);
  }

  std::string chunk(const std::string& name) const { return store_ + "/0/" + name; }
  // Instead of what has that name.
  void linkToNowhere(const std::string& path) const {
    fs::remove_all(path);
    fs::create_symlink("../.git/annex/objects/of-another-machine", path);
  }
  void expectRefused(const std::string& named, const std::string& why) const {
    const std::string message = errorOf([&] { readAll(*openVolume(store_)); });
    EXPECT_CONTAINS(message, named);
    EXPECT_CONTAINS(message, why);
  }

  const std::string store_ = pathOf("a.ome.zarr");
};

TEST_F(ZarrSourceTest, AChunkThatIsALinkToNowhereIsNoMissingChunk) {
  linkToNowhere(chunk("1/0/2"));
  expectRefused("'" + chunk("1/0/2") + "'", "a link to '../.git/annex");
  expectRefused("'" + chunk("1/0/2") + "'", "git annex get");
}

TEST_F(ZarrSourceTest, AFolderOfChunksThatIsALinkToNowhereIsNoMissingChunk) {
  linkToNowhere(chunk("1"));
  expectRefused("'" + chunk("1") + "'", "a link to '../.git/annex");
}

TEST_F(ZarrSourceTest, AChunkThatCannotBeOpenedIsNoMissingChunk) {
  fs::remove(chunk("1/0/2"));
  fs::create_symlink("2", chunk("1/0/2"));  // itself
  expectRefused(chunk("1/0/2"), "Too many levels of symbolic links");
  fs::remove(chunk("1/0/2"));
  fs::create_directory(chunk("1/0/2"));
  expectRefused(chunk("1/0/2"), "not a regular file");
  fs::remove_all(chunk("1/0"));
  writeBytes(chunk("1/0"), "where a folder was");
  expectRefused(chunk("1/0/0"), "Not a directory");
}

// Rights that lack, a failing disk, a server that forgot the file: nothing says that there is none.
TEST_F(ZarrSourceTest, AChunkWhoseOpeningFailsIsNoMissingChunk) {
  for (const auto& [error, remedy] :
       {std::pair(EACCES, "change its permissions"), std::pair(EIO, "check the disk or its server"),
        std::pair(ESTALE, "check the disk or its server")}) {
    const FaultyOpen fault(chunk("1/0/2"), error);
    expectRefused(chunk("1/0/2"), std::strerror(error));
    expectRefused(chunk("1/0/2"), remedy);
  }
}

TEST_F(ZarrSourceTest, MetadataThatAreLinksToNowhereAreNotLeftOut) {
  linkToNowhere(store_ + "/.zattrs");  // it would be an array without a spacing
  expectRefused(store_ + "/.zattrs", "git annex get");
  linkToNowhere(chunk(".zarray"));
  EXPECT_CONTAINS(errorOf([&] { openVolume(store_ + "/0"); }), "git annex get");
}

TEST_F(ZarrSourceTest, AStoreThatGoesAwayIsNotAllFill) {
  const auto source = openVolume(store_);
  fs::remove_all(store_);
  EXPECT_CONTAINS(errorOf([&] { readAll(*source); }), store_);
}

// Chunks that the cache forgets are read again, and counted once.
TEST_F(ZarrSourceTest, SaysHowManyOfTheChunksWereMissing) {
  fs::remove(chunk("1/0/2"));
  fs::remove_all(chunk("0/1"));
  const std::string note = "4 of the 12 chunks that were read are not in the store";
  OpenOptions options;
  options.memory_bytes = 1;
  const auto source = openVolume(store_, options);
  EXPECT_TRUE(source->notesOfReading().empty());
  const auto values = readVoxels<std::uint8_t>(*source, 1);
  EXPECT_EQ(std::count(values.begin(), values.end(), 0), 130 * 1 * 64 + 2 * 64 * 1);
  ASSERT_EQ(source->notesOfReading().size(), 1u);
  EXPECT_CONTAINS(source->notesOfReading()[0], note);
  EXPECT_CONTAINS(source->notesOfReading()[0], "fill value, 0");

  // A pyramid keeps it, and a view of the volume says it.
  buildPyramid(*openVolume(store_), pathOf("a.isb"), {});
  EXPECT_CONTAINS(Pyramid(pathOf("a.isb")).provenance(), note);
  const auto cut = makeCroppedSource(openVolume(store_), {Index3(0), Index3(64, 65, 64)});
  readAll(*cut);
  ASSERT_EQ(cut->notesOfReading().size(), 1u);
  EXPECT_CONTAINS(cut->notesOfReading()[0], "1 of the 2 chunks");
}

TEST_F(ZarrSourceTest, AStoreWithAllChunksNeedsNoNote) {
  const auto source = openVolume(store_);
  readAll(*source);
  EXPECT_TRUE(source->notesOfReading().empty());
}

// ---- relatives: slices and halves of pairs ------------------------------------------------------

TEST_F(ZarrSourceTest, ASliceThatIsALinkToNowhereIsNotLeftOut) {
  for (const char* ending : {"tif", "exr"}) {
    const std::string folder = pathOf(ending);
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<std::uint8_t>>(
        Index3(9, 8, 7), std::vector<std::uint8_t>(9 * 8 * 7, 1)));
    exportVolume(levels, folder + "/%d." + ending, {});
    const std::string last = folder + "/6." + ending;
    linkToNowhere(last);
    const std::string message = errorOf([&] { readAll(*openVolume(folder)); });
    EXPECT_CONTAINS(message, last);
    EXPECT_CONTAINS(message, "git annex get");
    fs::remove(last);
    linkToNowhere(folder + "/.#lock");  // of an editor
    readAll(*openVolume(folder));
  }
}

// Each chunk is a voxel, and all are missing.
TEST_F(ZarrSourceTest, AChunkOfMoreThanAGibibyteIsRefusedBeforeItIsRead) {
  fs::create_directory(pathOf("large.zarr"));
  for (const auto& [last, is_refused] : {std::pair{"1024", false}, {"1025", true}}) {
    write("large.zarr/.zarray",
          std::string(R"({"zarr_format": 2, "shape": [9, 9, 9], "chunks": [1024, 1024, )") + last +
              R"(], "dtype": "|u1", "compressor": null, "fill_value": 7, "order": "C",
                 "filters": null})");
    const auto open = [&] { openVolume(pathOf("large.zarr")); };
    if (is_refused)
      EXPECT_CONTAINS(errorOf(open), "1 GiB");
    else
      EXPECT_NO_THROW(open());
  }
}

TEST_F(ZarrSourceTest, TinyChunksAreNotAllListedAhead) {
  constexpr std::int64_t kEdge = 400;
  fs::create_directory(pathOf("tiny.zarr"));
  write("tiny.zarr/.zarray",
        R"({"zarr_format": 2, "shape": [400, 400, 400], "chunks": [1, 1, 1], "dtype": "|u1",
            "compressor": null, "fill_value": 7, "order": "C", "filters": null})");
  const RangeServer server(folder_.string());
  const auto source = openVolume(server.url("good/tiny.zarr"));
  struct rusage before = {}, after = {};
  getrusage(RUSAGE_SELF, &before);
  source->announce(std::vector{IndexBox{Index3(0), Index3(kEdge)}, {Index3(1), Index3(kEdge - 1)}});
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 64 * 1024) << "KiB";
  std::uint8_t last = 0;
  source->readBox({Index3(kEdge - 1), Index3(1)}, &last);
  EXPECT_EQ(last, 7);
}

}  // namespace
}  // namespace isobrick
