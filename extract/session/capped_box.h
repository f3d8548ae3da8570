// The box of a query with caps.
#pragma once

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// The query; if it has caps and a box, with a box that is the least one around its own that no leaf
// lies across: its corners are voxels of the volume. So its border is six planes, in which every
// leaf at the border has a whole face. The query was checked.
Query withCappedBox(const Pyramid& pyramid, const Query& query);

}  // namespace isobrick
