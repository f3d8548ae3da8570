// isobrick extract -o NAME.precomputed
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/query_options.h"

namespace isobrick {

// Throws UsageError for an option that the format has no place for, and Error if `output` exists
// without `force`, or is a folder of something else.
void refuseForMeshes(const CLI::App& command, const QueryOptions& options,
                     const std::string& output, bool force);

// Writes the surfaces of all isovalues, all levels of each, and prints what was written.
int runExtractMeshes(QueryOptions options, const std::string& output, bool as_json);

}  // namespace isobrick
