// Words as users write them: old names of options, and mistyped ones.
#pragma once

#include <string>
#include <vector>

namespace isobrick {

// The words of a command line, argv[0] among them, with today's names in place of the old ones,
// which a warning names.
std::vector<std::string> todaysWords(int argc, char** argv);

// The words with the values of variables in place of "env:NAME": for URLs that are secrets, since
// `ps` shows the words of a process to everybody. Throws Error if there is no such variable.
std::vector<std::string> withVariables(std::vector<std::string> words);

// The message with "env:NAME" in place of the values that withVariables() put there: `words`
// before, and `values` after it.
std::string withoutValues(const std::string& message, const std::vector<std::string>& words,
                          const std::vector<std::string>& values);

// "; did you mean 'focus'?" for "focsu": the nearest of the words, or nothing if none is near.
std::string guessOf(const std::string& word, const std::vector<std::string>& known);

}  // namespace isobrick
