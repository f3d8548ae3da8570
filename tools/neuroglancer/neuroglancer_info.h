// The kind of a folder for Neuroglancer, and the facts that its formats lose.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

// The "@type" of the file info in the folder, such as "neuroglancer_multilod_draco"; empty if it
// has none.
std::string neuroglancerTypeOf(const std::string& folder);

// The facts that Neuroglancer's formats have no place for, a line each.
std::vector<std::string> neuroglancerLosses(const GridGeometry& geometry);

// The member "isobrick" of a file info, which keeps the place in the world.
nlohmann::ordered_json placeInWorld(const GridGeometry& geometry);

}  // namespace isobrick
