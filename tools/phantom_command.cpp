// isobrick phantom: test volumes of any size.
#include <fmt/format.h>

#include <memory>
#include <string>
#include <vector>

#include "isobrick/preprocess/export/volume_writer.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/grid.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/json_output.h"
#include "tools/outputs.h"
#include "tools/parse_text.h"
#include "tools/progress_bar.h"
#include "tools/shared_options.h"

namespace isobrick {
namespace {

struct PhantomArguments {
  PhantomSpec spec;
  std::string type;  // empty: the phantom's own
  std::string output;
  bool force = false;
  bool json = false;
};

std::vector<std::string> voxelTypeShortNames() {
  std::vector<std::string> names;
  for (std::uint32_t type = 0; type < kVoxelTypeCount; ++type)
    names.emplace_back(kVoxelTypes[type].short_name);
  return names;
}

int runPhantom(PhantomArguments& arguments) {
  refuseReplacingVolume({arguments.output}, {}, arguments.force);
  arguments.spec.voxel_type = voxelTypeNamed(arguments.type);
  const Phantom phantom(arguments.spec);
  const auto source = makePhantomSource(arguments.spec);
  const std::string type_name(voxelTypeName(phantom.voxelType()));
  {
    const double bytes = static_cast<double>(elementCount(source->info().voxels)) *
                         static_cast<double>(voxelBytes(phantom.voxelType()));
    ProgressBar bar(bytes / 1e6, "MB");
    VolumeWriteOptions options;
    options.cancel = &interruptFlag();
    options.progress = [&bar](double share) { bar.show("phantom", share); };
    writeVolume(*source, arguments.output, options);
  }
  if (arguments.json)
    printJson({{"output", arguments.output},
               {"phantom", arguments.spec.name},
               {"voxels", arguments.spec.size},
               {"voxel_type", type_name},
               {"isovalue", phantom.storedIsovalue()}});
  else
    fmt::print("{}: {} of {}^3 {} voxels; use --iso {}\n", arguments.output, arguments.spec.name,
               arguments.spec.size, type_name, phantom.storedIsovalue());
  return 0;
}

}  // namespace

Command addPhantomCommand(CLI::App& app) {
  CLI::App* const sub =
      app.add_subcommand("phantom", "Make an analytic test volume and say which isovalue to use");
  const auto arguments = std::make_shared<PhantomArguments>();
  sub->add_option("NAME", arguments->spec.name, "Which one")
      ->required()
      ->check(CLI::IsMember(phantomNames()));
  addParsedOption(*sub, "--voxels", arguments->spec.size, integerWithin(2, kMaxVoxelsPerAxis), "N",
                  "Voxels per axis")
      ->required();
  sub->add_option("-o,--output", arguments->output,
                  "Output; a volume, .nrrd, .mhd (with a .raw beside it) or .raw")
      ->type_name("FILE")
      ->required();
  addForceFlag(*sub, arguments->force);
  addJsonFlag(*sub, arguments->json);
  sub->add_option("--type", arguments->type,
                  "Voxels to write; default: u16 for head, u8 for gyroid, f32 for the others")
      ->type_name("T")
      ->check(CLI::IsMember(voxelTypeShortNames()));
  sub->footer(R"(
Example:
  isobrick phantom head --voxels 256 -o head.nrrd)");
  return {sub, [arguments] { return runPhantom(*arguments); }};
}

}  // namespace isobrick
