// The formats that ITK knows, and folders of slices.
#pragma once

#include <memory>
#include <string>

#include "isobrick/preprocess/sources/open_options.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Opens anything that ITK reads: NRRD, MetaImage, NIfTI, TIFF, ...; a folder is a DICOM series (it
// must hold exactly one) or a stack of TIFF slices. Slope and intercept, spacing, origin and
// direction are applied. No pixels are decoded: the voxel type of a series follows from its headers
// (dicom_values.h), each of which is read once.
std::unique_ptr<VolumeSource> openItkSource(const std::string& path,
                                            const OpenOptions& options = {});

}  // namespace isobrick
