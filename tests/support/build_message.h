// The message of a build that is refused.
#pragma once

#include <string>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"
#include "tests/support/remedy_text.h"

namespace isobrick::test {

// Builds `path`; the message and remedies of the Error that this throws, or "" if it throws
// none.
inline std::string messageOfBuild(VolumeSource& source, const std::string& path,
                                  const BuildOptions& options) {
  try {
    buildPyramid(source, path, options);
  } catch (const Error& error) {
    return textWithRemedies(error);
  }
  return "";
}

}  // namespace isobrick::test
