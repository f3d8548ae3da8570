// The formats that ITK knows, and folders of slices.
#pragma once

#include <memory>
#include <string>

#include "preprocess/volume_source.h"

namespace isobrick {

// Opens anything that ITK reads: NRRD, MetaImage, NIfTI, TIFF, ...; a folder is a DICOM series (it
// must hold exactly one) or a stack of TIFF slices. Slope and intercept, spacing, origin and
// direction are applied.
std::unique_ptr<VolumeSource> openItkSource(const std::string& path);

}  // namespace isobrick
