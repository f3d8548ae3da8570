// Where crossings may lie on their edges: what the kernels round to, and simplification counts in.
#pragma once

namespace isobrick {

// Crossings sit at multiples of 1/32768 of their edge. So a coordinate counted from a brick's
// origin needs 24 bits at the most (512 half cells and 15 bits), and float holds it exactly.
inline constexpr int kCrossingBits = 15;

}  // namespace isobrick
