// The identity of a build's input: every file, all of a phantom's parameters, whole reads.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>

#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/file_bytes.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/tiff_file.h"
#include "tests/support/volume_files.h"

namespace {

// The behaviour of every pread() of this program: no file system gives short reads when asked.
struct ReadFault {
  std::atomic<std::size_t> most_bytes = SIZE_MAX;  // a call
  std::atomic<off_t> file_end = 0;                 // of the watched file, if not 0
  std::atomic<bool> fails = false;                 // in the watched file
  std::atomic<ino_t> watched = 0;
  std::atomic<int> reads_at_zero = 0;  // in the watched file
} fault;

}  // namespace

// Takes the place of the C library's.
extern "C" ssize_t pread(int fd, void* out, std::size_t bytes, off_t at) {
  struct stat status = {};
  if (fault.watched != 0 && fstat(fd, &status) == 0 && status.st_ino == fault.watched) {
    if (at == 0) ++fault.reads_at_zero;
    if (fault.fails) {
      errno = EIO;
      return -1;
    }
    if (fault.file_end > 0)
      bytes = std::min(bytes, static_cast<std::size_t>(std::max<off_t>(0, fault.file_end - at)));
    bytes = std::min(bytes, fault.most_bytes.load());
  }
  return syscall(SYS_pread64, fd, out, bytes, at);
}

namespace isobrick::test {
namespace {

class ReadFaultScope {
 public:
  explicit ReadFaultScope(const std::string& path) {
    struct stat status = {};
    EXPECT_EQ(stat(path.c_str(), &status), 0) << path;
    fault.reads_at_zero = 0;
    fault.watched = status.st_ino;
  }
  ~ReadFaultScope() {
    fault.watched = 0;
    fault.most_bytes = SIZE_MAX;
    fault.file_end = 0;
    fault.fails = false;
  }
  ReadFaultScope(const ReadFaultScope&) = delete;
  ReadFaultScope& operator=(const ReadFaultScope&) = delete;
};

class InputIdentityTest : public VolumeFilesTest {
 protected:
  static constexpr std::int64_t kSlices = 3;
  static constexpr std::size_t kSliceBytes = 4 * 5 * 2;

