#include "tests/fuzz/fuzz_target.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>

#include "isobrick/storage/error.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

constexpr std::string_view kMark = "%% ";
constexpr std::size_t kMostFiles = 12;

bool isHarmless(const std::string& name) {
  constexpr char kAllowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-/";
  return !name.empty() && name.size() < 60 && name.front() != '/' && name.back() != '/' &&
         name.find("..") == std::string::npos && name.find("//") == std::string::npos &&
         name.find_first_not_of(kAllowed) == std::string::npos;
}

}  // namespace

bool isHandled(const FuzzTarget& target, FuzzBytes bytes, std::string& what) try {
  target.run(bytes);
  return true;
} catch (const Error&) {
  return true;
} catch (const std::exception& exception) {
  what = exception.what();
  return false;
}

void demand(bool is_kept, const char* promise) {
  if (is_kept) return;
  std::fprintf(stderr, "not kept: %s\n", promise);
  std::abort();
}

std::vector<FuzzFile> filesOf(FuzzBytes bytes) {
  std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (!text.starts_with(kMark)) return {{"", std::string(text)}};
  std::vector<FuzzFile> files;
  while (!text.empty()) {
    text.remove_prefix(kMark.size());
    const std::size_t line = std::min(text.find('\n'), text.size());
    std::string name(text.substr(0, line));
    text.remove_prefix(std::min(line + 1, text.size()));
    const std::size_t end = text.starts_with(kMark) ? 0 : text.find("\n%% ");
    files.push_back({std::move(name), std::string(text.substr(0, end))});
    if (end == std::string_view::npos) break;
    text.remove_prefix(end == 0 ? 0 : end + 1);
  }
  return files;
}

std::string bytesOf(const std::vector<FuzzFile>& files) {
  if (files.size() == 1 && files.front().name.empty()) return files.front().bytes;
  std::string bytes;
  for (const FuzzFile& file : files)
    bytes += (bytes.empty() ? "" : "\n") + std::string(kMark) + file.name + "\n" + file.bytes;
  return bytes;
}

FuzzFolder::FuzzFolder(std::vector<FuzzFile> files, const std::string& name) {
  if (files.front().name.empty()) files.front().name = name;
  if (files.size() > kMostFiles) files.resize(kMostFiles);
  for (const FuzzFile& file : files) {
    if (!isHarmless(file.name)) continue;
    const std::filesystem::path path = folder_.file(file.name);
    std::error_code failed;  // a file of that name is there already
    std::filesystem::create_directories(path.parent_path(), failed);
    if (failed || std::filesystem::is_directory(path)) continue;
    writeBytes(path, file.bytes);
    files_.push_back(path);
  }
}

std::string withNastyNumber(std::string bytes, std::uint64_t random) {
  constexpr std::uint64_t kNumbers[] = {0,
                                        1,
                                        2,
                                        63,
                                        64,
                                        255,
                                        4096,
                                        0x7fffffff,
                                        0x80000000,
                                        0xffffffff,
                                        0x7fffffffffffffff,
                                        ~std::uint64_t{0},
                                        0x7ff8000000000000,
                                        0x7ff0000000000000,
                                        0x7f7fffff7f7fffff,
                                        0x3ff0000000000000};
  Random numbers(random);
  const bool is_wide = numbers() % 2 == 0;
  const std::size_t width = is_wide ? 8 : 4;
  if (bytes.size() < width) return bytes;
  // Half of them in the header.
  const std::uint64_t places = bytes.size() / width;
  const std::uint64_t some =
      numbers() % 2 == 0 ? std::min<std::uint64_t>(places, 512 / width) : places;
  std::uint64_t number = kNumbers[numbers() % std::size(kNumbers)];
  if (numbers() % 4 == 0) number = numbers() % bytes.size();  // a place
  std::memcpy(bytes.data() + width * randomBelow(numbers, some), &number, width);
  return bytes;
}

}  // namespace isobrick::test
