// The build of one file: a whole pyramid, or a super-brick of a divided one.
#pragma once

#include <optional>
#include <string>

#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_division.h"

namespace isobrick {

// The facts of a pyramid that come from the volume and the options.
PyramidSpec pyramidSpecOf(const VolumeInfo& info, const BuildOptions& options);
// And back: the options that such facts show. An index has some source record, which is not the
// file's own.
BuildOptions buildOptionsOf(const PyramidSpec& spec);

// buildPyramid() for the file of a super-brick, if `file` is one. `provenance`, unless it is empty,
// takes the place of the text about this source and build.
BuildReport buildPyramidFile(VolumeSource& source, InputWatch& input, const std::string& path,
                             const BuildOptions& options, const std::optional<DividedFile>& file,
                             const std::string& provenance = {});

}  // namespace isobrick
