// The check that a query makes sense for a pyramid.
#pragma once

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// Throws Error if a number is not finite or out of its range, if parts of the query exclude each
// other, and if the pyramid lacks what the query needs.
void checkQuery(const Pyramid& pyramid, const Query& query);

}  // namespace isobrick
