// A target for libFuzzer: ISOBRICK_FUZZ names it; "list" lists all, a line each.
#include <tbb/global_control.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>

#include "isobrick/storage/error.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hostile_pyramid.h"

// NOLINTBEGIN: libFuzzer's names
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t bytes, std::size_t most);

namespace isobrick::test {
namespace {

constexpr double kMostSeconds = 2;  // of the processor, as sanitizers slow it down

std::optional<FuzzTarget> chosen;

double cpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

void choose() {
  const char* const name = std::getenv("ISOBRICK_FUZZ");
  for (const FuzzTarget& target : ISOBRICK_FUZZ_TARGETS) {
    if (name != nullptr && name == target.name) chosen = target;
    if (name != nullptr && name == std::string("list"))
      std::printf("%s %s %s\n", std::string(target.group).c_str(), std::string(target.name).c_str(),
                  std::string(target.covers).c_str());
  }
  if (chosen) return;
  std::fputs(name == nullptr ? "ISOBRICK_FUZZ names no target\n" : "", stderr);
  std::exit(name != nullptr && name == std::string("list") ? 0 : 2);
}

std::string mutated(std::string bytes, std::size_t most) {
  const std::size_t before = bytes.size();
  bytes.resize(std::max(most, before));
  bytes.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(bytes.data()), before, most));
  return bytes;
}

// A pyramid that lies in one of twenty ways, made from a good one.
std::string hostilePyramid(Random& random) {
  constexpr const char* kNames[] = {"u8-zstd", "i16-lz4", "around-f32-zstd", "errors-i8-none"};
  const std::string good =
      readBytes(std::string(ISOBRICK_FUZZ_CORPUS "/isb/") + kNames[random() % 4]);
  std::string what;
  const Bytes bytes = makeHostilePyramid({good.begin(), good.end()}, random, what);
  return {bytes.begin(), bytes.end()};
}

// One of the files, whose stated length is mended most times: everything else is refused there.
std::string mutatedTables(FuzzBytes bytes, std::size_t most, std::uint64_t seed) {
  constexpr std::size_t kLengthAt = 16;
  Random random(seed);
  std::vector<FuzzFile> files = filesOf(bytes);
  if (chosen->name == "isb" && random() % 16 == 0) return hostilePyramid(random);
  FuzzFile& file = files[random() % files.size()];
  file.bytes = random() % 3 == 0 ? withNastyNumber(file.bytes, random())
                                 : mutated(file.bytes, most - (bytes.size() - file.bytes.size()));
  const std::uint64_t length = file.bytes.size();
  if (length >= kLengthAt + 8 && random() % 8 != 0)
    std::memcpy(file.bytes.data() + kLengthAt, &length, 8);
  return bytesOf(files);
}

}  // namespace
}  // namespace isobrick::test

using namespace isobrick::test;

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  choose();
  // One thread: the same input takes the same way again.
  static const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t bytes) {
  const double begin = cpuSeconds();
  std::string what;
  if (!isHandled(*chosen, {data, bytes}, what)) {
    std::fprintf(stderr, "thrown: %s\n", what.c_str());
    std::abort();
  }
  demand(cpuSeconds() - begin < kMostSeconds, "an input takes less than 2 s");
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t bytes,
                                               std::size_t most, unsigned seed) {
  if (!chosen->has_tables) return LLVMFuzzerMutate(data, bytes, most);
  const std::string made = mutatedTables({data, bytes}, most, seed);
  if (made.size() > most) return bytes;
  std::copy(made.begin(), made.end(), data);
  return made.size();
}
// NOLINTEND
