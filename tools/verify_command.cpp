// isobrick verify: reads every brick and names the damaged ones.
#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_verify.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/plain_text.h"
#include "tools/progress_bar.h"
#include "tools/query_options.h"
#include "tools/repair.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

struct VerifyArguments {
  std::string path;
  RepairArguments repair;  // if its source has a path; and how files behind URLs are kept
  bool no_map = false;
  bool json = false;
  int threads = allCores();

  bool isToRepair() const { return !repair.source.path.empty(); }
};

// A pyramid that could be opened, and what is wrong with it.
struct CheckedPyramid {
  PyramidFaults faults;
  std::size_t bricks = 0;
  std::uint64_t bytes = 0;

  bool isWhole() const { return faults.empty() && faults.lost_bricks == 0; }
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

CheckedPyramid checkPyramid(const VerifyArguments& arguments) {
  const auto file =
      openPyramidFile(arguments.path, Pyramid::kDefaultBudgetBytes, fileAccess(arguments.no_map),
                      remoteOptions(arguments.repair.source));
  const Pyramid& pyramid = *file;
  CheckedPyramid checked{{}, pyramid.brickCount(), pyramid.fileBytes()};
  ProgressBar bar(static_cast<double>(checked.bytes) / 1e6, "MB");
  checked.faults =
      verifyPyramid(pyramid, {.threads = arguments.threads,
                              .progress = [&](double done) { bar.show("verify", done); },
                              .cancel = &interruptFlag()});
  return checked;
}

// Nothing if the pyramid is whole.
std::optional<RepairReport> repairIfDamaged(const VerifyArguments& arguments) {
  if (!arguments.isToRepair()) return std::nullopt;
  if (isRemotePath(arguments.path))
    throw UsageError("--repair is for pyramids on this machine; copy it here, or leave it out");
  PyramidRepair* const repair = pyramidRepair();
  try {
    if (checkPyramid(arguments).isWhole()) return std::nullopt;
  } catch (const Cancelled&) {
    throw;
  } catch (const Error&) {
    if (!isRegularFile(arguments.path) && !isFolder(arguments.path)) throw;
  }
  RepairArguments what = arguments.repair;
  what.pyramid = arguments.path;
  what.threads = arguments.threads;
  return repair(what);
}

Json jsonOfRepair(const RepairReport& report) {
  Json lost = Json::array();
  for (const LostBrick& brick : report.lost)
    lost.push_back({{"brick", jsonOf(brick.brick)},
                    {"first_voxel", jsonOf(brick.voxels.first)},
                    {"last_voxel", jsonOf(brick.voxels.end() - Index3(1))}});
  return {{"mended", report.mended}, {"lost", lost}, {"losses", report.losses}};
}

void printRepair(const RepairReport& report) {
  for (const std::string& file : report.mended) fmt::print("{}: repaired\n", file);
  std::fflush(stdout);
  for (const LostBrick& brick : report.lost)
    fmt::print(stderr,
               "isobrick: level 0, brick ({}): lost, with the voxels ({}) to ({}); name the volume "
               "that the pyramid was made of\n",
               indexText(brick.brick), indexText(brick.voxels.first),
               indexText(brick.voxels.end() - Index3(1)));
  for (const std::string& loss : report.losses) fmt::print(stderr, "isobrick: {}\n", oneLine(loss));
}

int runVerify(const VerifyArguments& arguments) {
  const Stopwatch watch;
  const std::optional<RepairReport> repaired = repairIfDamaged(arguments);
  if (repaired && !arguments.json) printRepair(*repaired);
  const CheckedPyramid checked = checkPyramid(arguments);
  const PyramidFaults& faults = checked.faults;
  const std::string path = withoutSecrets(arguments.path);
  const bool is_whole = checked.isWhole() && (!repaired || repaired->losses.empty());
  if (arguments.json) {
    Json json = {{"input", path},
                 {"whole", is_whole},
                 {"bricks", checked.bricks},
                 {"lost_bricks", faults.lost_bricks},
                 {"faults", jsonOfFaults(faults)},
                 {"bytes", checked.bytes},
                 {"seconds", watch.seconds()}};
    if (repaired) json["repair"] = jsonOfRepair(*repaired);
    printJson(json);
    return is_whole ? 0 : 1;
  }
  for (const std::string& fault : faults.rest)
    fmt::print(stderr, "isobrick: {}: {}\n", path, oneLine(fault));
  for (const BrickDamage& damage : faults.bricks)
    fmt::print(stderr, "isobrick: level {}, brick ({}): {}\n", damage.level,
               indexText(damage.brick), oneLine(damage.what));
  const char* const advice =
      arguments.isToRepair() ? "build it again" : "build it again, or --repair it";
  const std::string bricks = countText(checked.bricks);
  if (!faults.bricks.empty() || faults.lost_bricks > 0) {
    fmt::print("{}: {} of {} bricks are damaged{}; {}\n", path,
               countText(faults.bricks.size() + faults.lost_bricks), bricks,
               faults.lost_bricks > 0 ? " or lost" : "", advice);
    return 1;
  }
  if (!faults.rest.empty()) {
    fmt::print("{}: all {} bricks are whole, but not the rest of the file; {}\n", path, bricks,
               advice);
    return 1;
  }
  fmt::print("{}: all {} bricks are whole ({} in {:.2f} s)\n", path, bricks,
             byteSizeText(checked.bytes), watch.seconds());
  return is_whole ? 0 : 1;
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
  CLI::Option* const repair =
      sub->add_option(
             "--repair", arguments->repair.source.path,
             "Put what is damaged right, to the bytes that it had: from the pyramid's own "
             "finest level, and where that is damaged from SOURCE, the volume that it was "
             "made of; auto: the one that it names, if that is there. The old file stays until "
             "the new one is complete")
          ->type_name("SOURCE");
  addMemoryOption(*sub, arguments->repair.memory_bytes)->needs(repair);
  addNoMapFlag(*sub, arguments->no_map);
  addThreadsOption(*sub, arguments->threads);
  addJsonFlag(*sub, arguments->json);
  addVolumeOptions(*sub, arguments->repair.source);
  sub->remove_option(findOption(*sub, "--mask-nan"));  // as the pyramid was built
  findOption(*sub, "--cache-folder")->group(kRemoteGroup);
  for (CLI::Option* const option : sub->get_options())
    if (option->get_group() == kVolumeGroup || option->get_group() == kDerivationGroup)
      option->group("How SOURCE is read")->needs(repair);
  sub->footer(R"(
Example:
  isobrick verify head.isb
  isobrick verify head.isb --repair head.nrrd)");
  return {sub, [arguments] { return runVerify(*arguments); }};
}

}  // namespace isobrick
