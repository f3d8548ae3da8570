// The measuring itself: rows in turns, each in a process of its own.
#pragma once

#include <functional>
#include <vector>

#include "isobrick/storage/error.h"
#include "tools/bench/bench_plan.h"

namespace isobrick {

// The work in progress, the number of its steps that are done, and of all.
using BenchProgress = std::function<void(const char* what, std::size_t done, std::size_t all)>;

// The rows that the peers' executable has; none without one. Throws Error if it does not list them.
std::vector<PeerRow> askPeers(const BenchSettings& settings, const CancelFlag* cancel);

// Rounds over all rows. A row whose process fails is given up (BenchRow::failure), the others go
// on. Throws Cancelled.
void measureRows(const BenchSettings& settings, std::vector<BenchRow>& rows,
                 const CancelFlag* cancel, const BenchProgress& progress);

// The distances between the finest surface and those that approximate it, once for each name; a
// row that was given up has none. `voxels` are the volume's. Uses the calling TBB arena, and room
// in the folder for temporary files. Throws Error and Cancelled.
void measureErrors(const BenchSettings& settings, const Index3& voxels, std::vector<BenchRow>& rows,
                   const CancelFlag* cancel, const BenchProgress& progress);

}  // namespace isobrick
