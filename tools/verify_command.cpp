// isobrick verify: reads every brick and names the damaged ones.
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "isobrick/storage/index_loop.h"
#include "isobrick/storage/isolated_loop.h"
#include "isobrick/storage/pyramid.h"
#include "tools/byte_size.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/one_line.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

struct VerifyArguments {
  std::string path;
  bool no_map = false;
  int threads = allCores();
};

// Checks all bricks of all levels; the damages in the order of the file's brick table.
std::vector<BrickDamage> findDamages(const Pyramid& pyramid) {
  ProgressBar bar(static_cast<double>(pyramid.fileBytes()) / 1e6, "MB");
  const auto total = static_cast<double>(pyramid.brickCount());
  std::atomic<std::int64_t> checked{0};
  std::mutex mutex;
  std::vector<BrickDamage> damages;  // guarded by mutex
  for (int level = 0; level < pyramid.lattice().levels(); ++level) {
    const Index3 bricks = pyramid.layout().bricks(level);
    isolatedFor(std::int64_t{0}, elementCount(bricks), [&](std::int64_t i) {
      interruptFlag().check();
      const Index3 brick = indexAt(i, bricks);
      if (auto damage = pyramid.verifyBrick(level, brick)) {
        const std::lock_guard lock(mutex);
        damages.push_back(std::move(*damage));
      }
      bar.show("verify", static_cast<double>(++checked) / total);
    });
  }
  std::sort(damages.begin(), damages.end(), [&](const BrickDamage& a, const BrickDamage& b) {
    return pyramid.brickRow(a.level, a.brick) < pyramid.brickRow(b.level, b.brick);
  });
  return damages;
}

int runVerify(const VerifyArguments& arguments) {
  const Stopwatch watch;
  const Pyramid pyramid(arguments.path, Pyramid::kDefaultBudgetBytes, fileAccess(arguments.no_map));
  const std::vector<std::string> faults = pyramid.verifyRest(&interruptFlag());
  for (const std::string& fault : faults)
    fmt::print(stderr, "isobrick: {}: {}\n", arguments.path, oneLine(fault));
  const std::vector<BrickDamage> damages =
      runWithThreads(arguments.threads, [&] { return findDamages(pyramid); });
  for (const BrickDamage& damage : damages)
    fmt::print(stderr, "isobrick: level {}, brick ({},{},{}): {}\n", damage.level, damage.brick.x,
               damage.brick.y, damage.brick.z, oneLine(damage.what));
  const std::string bricks = countText(pyramid.brickCount());
  if (!damages.empty()) {
    fmt::print("{}: {} of {} bricks are damaged; build it again\n", arguments.path,
               countText(damages.size()), bricks);
    return 1;
  }
  if (!faults.empty()) {
    fmt::print("{}: all {} bricks are whole, but not the rest of the file; build it again\n",
               arguments.path, bricks);
    return 1;
  }
  fmt::print("{}: all {} bricks are whole ({} in {:.2f} s)\n", arguments.path, bricks,
             byteSizeText(pyramid.fileBytes()), watch.seconds());
  return 0;
}

}  // namespace

Command addVerifyCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand(
      "verify", "Check every brick and table of a pyramid and name what is damaged");
  const auto arguments = std::make_shared<VerifyArguments>();
  sub->add_option("FILE", arguments->path, "Pyramid (.isb)")->type_name("PATH")->required();
  addNoMapFlag(*sub, arguments->no_map);
  addThreadsOption(*sub, arguments->threads);
  sub->footer(R"(
Example:
  isobrick verify head.isb)");
  return {sub, [arguments] { return runVerify(*arguments); }};
}

}  // namespace isobrick
