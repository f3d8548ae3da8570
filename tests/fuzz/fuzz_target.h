// What is fuzzed: functions that take bytes of anybody, in groups. libFuzzer calls them
// (fuzz_main.cpp), and a test calls them with each file of corpus/ (corpus_test.cpp).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace isobrick::test {

using FuzzBytes = std::span<const std::uint8_t>;

struct FuzzTarget {
  std::string_view group, name;
  std::string_view covers;  // the sources that it is for, as a regular expression
  // Error is a refusal; whatever else is thrown is a finding.
  void (*run)(FuzzBytes bytes);
  // Its files are ".isb" or ".isbm", which have numbers at multiples of 4 and their own length.
  bool has_tables = false;
};

extern const std::span<const FuzzTarget> kStorageTargets, kSourceTargets, kTextTargets;

// Takes refusals; false if bytes made something else be thrown, which `what` gets.
bool isHandled(const FuzzTarget& target, FuzzBytes bytes, std::string& what);

// Ends the process if a promise of the library was not kept.
void demand(bool is_kept, const char* promise);

// Bytes that stand for several files: a line "%% NAME" and the content of each. Bytes that do not
// begin so are one file.
struct FuzzFile {
  std::string name;  // empty: it has none
  std::string bytes;
};
std::vector<FuzzFile> filesOf(FuzzBytes bytes);
std::string bytesOf(const std::vector<FuzzFile>& files);

// These files in a folder, as far as their names lead into it.
class FuzzFolder {
 public:
  // `name`: of the first file, if it has none.
  FuzzFolder(std::vector<FuzzFile> files, const std::string& name);
  const std::string& path() const { return folder_.path(); }
  // Of those that were written.
  const std::vector<std::string>& files() const { return files_; }

 private:
  const TemporaryFolder folder_;
  std::vector<std::string> files_;
};

// In files with tables: what mutations of single bytes seldom reach. `random` is a seed.
std::string withNastyNumber(std::string bytes, std::uint64_t random);

}  // namespace isobrick::test