  static std::string voxels(std::int64_t slices = kSlices) {
    std::string bytes(static_cast<std::size_t>(slices) * kSliceBytes, '\0');
    for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * 7);
    return bytes;
  }
  // "name1", "name2", ...: a slice each.
  void writeSlices(const std::string& before, const std::string& after, int first = 1) const {
    for (int k = 0; k < kSlices; ++k)
      write(before + std::to_string(first + k) + after,
            voxels().substr(static_cast<std::size_t>(k) * kSliceBytes, kSliceBytes));
  }
  static std::string nrrd(const std::string& data_file, const std::string& encoding = "raw") {
    return "NRRD0004\ntype: int16\ndimension: 3\nsizes: 4 5 3\nendian: big\nencoding: " + encoding +
           "\ndata file: " + data_file + "\n";
  }
  static std::string metaImage(const std::string& data_file) {
    return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = True\n"
           "DimSize = 4 5 3\nElementSpacing = 1 1 1\nElementType = MET_SHORT\nElementDataFile = " +
           data_file + "\n";
  }
  std::vector<std::string> paths(const std::vector<std::string>& names) const {
    std::vector<std::string> all;
    for (const std::string& name : names) all.push_back(pathOf(name));
    return all;
  }
  // Writes the file as it is now but for one byte, and gives it its time back.
  static void changeQuietly(const std::string& path, std::size_t at) {
    const auto time = fs::last_write_time(path);
    std::string bytes = readBytes(path);
    ASSERT_LT(at, bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ 1);
    std::ofstream(path, std::ios::binary) << bytes;
    fs::last_write_time(path, time);
  }
  static std::string identityOf(const std::string& path) {
    return buildIdentity(*openVolume(path), {});
  }
  // The source names just these files, reads their voxels, and a change in any of them shows.
  void checkFiles(const std::string& header, const std::vector<std::string>& names) {
    SCOPED_TRACE(header);
    const auto source = openVolume(pathOf(header));
    EXPECT_EQ(source->files(), paths(names));
    const auto read = readVoxels<std::int16_t>(*source);
    EXPECT_EQ(bytesOfValues(read, true), voxels());
    const std::string before = buildIdentity(*source, {});
    EXPECT_EQ(buildIdentity(*source, {}), before);
    for (const std::string& name : names) {
      const std::string bytes = readBytes(pathOf(name));
      const auto time = fs::last_write_time(pathOf(name));
      changeQuietly(pathOf(name), bytes.size() - 1);
      EXPECT_NE(buildIdentity(*source, {}), before) << name;
      write(name, bytes);
      fs::last_write_time(pathOf(name), time);
      EXPECT_EQ(buildIdentity(*source, {}), before) << name;
    }
  }
};

TEST_F(InputIdentityTest, DetachedNrrdNamesHeaderAndData) {
  write("a.raw", voxels());
  write("a.nhdr", nrrd("a.raw"));
  checkFiles("a.nhdr", {"a.nhdr", "a.raw"});
  write("a.raw.gz", deflated(voxels(), true));
  write("packed.nhdr", nrrd("a.raw.gz", "gzip"));
  checkFiles("packed.nhdr", {"packed.nhdr", "a.raw.gz"});
  const std::string text =
      "NRRD0004\ntype: int16\ndimension: 3\nsizes: 4 5 3\nendian: big\n"
      "encoding: raw\n\n";
  write("one.nrrd", text + voxels());
  checkFiles("one.nrrd", {"one.nrrd"});
}

TEST_F(InputIdentityTest, NrrdOfSeveralFilesNamesThemAll) {
  writeSlices("s", ".raw");
  write("list.nhdr", nrrd("LIST\ns1.raw\ns2.raw\ns3.raw"));
  checkFiles("list.nhdr", {"list.nhdr", "s1.raw", "s2.raw", "s3.raw"});
  writeSlices("p00", ".raw", 4);
  write("pattern.nhdr", nrrd("p%03d.raw 4 6 1"));
  checkFiles("pattern.nhdr", {"pattern.nhdr", "p004.raw", "p005.raw", "p006.raw"});
  write("back.nhdr", nrrd("b%d.raw 9 5 -2"));
  for (int k = 0; k < kSlices; ++k)
    fs::copy_file(pathOf("s" + std::to_string(k + 1) + ".raw"),
                  pathOf("b" + std::to_string(9 - 2 * k) + ".raw"));
  checkFiles("back.nhdr", {"back.nhdr", "b9.raw", "b7.raw", "b5.raw"});
}

TEST_F(InputIdentityTest, NrrdThatOnlyItkReadsNamesItsData) {
  std::string text;
  const std::string bytes = voxels();
  for (std::size_t i = 0; i < bytes.size(); i += 2)
    text += std::to_string(static_cast<std::int16_t>(static_cast<unsigned char>(bytes[i]) << 8 |
                                                     static_cast<unsigned char>(bytes[i + 1]))) +
            "\n";
  write("a.txt", text);
  write("a.nhdr", nrrd("a.txt", "text"));
  const auto source = openVolume(pathOf("a.nhdr"));
  EXPECT_EQ(source->files(), paths({"a.nhdr", "a.txt"}));
  EXPECT_EQ(bytesOfValues(readVoxels<std::int16_t>(*source), true), voxels());
}

TEST_F(InputIdentityTest, MetaImageNamesHeaderAndData) {
  write("a.raw", voxels());
  write("a.mhd", metaImage("a.raw"));
  checkFiles("a.mhd", {"a.mhd", "a.raw"});
  write("one.mha", metaImage("LOCAL") + voxels());
  checkFiles("one.mha", {"one.mha"});
  writeSlices("s", ".raw");
  write("list.mhd", metaImage("LIST\ns1.raw\ns2.raw\ns3.raw"));
  checkFiles("list.mhd", {"list.mhd", "s1.raw", "s2.raw", "s3.raw"});
  writeSlices("p00", ".raw", 4);
  write("pattern.mhd", metaImage("p%03d.raw 4 6 1"));
  checkFiles("pattern.mhd", {"pattern.mhd", "p004.raw", "p005.raw", "p006.raw"});
  write("short.mhd", metaImage("s%d.raw"));
  checkFiles("short.mhd", {"short.mhd", "s1.raw", "s2.raw", "s3.raw"});
}

// Numbers without end in a header are no reason to fill the memory with names.
TEST_F(InputIdentityTest, HostilePatternsAreErrorsOrHarmless) {
  writeSlices("s", ".raw");
  for (const char* name : {"s%d.raw 1 2000000000 1", "s%d.raw 1 3 0", "s%s.raw 1 3 1",
                           "s%n.raw 1 3 1", "s%999999999d.raw 1 3 1", "s%d%d.raw 1 3 1", "%",
                           "s%d.raw -2147483648 2147483647 1", "s%d.raw 99999999999999999999 1 1"})
    for (const bool is_nrrd : {true, false}) {
      const std::string header = is_nrrd ? "h.nhdr" : "h.mhd";
      write(header, is_nrrd ? nrrd(name) : metaImage(name));
      try {
        const auto source = openVolume(pathOf(header));
        EXPECT_LE(source->files().size(), 5u) << name;
        buildIdentity(*source, {});
      } catch (const Error&) {
      }
    }
}

// The story of the stale pyramid: the voxels are the same bytes, and mean other numbers.
TEST_F(InputIdentityTest, AnotherByteOrderInTheHeaderIsAnotherInput) {
  write("a.raw", voxels());
  const std::string big = nrrd("a.raw");
  const std::string path = write("a.nhdr", big);
  const std::string before = identityOf(path);
  std::string little = big;
  little.replace(little.find("big"), 3, "little");
  write("a.nhdr", little);
  EXPECT_NE(identityOf(path), before);
}

TEST_F(InputIdentityTest, ASliceMoreOrLessIsAChange) {
  const auto tiff = [](int k) { return tiffBytes(2, 2, 8, std::string(4, static_cast<char>(k))); };
  fs::create_directory(pathOf("stack"));
  for (const int k : {1, 2, 3}) write("stack/s" + std::to_string(k) + ".tif", tiff(k));
  const std::string three = identityOf(pathOf("stack"));
  write("stack/s4.tif", tiff(4));
  const auto four = openVolume(pathOf("stack"));
  EXPECT_EQ(four->files(), paths({"stack/s1.tif", "stack/s2.tif", "stack/s3.tif", "stack/s4.tif"}));
  EXPECT_NE(buildIdentity(*four, {}), three);
  fs::remove(pathOf("stack/s4.tif"));
  EXPECT_EQ(identityOf(pathOf("stack")), three);
  fs::remove(pathOf("stack/s3.tif"));
  EXPECT_NE(identityOf(pathOf("stack")), three);
}

TEST_F(InputIdentityTest, PhantomsOfOtherParametersAreNotTheSame) {
  std::vector<std::string> identities;
  const auto add = [&](const char* name, std::int64_t size, std::optional<VoxelType> type,
                       double period) {
    identities.push_back(buildIdentity(*makePhantomSource({name, size, type, period}), {}));
    // The line of the input alone says it.
    identities.back().resize(identities.back().find('\n'));
  };
  add("gyroid", 32, {}, 16);
  add("gyroid", 32, {}, 16.000000001);
  add("gyroid", 33, {}, 16);
  add("gyroid", 32, VoxelType::kUint16, 16);
  add("sphere", 32, {}, 16);
  std::vector<std::string> sorted = identities;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(std::unique(sorted.begin(), sorted.end()), sorted.end()) << identities[0];
  add("gyroid", 32, VoxelType::kUint8, 16);  // what a gyroid is without being told
  EXPECT_EQ(identities.back(), identities.front());
}

TEST_F(InputIdentityTest, AnotherVersionOfTheToolIsNoOtherBuild) {
  const auto source = makePhantomSource({"sphere", 16, {}, 16});
  BuildOptions one, two;
  one.tool_version = "1.2.3";
  two.tool_version = "1.2.4";
  EXPECT_EQ(buildIdentity(*source, one), buildIdentity(*source, two));
  EXPECT_NE(buildIdentity(*source, one).find("\nalgorithm="), std::string::npos);
}

TEST_F(InputIdentityTest, ShortReadsAreReadOn) {
  std::string bytes(300'000, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * i >> 7);
  const std::string path = write("a.raw", bytes);
  const auto source = openRawSource(path, {{100, 100, 30}, "u8", false, 0});
  const std::string whole = buildIdentity(*source, {});
  const ReadFaultScope scope(path);
  fault.most_bytes = 1000;
  EXPECT_EQ(buildIdentity(*source, {}), whole);
  EXPECT_GT(fault.reads_at_zero, 0);
}

TEST_F(InputIdentityTest, AFileThatEndsEarlyIsAnError) {
  const std::string path = write("a.raw", std::string(300'000, 'v'));
  const auto source = openRawSource(path, {{100, 100, 30}, "u8", false, 0});
  const ReadFaultScope scope(path);
  fault.file_end = 299'999;
  const std::string message = errorOf([&] { buildIdentity(*source, {}); });
  EXPECT_CONTAINS(message, path);
  EXPECT_CONTAINS(message, "299999");
}

TEST_F(InputIdentityTest, ABuildSamplesItsInputTwice) {
  // A file that is read by the sampling only.
  class NamedSource final : public ArraySource<std::uint8_t> {
   public:
    NamedSource(std::string path)
        : ArraySource({10, 10, 10}, std::vector<std::uint8_t>(1000)), path_(std::move(path)) {}
    std::vector<std::string> files() const override { return {path_}; }

   private:
    std::string path_;
  };
  NamedSource source(write("named", std::string(5000, 'v')));
  const ReadFaultScope scope(pathOf("named"));
  // The sampling's reads of the first bytes, the block at the end of a small file among them.
  buildIdentity(source, {});
  const int reads_of_one_sample = fault.reads_at_zero;
  ASSERT_GT(reads_of_one_sample, 0);
  fault.reads_at_zero = 0;
  buildPyramid(source, pathOf("a.isb"), {});
  EXPECT_EQ(fault.reads_at_zero, 2 * reads_of_one_sample);
}

// The temporary files are emptied and removed: a header is as precious as its voxels.
TEST_F(InputIdentityTest, AHeaderIsNotTakenForATemporary) {
  write("a.raw", voxels());
  for (const char* name : {"a.isb", "a.isb.partial", "a.isb.partial.journal"}) {
    const std::string header = write(name, nrrd("a.raw"));
    fs::create_symlink(header, pathOf("a.nhdr"));
    const auto source = openVolume(pathOf("a.nhdr"));
    const std::string message = messageOfBuild(*source, pathOf("a.isb"), {});
    EXPECT_CONTAINS(message, "is an input");
    EXPECT_EQ(readBytes(header), nrrd("a.raw"));
    fs::remove(pathOf("a.nhdr"));
    fs::remove(header);
  }
}

}  // namespace
}  // namespace isobrick::test
