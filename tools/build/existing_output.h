// Whether a file that has the name of a pyramid to be built is up to date, or in the way.
#pragma once

#include <string>

#include "isobrick/preprocess/pyramid_builder.h"

namespace isobrick {

// True where `output` is a pyramid of this very source and these options already; false where there
// is none, or one that was made from the same input, which has changed since or is to be built with
// other options. Where it was made from something else, or nobody can tell, throws Error; with
// `force`, which replaces it, false. `input_identity` is that of the source. With `any_options`
// they may be others, but where users said how to read the input (VolumeInfo::encoding) it was read
// so.
bool isUpToDate(const std::string& output, const VolumeInfo& info,
                const std::string& input_identity, const BuildOptions& options, bool any_options,
                bool force);

}  // namespace isobrick
