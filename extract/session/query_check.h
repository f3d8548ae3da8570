// Whether a query makes sense for a pyramid.
#pragma once

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Throws Error where a number is not finite or out of its range, where parts of the query exclude
// each other, and where the pyramid lacks what the query needs.
void checkQuery(const Pyramid& pyramid, const Query& query);

}  // namespace isobrick
