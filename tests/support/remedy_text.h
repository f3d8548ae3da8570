// The message, place and remedies of an Error as one text that tests can search.
#pragma once

#include <string>

#include "isobrick/storage/error.h"

namespace isobrick::test {

// The message, and every remedy behind it in angle brackets: "... <resume>".
inline std::string textWithRemedies(const Error& error) {
  static constexpr const char* kNames[] = {"more memory",  "less memory",    "other folder",
                                           "pack",         "replace",        "resume",
                                           "begin anew",   "raw layout",     "correct raw layout",
                                           "dicom float",  "with curvature", "component",
                                           "whole floats", "pack mesh",      "stack",
                                           "time",         "variant",        "series",
                                           "image"};
  std::string text = error.what();
  for (const Remedy remedy : error.remedies())
    text += std::string(" <") + kNames[static_cast<int>(remedy)] + ">";
  return text;
}

}  // namespace isobrick::test
