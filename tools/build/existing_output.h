// What may happen to a file that has the name of a pyramid to be built.
#pragma once

#include <string>

#include "isobrick/preprocess/pyramid_builder.h"

namespace isobrick {

// A slip of the pen must not cost a scan. Throws Error where `output` is the input itself or a file
// that is no pyramid (the data behind a header, a slice of a series), `force` or not; an empty file
// is replaced with `force`. Does not open the input.
void refusePreciousOutput(const std::string& input, const std::string& output, bool force);

// True where `output` is a pyramid of this very source and these options already; false where there
// is none, or one that was made from the same input, which has changed since or is to be built with
// other options. Throws Error where it was made from something else, or where nobody can tell.
// `input_identity` is that of the source. With `any_options` they may be others.
bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool any_options);

}  // namespace isobrick
