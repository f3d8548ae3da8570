// The files of a divided pyramid: no changed byte is believed, and behind HTTP they are read as one
// file is.
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <filesystem>
#include <utility>

#include "isobrick/extract/extractor.h"
#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/format.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/pyramid_verify.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/random_numbers.h"
#include "tests/support/range_server.h"
#include "tests/support/repetitions.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

VerifyOptions oneThread() {
  VerifyOptions options;
  options.threads = 1;
  return options;
}

class DividedFileTest : public testing::Test {
 protected:
  DividedFileTest() {
    const auto source = makePhantomSource(spec_);
    InputWatch input(*source);
    BuildOptions options;
    options.brick_cells = 8;
    options.super_cells = 16;
    std::filesystem::create_directory(pyramid_);
    for (std::size_t i = 0; i < superBrickFiles(source->info(), options).size(); ++i)
      buildSuperBrick(*source, input, pyramid_, i, options);
    joinPyramid(pyramid_, {});
    options.super_cells = 0;
    buildPyramid(*source, folder_.file("head.isb"), options);
  }
  std::string file(const std::string& name) const { return pyramid_ + "/" + name; }

  static std::uint64_t meshOf(const Pyramid& pyramid) {
    Query query;
    query.isovalue = 900;
    query.focus = FocusSphere{glm::dvec3(20), 8};
    HashingSink sink;
    extractIsosurface(pyramid, query, sink);
    return sink.value();
  }
  // Whether anything is found to be wrong.
  bool isFound() const {
    try {
      return !verifyPyramid(Pyramid(pyramid_), oneThread()).empty();
    } catch (const Error&) {
      return true;
    }
  }

  const TemporaryFolder folder_;
  const PhantomSpec spec_{"head", 40, {}, 16};
  const std::string pyramid_ = folder_.file("head.isbs");
};

TEST_F(DividedFileTest, NoChangedOrMissingByteIsBelieved) {
  ASSERT_FALSE(isFound());
  Random random(5);
  const int rounds = repetitions(500);
  for (const std::string& name : {std::string(kIndexName), std::string("1-0-1.isb")}) {
    const std::string good = readBytes(file(name));
    for (int round = 0; round < rounds; ++round) {
      const auto at = 5 * round < 2 * rounds ? randomBelow(random, sizeof(format::Header))
                                             : randomBelow(random, good.size());
      std::string bad = good;
      bad[at] = static_cast<char>(bad[at] ^ (1 << randomBelow(random, 8)));
      writeBytes(file(name), bad);
      EXPECT_TRUE(isFound()) << name << ", byte " << at;
    }
    for (int round = 0; round < 20; ++round) {
      writeBytes(file(name), good.substr(0, randomBelow(random, good.size())));
      EXPECT_TRUE(isFound()) << name;
    }
    writeBytes(file(name), good);
  }
  EXPECT_FALSE(isFound());
}

