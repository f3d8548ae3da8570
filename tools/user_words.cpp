#include "tools/user_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <optional>
#include <string_view>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// An option that has another name since version 0.3. The old names end with 0.4.
struct RenamedOption {
  std::string_view command, old, now;
  std::optional<std::string_view> drops = std::nullopt;  // the one value it had
};
constexpr RenamedOption kRenamed[] = {
    {"render", "--pictures", "--frames"},
    {"render", "--pictures-per-second", "--fps"},
    {"convert", "--levels", "--all-levels", "all"},
    {"view", "--frames", "--out-dir"},
};

std::size_t editsBetween(std::string_view a, std::string_view b) {
  std::vector<std::size_t> edits(b.size() + 1);
  std::iota(edits.begin(), edits.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = edits[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = edits[j + 1];
      edits[j + 1] = std::min({replaced, diagonal + 1, edits[j] + 1});
    }
  }
  return edits.back();
}

}  // namespace

std::vector<std::string> todaysWords(int argc, char** argv) {
  std::vector<std::string> words(argv, argv + argc);
  if (words.size() < 2) return words;
  const auto rename = [&](const RenamedOption& renamed) {
    for (std::size_t i = 2; i < words.size() && words[i] != "--"; ++i) {
      const std::string_view name = std::string_view(words[i]).substr(0, words[i].find('='));
      if (words[1] != renamed.command || name != renamed.old) continue;
      const bool has_value = name.size() < words[i].size();
      if (renamed.drops && (has_value              ? words[i].substr(name.size() + 1)
                            : i + 1 < words.size() ? words[i + 1]
                                                   : "") != *renamed.drops)
        continue;
      fmt::print(stderr, "isobrick: warning: {} is {} now; the old name ends with version 0.4\n",
                 renamed.old, renamed.now);
      words[i].replace(0, renamed.drops ? words[i].size() : name.size(), renamed.now);
      if (renamed.drops && !has_value)
        words.erase(words.begin() + static_cast<std::ptrdiff_t>(i) + 1);
    }
  };
  std::ranges::for_each(kRenamed, rename);
  if (const auto join = std::ranges::find(words, "--join");
      words[1] == "build" && join != words.end()) {
    fmt::print(
        stderr,
        "isobrick: warning: build --join is merge now; the old name ends with version 0.4\n");
    words.erase(join);
    words[1] = "merge";
  }
  return words;
}

std::vector<std::string> withVariables(std::vector<std::string> words) {
  constexpr std::string_view kPrefix = "env:";
  for (std::string& word : words) {
    if (!word.starts_with(kPrefix)) continue;
    const std::string name = word.substr(kPrefix.size());
    const char* const value = std::getenv(name.c_str());
    if (value == nullptr)
      throw Error(fmt::format("there is no variable '{}' of the environment; set it", name));
    word = value;
  }
  return words;
}

std::string withoutValues(const std::string& message, const std::vector<std::string>& words,
                          const std::vector<std::string>& values) {
  constexpr std::size_t kLeastLetters = 4;  // shorter ones are no secrets, and stand everywhere
  std::string result;
  for (std::size_t at = 0; at < message.size();) {
    std::size_t longest = 0, found = 0;
    for (std::size_t i = 0; i < words.size(); ++i)
      if (words[i] != values[i] && values[i].size() >= std::max(kLeastLetters, longest + 1) &&
          message.compare(at, values[i].size(), values[i]) == 0)
        longest = values[found = i].size();
    result += longest > 0 ? words[found] : message.substr(at, 1);
    at += std::max<std::size_t>(longest, 1);
  }
  return result;
}

std::string guessOf(const std::string& word, const std::vector<std::string>& known) {
  std::string nearest;
  std::size_t least = std::max<std::size_t>(1, word.size() / 3) + 1;
  for (const std::string& one : known)
    if (const std::size_t edits = editsBetween(word, one); edits < least) {
      least = edits;
      nearest = one;
    }
  return nearest.empty() ? nearest : fmt::format("; did you mean '{}'?", nearest);
}

}  // namespace isobrick
