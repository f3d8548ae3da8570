// Our own side of a benchmark, its only file that extracts a mesh into memory.
#pragma once

#include <memory>

#include "isobrick/extract/query.h"
#include "isobrick/storage/paged_file.h"
#include "tools/bench/surface_engine.h"

namespace isobrick {

// `budget_bytes` bounds the bytes that stay of the file, and `access` is how it is read, as in
// Pyramid. Runs in the calling TBB arena.
std::unique_ptr<SurfaceEngine> makeIsobrickEngine(const std::string& path,
                                                  std::uint64_t budget_bytes, FileAccess access,
                                                  const Query& query);

}  // namespace isobrick