// Numbers that lie, with checksums that fit: an error, or a mesh; nothing else.
TEST_F(DividedFileTest, NoLieInTheIndexLeadsAstray) {
  const std::string good = readBytes(file(kIndexName));
  format::Header header{};
  std::memcpy(&header, good.data(), sizeof header);
  Random random(9);
  int refused = 0;
  for (int round = 0; round < 600; ++round) {
    std::string bad = good;
    const bool in_header = round % 3 == 0;
    const std::uint64_t begin =
        in_header ? offsetof(format::Header, super_cells) : header.division.offset;
    const std::uint64_t bytes = in_header ? 40 : header.division.stored_bytes;
    const std::uint64_t values[] = {
        0, 1, 0xff, 0x7fffffff, 0xffffffff, ~std::uint64_t{0} >> 1, ~std::uint64_t{0}, random()};
    const std::uint64_t value = values[randomBelow(random, std::size(values))];
    const std::uint64_t at = begin + randomBelow(random, bytes / 4) * 4;
    std::memcpy(bad.data() + at, &value, std::min<std::uint64_t>(8, begin + bytes - at));
    format::Header lying{};
    std::memcpy(&lying, bad.data(), sizeof lying);
    if (!in_header)
      lying.division.checksum =
          checksum64(bad.data() + header.division.offset, header.division.stored_bytes);
    lying.header_checksum = checksum64(&lying, offsetof(format::Header, header_checksum));
    std::memcpy(bad.data(), &lying, sizeof lying);
    writeBytes(file(kIndexName), bad);
    try {
      const Pyramid pyramid(pyramid_);
      meshOf(pyramid);
      verifyPyramid(pyramid, oneThread());
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 300);
}

// Lies in a super-brick's file, which the index is told of: nothing is asked of memory for them.
TEST_F(DividedFileTest, NoLieInASuperBrickTakesMemory) {
  const std::string name = "0-0-0.isb", good = readBytes(file(name)),
                    index = readBytes(file(kIndexName));
  const auto sealed = [](std::string bytes, const auto& edit) {
    format::Header header{};
    std::memcpy(&header, bytes.data(), sizeof header);
    edit(header, bytes);
    header.header_checksum = checksum64(&header, offsetof(format::Header, header_checksum));
    std::memcpy(bytes.data(), &header, sizeof header);
    return bytes;
  };
  const auto edits = std::to_array<void (*)(format::Header&)>(
      {[](format::Header& h) { h.provenance_bytes = std::uint64_t{1} << 40; },
       [](format::Header& h) { h.level_count = 0xffffffff; },
       [](format::Header& h) { h.division.stored_bytes = 0xffffffff; }});
  for (const auto edit : edits) {
    const std::string bad =
        sealed(good, [&](format::Header& header, std::string&) { edit(header); });
    format::Header header{};
    std::memcpy(&header, bad.data(), sizeof header);
    writeBytes(file(name), bad);
    writeBytes(file(kIndexName), sealed(index, [&](format::Header& of_index, std::string& bytes) {
                 format::FileEntry entries[2];
                 char* const at = bytes.data() + of_index.division.offset;
                 std::memcpy(entries, at, sizeof entries);
                 entries[0].header_checksum = header.header_checksum;
                 entries[1].file_bytes = std::uint64_t{1} << 51;
                 std::memcpy(at, entries, sizeof entries);
                 of_index.division.checksum = checksum64(at, of_index.division.stored_bytes);
               }));
    EXPECT_TRUE(isFound());
  }
}

// The ranges that a super-brick hands over to the join are held against its type and the other
// files.
TEST_F(DividedFileTest, TheJoinBelievesNoRange) {
  const std::string name = "0-0-0.isb", good = readBytes(file(name));
  for (const auto& [least, greatest] :
       {std::pair(-1.0f, 100.0f), {0.5f, 70000.0f}, {0.0f, 60000.0f}, {0.0f, 65536.0f}}) {
    std::string bad = good;
    format::Header header{};
    std::memcpy(&header, bad.data(), sizeof header);
    const float range[] = {least, greatest};
    // Behind the count and the codec, and the count of these two.
    std::memcpy(bad.data() + header.division.offset + 20, range, sizeof range);
    header.division.checksum =
        checksum64(bad.data() + header.division.offset, header.division.stored_bytes);
    header.header_checksum = checksum64(&header, offsetof(format::Header, header_checksum));
    std::memcpy(bad.data(), &header, sizeof header);
    writeBytes(file(name), bad);
    const std::string index = readBytes(file(kIndexName));
    EXPECT_THROW(joinPyramid(pyramid_, {}), Error) << least << " " << greatest;
    EXPECT_TRUE(readBytes(file(kIndexName)) == index);
  }
}

TEST_F(DividedFileTest, BehindAUrlItIsReadAsOneFileIs) {
  const RangeServer server(folder_.path());
  const RemoteOptions remote{.cache_folder = {}, .stall_seconds = 2, .tries = 2};
  const std::uint64_t whole = meshOf(Pyramid(folder_.file("head.isb")));
  EXPECT_EQ(meshOf(Pyramid(pyramid_)), whole);
  for (const char* const name : {"good/head.isbs", "good/head.isbs/", "good/head.isbs/index.isb"}) {
    const Pyramid pyramid(server.url(name), 1 << 20, FileAccess::kMap, remote);
    EXPECT_EQ(meshOf(pyramid), whole);
    EXPECT_GT(pyramid.remoteCounters().requests, 3u);
  }
  const Pyramid pyramid(server.url("good/head.isbs"), 1 << 20, FileAccess::kMap, remote);
  EXPECT_TRUE(verifyPyramid(pyramid).empty());
  // With parts on disk: the second time they come from there.
  const RemoteOptions kept{.cache_folder = folder_.file("cache"), .stall_seconds = 2, .tries = 2};
  for (int time = 0; time < 2; ++time) {
    const Pyramid cached(server.url("good/head.isbs"), 1 << 20, FileAccess::kMap, kept);
    EXPECT_EQ(meshOf(cached), whole);
    EXPECT_EQ(cached.remoteCounters().cached_parts > 0, time == 1);
  }
  std::filesystem::remove(file("1-1-1.isb"));
  const Pyramid lost(server.url("good/head.isbs"), 1 << 20, FileAccess::kMap, remote);
  try {
    meshOf(lost);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("head.isbs/1-1-1.isb"), std::string::npos)
        << error.what();
  }
}

TEST(PyramidFile, NamesOfFilesOfADividedOne) {
  EXPECT_EQ(besidePath("a/b/index.isb", "0-0-0.isb"), "a/b/0-0-0.isb");
  EXPECT_EQ(besidePath("index.isb", "0-0-0.isb"), "0-0-0.isb");
  EXPECT_EQ(besidePath("https://u:p@h/b/index.isb?s=1/2", "x.isb"), "https://u:p@h/b/x.isb?s=1/2");
  EXPECT_EQ(besidePath("s3://bucket/a?b/index.isb", "x.isb"), "s3://bucket/a?b/x.isb");
  EXPECT_EQ(pyramidFileOf("https://h/a.isbs?s=1"), "https://h/a.isbs/index.isb?s=1");
  for (const char* const store :
       {"https://h/a.ome.zarr", "s3://b/a.zarr/0", "http://h/A.ZARR/", "https://h/image/",
        "https://h/a.zarr?s=1", "gs://b/a.zarr", "https://h/a.ozx", "s3://b/a.zarr.zip/0"})
    EXPECT_TRUE(isRemoteVolume(store) && !isPyramidFile(store)) << store;
  for (const char* const pyramid : {"https://h/a.isb", "https://h/a.isbs/", "s3://b/a.zarr/a.isb",
                                    "https://h/download?id=a.zarr"})
    EXPECT_TRUE(!isRemoteVolume(pyramid) && isPyramidFile(pyramid)) << pyramid;
  EXPECT_FALSE(isRemoteVolume("a.zarr"));
  EXPECT_EQ(pyramidFileOf("s3://b/a.isbs/"), "s3://b/a.isbs/index.isb");
  EXPECT_EQ(pyramidFileOf("https://h/a.isb"), "https://h/a.isb");
  EXPECT_EQ(pyramidFileOf("nothing.isbs"), "nothing.isbs");
}

}  // namespace
}  // namespace isobrick::test
