// Surfaces extracted in shares, by any processes on any machines, and merged into one mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/triangle_sink.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/share_number.h"

namespace isobrick {

// The ending of the files of shares.
inline constexpr char kMeshShareEnding[] = ".isbm";

// The bricks of a share, by their places in ExtractionPlan::bricks(): runOfShare() of them.
NumberRun bricksOf(const ExtractionPlan& plan, const ShareNumber& share);

// Makes a sink that keeps all batches of a share in a file until they are merged. The
// caller executes bricksOf(plan, share) into it:
//
//   const NumberRun run = bricksOf(plan, share);
//   const auto sink = makeMeshShareSink(path, pyramid, plan, share);
//   extractor.execute(plan, run.first, run.count, *sink);
//
// The file appears under its name in finish(); a sink that is destroyed earlier leaves nothing. Its
// bytes depend on pyramid, query and share alone. vertices() are those of the share, which others
// may have, too. `cancel` may be null and outlives the sink. Throws Error if the path cannot be
// written, ResumableError if the disk is full.
std::unique_ptr<MeshFileSink> makeMeshShareSink(const std::string& path, const Pyramid& pyramid,
                                                const ExtractionPlan& plan,
                                                const ShareNumber& share,
                                                const CancelFlag* cancel = nullptr);

// The result of a merge.
struct MergeReport {
  std::uint32_t shares = 0;     // that were merged
  std::uint64_t triangles = 0;  // of the mesh
  std::uint64_t bytes = 0;      // of the shares' files
};

// Passes the batches of all shares of one surface, in any order of `paths`, to `sink`: the same
// calls in the same order as Extractor::extract() of the whole query makes, so the same bytes come
// out of a mesh file. Memory: some batches for each thread of the calling TBB arena, and what the
// sink remembers. `cancel` may be null.
//
// Nothing in the files is believed before it is checked. Throws Error that names the file if one is
// no share, damaged, or of another surface or pyramid; if two are the same share; and if one is
// missing, with its number. Throws Cancelled, and whatever the sink throws.
MergeReport mergeMeshShares(const std::vector<std::string>& paths, TriangleSink& sink,
                            const CancelFlag* cancel = nullptr);

}  // namespace isobrick
