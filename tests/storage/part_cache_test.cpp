// Parts on disk: found again, never believed unchecked, bounded, shared by processes.
#include "isobrick/storage/part_cache.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMost = 1'600'000;

class PartCacheTest : public testing::Test {
 protected:
  static std::string part(unsigned number, std::size_t bytes = 10'000) {
    std::string text(bytes, static_cast<char>('a' + number % 26));
    return text.replace(0, 8, std::to_string(10'000'000 + number));
  }
  static std::uint64_t hashOf(const std::string& text) {
    return checksum64(text.data(), text.size());
  }
  static void write(PartCache& cache, const std::string& text) {
    cache.write(hashOf(text), text.size(), reinterpret_cast<const std::byte*>(text.data()));
  }
  static bool has(PartCache& cache, const std::string& text) {
    std::string out(text.size(), '\0');
    return cache.read(hashOf(text), text.size(), reinterpret_cast<std::byte*>(out.data())) &&
           out == text;
  }
  std::vector<fs::path> partFiles() const {
    std::vector<fs::path> paths;
    for (const auto& entry : fs::recursive_directory_iterator(folder_.path()))
      if (entry.is_regular_file() && entry.path().filename() != "lock")
        paths.push_back(entry.path());
    return paths;
  }

  const TemporaryFolder folder_;
};

TEST_F(PartCacheTest, FindsAPartAgainInAnotherProcessOfTheSameFile) {
  {
    PartCache cache(folder_.path(), kMost, "file");
    EXPECT_FALSE(has(cache, part(1)));
    write(cache, part(1));
    EXPECT_TRUE(has(cache, part(1)));
  }
  PartCache again(folder_.path(), kMost, "file");
  EXPECT_TRUE(has(again, part(1)));
  PartCache other(folder_.path(), kMost, "another edition");
  EXPECT_FALSE(has(other, part(1)));
  EXPECT_EQ(keptParts(folder_.path()).count, 1u);
  EXPECT_EQ(keptParts(folder_.path()).bytes, 10'000u);
}

TEST_F(PartCacheTest, ADamagedPartIsNotBelievedAndGoes) {
  PartCache cache(folder_.path(), kMost, "file");
  for (const char* const damage : {"flip", "cut", "longer", "empty"}) {
    write(cache, part(1));
    ASSERT_EQ(partFiles().size(), 1u);
    const fs::path path = partFiles()[0];
    std::string bytes = readBytes(path);
    if (damage == std::string("flip")) bytes[5000] = static_cast<char>(bytes[5000] ^ 1);
    if (damage == std::string("cut")) bytes.resize(9'999);
    if (damage == std::string("empty")) bytes.clear();
    if (damage == std::string("longer")) continue;  // what is behind it is not read
    writeBytes(path, bytes);
    EXPECT_FALSE(has(cache, part(1))) << damage;
    EXPECT_TRUE(partFiles().empty()) << damage;
  }
}

TEST_F(PartCacheTest, ALinkOrAFolderInPlaceOfAPartIsNotRead) {
  PartCache cache(folder_.path(), kMost, "file");
  write(cache, part(1));
  const fs::path path = partFiles()[0];
  writeBytes(folder_.file("elsewhere"), part(1));
  fs::remove(path);
  fs::create_symlink(folder_.file("elsewhere"), path);
  EXPECT_FALSE(has(cache, part(1)));
  fs::remove(path);
  fs::create_directory(path);
  EXPECT_FALSE(has(cache, part(1)));
}

TEST_F(PartCacheTest, TheLeastRecentlyUsedGoBeyondTheBound) {
  PartCache cache(folder_.path(), kMost, "file");
  for (unsigned i = 0; i < 400; ++i) {
    write(cache, part(i));
    EXPECT_TRUE(has(cache, part(0))) << i;  // and so it is used
    EXPECT_LE(keptParts(folder_.path()).bytes, kMost);
  }
  EXPECT_GE(keptParts(folder_.path()).bytes, kMost * 3 / 4);
  EXPECT_TRUE(has(cache, part(399)));
  EXPECT_FALSE(has(cache, part(1)));
}

TEST_F(PartCacheTest, APartThatIsLongBesideTheBoundIsNotKept) {
  PartCache cache(folder_.path(), kMost, "file");
  write(cache, part(1, kMost / 16 + 1));
  EXPECT_TRUE(partFiles().empty());
}

TEST_F(PartCacheTest, WhatAKilledProcessLeftGoesInTheEnd) {
  PartCache cache(folder_.path(), kMost, "file");
  write(cache, part(1));
  const fs::path left = partFiles()[0].parent_path() / "tmp-1-1";
  writeBytes(left, "left");
  fs::last_write_time(left, fs::file_time_type::clock::now() - std::chrono::hours(2));
  trimParts(folder_.path(), 10'000);
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(has(cache, part(1)));
  EXPECT_EQ(trimParts(folder_.path(), 0).count, 1u);
  EXPECT_EQ(keptParts(folder_.path()).count, 0u);
}

TEST_F(PartCacheTest, AFolderThatCannotBeMadeIsSaid) {
  writeBytes(folder_.file("file"), "x");
  EXPECT_THROW(PartCache(folder_.file("file"), kMost, "file"), Error);
}

TEST_F(PartCacheTest, AFullDiskCostsThePartAlone) {
  PartCache cache(folder_.path(), kMost, "file");
  fs::remove_all(folder_.path() + "/parts");
  write(cache, part(1));
  EXPECT_FALSE(has(cache, part(1)));
}

// Each writes and reads the same parts and removes others' all the while.
TEST_F(PartCacheTest, ProcessesShareTheFolder) {
  std::vector<pid_t> children;
  for (unsigned p = 0; p < 4; ++p) {
    const pid_t child = fork();
    if (child == 0) {
      bool is_right = true;
      PartCache cache(folder_.path(), kMost / 4, "file");
      for (unsigned i = 0; i < 600; ++i) {
        const std::string text = part((i * (p + 1)) % 97);
        std::string out(text.size(), '\0');
        if (cache.read(hashOf(text), text.size(), reinterpret_cast<std::byte*>(out.data())))
          is_right = is_right && out == text;
        else
          write(cache, text);
      }
      _exit(is_right ? 0 : 1);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = 0;
    waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  }
  for (const fs::path& path : partFiles())
    EXPECT_EQ(path.filename().string().rfind("tmp-", 0), std::string::npos) << path;
  // Each may exceed the bound by a sixteenth.
  EXPECT_LE(keptParts(folder_.path()).bytes, kMost / 4 * 20 / 16);
}

}  // namespace
}  // namespace isobrick::test
