// What a folder holds for Neuroglancer.
#pragma once

#include <string>

namespace isobrick {

// The "@type" of the file info in the folder, such as "neuroglancer_multiscale_volume"; empty if it
// has none.
std::string neuroglancerTypeOf(const std::string& folder);

}  // namespace isobrick
