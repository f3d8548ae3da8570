// What a pyramid says of its making, in its provenance. Its identity, a part of that, is public
// (pyramid_builder.h).
#pragma once

#include <string>

#include "isobrick/preprocess/pyramid_builder.h"

namespace isobrick {

// JSON, valid UTF-8 whatever the names are. `identity` is that of the source and the options.
std::string provenanceText(const VolumeSource& source, const BuildOptions& options,
                           const std::string& identity);

}  // namespace isobrick
