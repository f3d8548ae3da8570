// Which surface it is, as text: of which pyramid, and by which query.
#pragma once

#include <string>

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The version of the meshes that a pyramid and a query give. Raise it with every change after which
// they are other ones, so that shares of two programs are not merged.
inline constexpr int kMeshAlgorithm = 2;

// A line for each fact; equal texts mean equal surfaces, batch by batch.
std::string surfaceIdentity(const Pyramid& pyramid, const SurfaceChoice& choice);

// "isovalue=500 (and isovalue=600 in the other)" for the first line that differs.
std::string firstDifference(const std::string& identity, const std::string& other);

}  // namespace isobrick
