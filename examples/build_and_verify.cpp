// Builds a pyramid with progress, in bounded memory, in a way that can be stopped; checks it; then
// damages a copy of it, and finds the brick.
#include <isobrick/isobrick.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

using namespace isobrick;

namespace {

int countFaults(const std::string& path) {
  const PyramidFaults faults = verifyPyramid(Pyramid(path));
  for (const std::string& fault : faults.rest) std::printf("%s: %s\n", path.c_str(), fault.c_str());
  for (const BrickDamage& damage : faults.bricks)
    std::printf("%s: %s: %s\n", path.c_str(), brickName(damage.level, damage.brick).c_str(),
                damage.what.c_str());
  return static_cast<int>(faults.rest.size() + faults.bricks.size());
}

}  // namespace

int main() try {
  const auto source = makePhantomSource({.name = "gyroid", .size = 160});
  CancelFlag cancel;  // another thread, or a signal handler, may request() a stop
  BuildOptions options;
  options.codec = format::Codec::kZstd;
  options.memory_bytes = std::uint64_t{128} << 20;
  options.cancel = &cancel;
  int percent = 0;
  options.progress = [&](std::string_view phase, double done) {
    if (100 * done < percent) return;
    std::printf("%3d %% %.*s\n", percent, static_cast<int>(phase.size()), phase.data());
    percent += 25;
  };
  const BuildReport report = buildPyramid(*source, "gyroid.isb", options);
  std::printf("%llu bricks in %llu bytes\n", static_cast<unsigned long long>(report.bricks),
              static_cast<unsigned long long>(report.file_bytes));
  std::printf("%d faults as it was built\n", countFaults("gyroid.isb"));

  std::filesystem::copy_file("gyroid.isb", "damaged.isb",
                             std::filesystem::copy_options::overwrite_existing);
  std::fstream file("damaged.isb", std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(5000);  // in the first brick, behind the header
  file.put('?');
  file.close();
  std::printf("%d faults in the damaged copy\n", countFaults("damaged.isb"));
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
