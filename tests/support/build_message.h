// What a build that is refused says.
#pragma once

#include <string>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/error.h"

namespace isobrick::test {

// Builds `path`; the message of the Error that this throws, or "" where it throws none.
inline std::string messageOfBuild(VolumeSource& source, const std::string& path,
                                  const BuildOptions& options) {
  try {
    buildPyramid(source, path, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace isobrick::test
