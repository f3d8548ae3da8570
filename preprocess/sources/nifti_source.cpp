// The voxels of a NIfTI file, whose geometry ITK has read: of one time step, one component.
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/length_units.h"
#include "isobrick/preprocess/sources/nifti_run.h"
#include "isobrick/preprocess/sources/voxel_components.h"

namespace isobrick {
namespace {

// The number of the chosen time step, or of the first. A note says so.
std::uint64_t chooseTimeStep(const std::string& path, std::uint64_t count,
                             const OpenOptions& options, std::vector<std::string>& notes) {
  if (options.time && (*options.time < 0 || static_cast<std::uint64_t>(*options.time) >= count))
    throw unusable(path, "its time steps are 0 to " + std::to_string(count - 1) +
                             ", and none is number " + std::to_string(*options.time));
  const auto step = static_cast<std::uint64_t>(options.time.value_or(0));
  if (count > 1)
    notes.push_back("time step " + std::to_string(step) + " of " + std::to_string(count) +
                    ", counted from 0, was taken");
  return step;
}

}  // namespace

std::unique_ptr<VolumeSource> openNiftiVolume(VolumeInfo info, bool is_origin_scaled,
                                              std::uint64_t components, std::uint64_t time_steps,
                                              const OpenOptions& options) {
  const std::uint64_t step = chooseTimeStep(info.source, time_steps, options, info.notes);
  NiftiRun nifti = findNiftiRun(info.source);
  StoredVoxels& stored = nifti.stored;
  const glm::dvec3 spacing = info.geometry.spacing, origin = info.geometry.origin;
  takeLengthUnits({nifti.length_unit, nifti.length_unit, nifti.length_unit}, info.geometry,
                  info.notes);
  info.geometry.spacing = spacing;
  if (is_origin_scaled) info.geometry.origin = origin;
  const auto contradiction = [&] {
    return unreadable(info.source, "its header is contradictory; check that it is not damaged");
  };
  if (nifti.numbers_together > 1) stored.map.reset();  // it is of plain numbers
  if (!stored.map && stored.delivered() != info.voxel_type) throw contradiction();
  info.voxel_type = stored.delivered();
  if (nifti.numbers_together != 1 && nifti.numbers_together != components) throw contradiction();
  if (stored.map)
    info.notes.push_back("slope " + shortText(stored.map->slope) + " and intercept " +
                         shortText(stored.map->intercept) + " were applied to the stored values");
  if (nifti.numbers_together > 1) takeComponent(components, options, stored, info);
  const bool has_one_volume = components == nifti.numbers_together;
  VolumeInfo chosen = info;
  StoredVoxels unused = stored;
  if (!has_one_volume) takeComponent(components, options, unused, chosen);
  // Another step is another volume when a pyramid is compared with its input.
  if (time_steps > 1)
    chosen.encoding +=
        (chosen.encoding.empty() ? "" : ", ") + ("time step " + std::to_string(step));

  // The file has volumes one behind the other: of a component all time steps.
  const auto bytes = stored.bytesOf(elementCount(info.voxels));
  const auto openComponent = [&](std::uint64_t component, const VolumeInfo& component_info) {
    RawRun run = nifti.run;
    std::uint64_t& offset = run.is_deflated ? run.content_offset_bytes : run.offset_bytes;
    std::uint64_t volume = 0, skipped = 0;
    if (!bytes || __builtin_mul_overflow(component, time_steps, &volume) ||
        __builtin_add_overflow(volume, step, &volume) ||
        __builtin_mul_overflow(*bytes, volume, &skipped) ||
        __builtin_add_overflow(offset, skipped, &offset))
      throw contradiction();
    return openRawRun(component_info, run, stored, options.cancel);
  };
  if (has_one_volume) return openComponent(0, chosen);
  // The last one shows whether the file is whole, if it is not packed.
  if (!nifti.run.is_deflated) openComponent(components - 1, info);
  if (!options.component->magnitude) {
    chosen.voxel_type = info.voxel_type;
    return openComponent(static_cast<std::uint64_t>(options.component->index), chosen);
  }
  std::vector<std::unique_ptr<VolumeSource>> sources;
  for (std::uint64_t c = 0; c < components; ++c) sources.push_back(openComponent(c, info));
  return makeMagnitudeSource(std::move(chosen), std::move(sources));
}

}  // namespace isobrick
