// Each file that a fuzzer's target begins with, and each that once was a finding.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/fuzz/fuzz_target.h"
#include "tests/support/file_bytes.h"

namespace isobrick::test {
namespace {

void runCorpus(std::span<const FuzzTarget> targets) {
  for (const FuzzTarget& target : targets) {
    std::size_t files = 0;
    const std::filesystem::path folder = std::filesystem::path(ISOBRICK_FUZZ_CORPUS) / target.name;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      const std::string bytes = readBytes(entry.path());
      std::string what;
      EXPECT_TRUE(isHandled(
          target, {reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, what))
          << entry.path() << ": " << what;
      ++files;
    }
    EXPECT_GT(files, 0u) << target.name;
  }
}

TEST(FuzzCorpus, EveryPyramidIsHandled) { runCorpus(kStorageTargets); }
TEST(FuzzCorpus, EveryVolumeIsHandled) { runCorpus(kSourceTargets); }
TEST(FuzzCorpus, EveryTextIsHandled) { runCorpus(kTextTargets); }

}  // namespace
}  // namespace isobrick::test
