#include "tools/build/build_one.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <new>
#include <stdexcept>
#include <system_error>

#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid.h"
#include "tools/build/existing_output.h"
#include "tools/byte_size.h"
#include "tools/progress_bar.h"
#include "tools/stopwatch.h"
#include "tools/thread_count.h"

namespace isobrick {
namespace {

std::unique_ptr<VolumeSource> openShowingProgress(const BuildJob& job,
                                                  const BuildSettings& settings) {
  ProgressBar bar(100, "%");
  OpenOptions options = openOptionsOf(job.input);
  options.cancel = settings.options.cancel;
  options.progress = [&](std::string_view phase, double share) {
    bar.show(fmt::format("{}{}", job.label, phase), share);
  };
  return openVolume(job.input.path, options);
}

BuildReport buildShowingProgress(VolumeSource& source, InputWatch& input, const BuildJob& job,
                                 const BuildSettings& settings) {
  const VolumeInfo& info = source.info();
  const double bytes = static_cast<double>(elementCount(info.voxels)) *
                       static_cast<double>(voxelBytes(info.voxel_type));
  ProgressBar bar(bytes / 1e6, "MB");
  BuildOptions options = settings.options;
  options.progress = [&](std::string_view phase, double share) {
    bar.show(fmt::format("{}{}", job.label, phase), share);
  };
  return buildPyramid(source, input, job.output, options);
}

// Level 0 comes first, and only its bricks are read from the input.
std::uint64_t freshBytes(const Pyramid& pyramid, std::uint64_t bricks_resumed) {
  const auto all = static_cast<std::uint64_t>(elementCount(pyramid.layout().bricks(0)));
  const double share =
      static_cast<double>(all - std::min(all, bricks_resumed)) / static_cast<double>(all);
  return static_cast<std::uint64_t>(static_cast<double>(pyramid.bytes().raw) * share);
}

void takeNoteOfPyramid(BuiltVolume& built) {
  const Pyramid pyramid(built.output);
  built.bytes = pyramid.bytes();
  built.levels = pyramid.lattice().levels();
  built.bricks = pyramid.brickCount();
  if (!built.skipped) built.fresh_bytes = freshBytes(pyramid, built.report.bricks_resumed);
}

BuiltVolume openAndBuild(const BuildJob& job, const BuildSettings& settings) {
  const Stopwatch watch;
  BuiltVolume built;
  built.output = job.output;
  refusePreciousOutput(job.input.path, job.output, settings.force);
  const std::unique_ptr<VolumeSource> source = openShowingProgress(job, settings);
  built.open_seconds = watch.seconds();
  InputWatch input(*source, settings.options.cancel);
  built.skipped =
      !settings.force && isUpToDate(job.output, source->info(), input.identity(), settings.options);
  if (!built.skipped) built.report = buildShowingProgress(*source, input, job, settings);
  built.volume = source->info();
  if (built.report.replaced_voxels > 0)
    built.volume.notes.push_back(fmt::format("{} voxels that were not finite became {}",
                                             built.report.replaced_voxels,
                                             *settings.options.nan_as));
  takeNoteOfPyramid(built);
  built.seconds = watch.seconds();
  return built;
}

Error outOfMemory(const BuildJob& job, const BuildSettings& settings) {
  return Error(
      fmt::format("not enough memory for '{}': the system gives less than the {} that --memory "
                  "allows; give a smaller --memory or fewer --threads",
                  job.input.path, byteSizeText(settings.options.memory_bytes)));
}

}  // namespace

BuiltVolume buildOne(const BuildJob& job, const BuildSettings& settings) {
  refuseKnownMisfits(job.input);
  try {
    return runWithThreads(settings.threads, [&] { return openAndBuild(job, settings); });
  } catch (const std::bad_alloc&) {
    throw outOfMemory(job, settings);
  } catch (const std::length_error&) {  // what a vector throws for more than all addresses
    throw outOfMemory(job, settings);
  } catch (const std::system_error& failure) {  // a thread that the system does not give
    if (failure.code() != std::errc::resource_unavailable_try_again) throw;
    throw Error(fmt::format("cannot start the threads to build '{}': {}; give fewer --threads",
                            job.input.path, failure.what()));
  }
}

}  // namespace isobrick
