// isobrick verify: reads every brick and names the damaged ones.
#include <fmt/format.h>

#include <memory>
#include <string>

#include "isobrick/storage/pyramid_verify.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

struct VerifyArguments {
  std::string path;
  std::string cache_folder;
  std::uint64_t cache_bytes = 0;
  bool no_map = false;
  bool json = false;
  int threads = allCores();
};

Json jsonOfFaults(const PyramidFaults& faults) {
  Json json = Json::array();
  for (const std::string& fault : faults.rest)
    json.push_back({{"level", nullptr}, {"brick", nullptr}, {"what", fault}});
  for (const BrickDamage& damage : faults.bricks)
    json.push_back(
        {{"level", damage.level}, {"brick", jsonOf(damage.brick)}, {"what", damage.what}});
  return json;
}

int runVerify(const VerifyArguments& arguments) {
  const Stopwatch watch;
  const auto file =
      openPyramidFile(arguments.path, Pyramid::kDefaultBudgetBytes, fileAccess(arguments.no_map),
                      remoteOptions(arguments.cache_folder, arguments.cache_bytes));
  const Pyramid& pyramid = *file;
  const std::string path = withoutSecrets(arguments.path);
  PyramidFaults faults;
  {
    ProgressBar bar(static_cast<double>(pyramid.fileBytes()) / 1e6, "MB");
    faults = verifyPyramid(pyramid, {.threads = arguments.threads,
                                     .progress = [&](double done) { bar.show("verify", done); },
                                     .cancel = &interruptFlag()});
  }
  const bool is_whole = faults.rest.empty() && faults.bricks.empty() && faults.lost_bricks == 0;
  if (arguments.json) {
    printJson({{"input", path},
               {"whole", is_whole},
               {"bricks", pyramid.brickCount()},
               {"lost_bricks", faults.lost_bricks},
               {"faults", jsonOfFaults(faults)},
               {"bytes", pyramid.fileBytes()},
               {"seconds", watch.seconds()}});
    return is_whole ? 0 : 1;
  }
  for (const std::string& fault : faults.rest)
    fmt::print(stderr, "isobrick: {}: {}\n", path, oneLine(fault));
  for (const BrickDamage& damage : faults.bricks)
    fmt::print(stderr, "isobrick: level {}, brick ({},{},{}): {}\n", damage.level, damage.brick.x,
               damage.brick.y, damage.brick.z, oneLine(damage.what));
  const std::string bricks = countText(pyramid.brickCount());
  if (!faults.bricks.empty() || faults.lost_bricks > 0) {
    fmt::print("{}: {} of {} bricks are damaged{}; build it again\n", path,
               countText(faults.bricks.size() + faults.lost_bricks), bricks,
               faults.lost_bricks > 0 ? " or lost" : "");
    return 1;
  }
  if (!faults.rest.empty()) {
    fmt::print("{}: all {} bricks are whole, but not the rest of the file; build it again\n", path,
               bricks);
    return 1;
  }
  fmt::print("{}: all {} bricks are whole ({} in {:.2f} s)\n", path, bricks,
             byteSizeText(pyramid.fileBytes()), watch.seconds());
  return 0;
}

}  // namespace

Command addVerifyCommand(CLI::App& app) {
  CLI::App* const sub = app.add_subcommand(
      "verify", "Check every brick and table of a pyramid and name what is damaged");
  const auto arguments = std::make_shared<VerifyArguments>();
  sub->add_option("FILE", arguments->path,
                  "Pyramid (.isb), also behind http://, https://, s3:// or gs://")
      ->type_name("PATH")
      ->required();
  addNoMapFlag(*sub, arguments->no_map);
  addThreadsOption(*sub, arguments->threads);
  addJsonFlag(*sub, arguments->json);
  addCacheFolderOption(*sub, arguments->cache_folder)->group(kRemoteGroup);
  addCacheSizeOption(*sub, arguments->cache_bytes);
  sub->footer(R"(
Example:
  isobrick verify head.isb)");
  return {sub, [arguments] { return runVerify(*arguments); }};
}

}  // namespace isobrick
