// --threads, the same for every subcommand.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <CLI/CLI.hpp>
#include <utility>

#include "tools/parse_text.h"
#include "tools/parsed_option.h"

namespace isobrick {

// All cores that the process may use.
inline int allCores() { return tbb::this_task_arena::max_concurrency(); }

inline void addThreadsOption(CLI::App& app, int& threads) {
  addParsedOption(app, "--threads", threads, integerWithin(1, 1024), "N",
                  "Threads to use; default: all cores");
}

// Calls `work()` with TBB limited to `threads` threads, the calling one included.
template <typename Work>
auto runWithThreads(int threads, Work&& work) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  return arena.execute(std::forward<Work>(work));
}

}  // namespace isobrick
