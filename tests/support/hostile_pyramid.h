// Pyramids that somebody made to do harm: small, with right checksums, and wrong wherever chance
// wants it.
#pragma once

#include <string>

#include "tests/support/random_numbers.h"
#include "tests/support/sealed_pyramid.h"

namespace isobrick::test {

// A copy of the pyramid `good` with one to four changes: of header fields, tables, places, sizes
// and codecs of parts, ranges, samples, curvature codes, packed bytes, provenance or padding; then
// sealed. Most changes are such that the file still opens. `what` gets the changes' names.
Bytes makeHostilePyramid(const Bytes& good, Random& random, std::string& what);

// A number that breaks arithmetic: NaN, infinite, zero, subnormal, greatest, or just any bits.
float nastyFloat(Random& random);

}  // namespace isobrick::test
