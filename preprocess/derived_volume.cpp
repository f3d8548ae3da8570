#include "isobrick/preprocess/derived_volume.h"

#include <utility>

#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/smoothed_source.h"

namespace isobrick {

std::unique_ptr<VolumeSource> derivedVolume(std::unique_ptr<VolumeSource> source,
                                            const Derivation& derivation) {
  if (derivation.label) source = makeLabelSource(std::move(source), *derivation.label);
  if (derivation.denoise > 0)
    source = makeSmoothedSource(std::move(source), derivation.denoise, derivation.shifts);
  return source;
}

}  // namespace isobrick
