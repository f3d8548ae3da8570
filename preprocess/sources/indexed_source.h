// The source of an index (`isobrick build --index`), whose level 0 stays where it is: what the
// index notes of it, and how it is opened again.
#pragma once

#include <string>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/source_bricks.h"

namespace isobrick {

// The text for BuildOptions::source_record of an index at `index` (of a divided pyramid, its
// folder): how `source`, which openVolume() opened with these options, is found and opened again,
// and how it is known. A source in the folder of the index, or below it, is found from there, so
// both may move together; another one has its whole path.
//
// Throws Error if no brick can be read from the source alone: its voxels are packed as a whole, or
// of slices that are read in order (VolumeSource::readsBoxes()), or it is no file.
std::string sourceRecord(const VolumeSource& source, const OpenOptions& options,
                         const std::string& index);

// Opens such sources. It throws Error that names the source if it is not there, if its size, the
// time of its last change or what a server says of its edition is not what the index noted, and if
// it takes more memory than the request allows.
SourceOpener volumeSourceOpener();

// setSourceOpener() of that: from then on this process reads level 0 of indexes.
void readLevel0FromSources();

}  // namespace isobrick
