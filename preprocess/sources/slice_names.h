// Files of a folder as the slices of a stack. Private to preprocess/sources/.
#pragma once

#include <string>
#include <vector>

#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Regular files of the folder, sorted by their bytes. Throws Error if it cannot be read, and for
// links to nowhere, which may be slices (not for those of editors, whose names begin with a dot).
std::vector<std::string> filesInFolder(const std::string& folder);

// Regular files in the folders below it, sorted; links to folders are not followed.
std::vector<std::string> filesBelowFolder(const std::string& folder);

// The slices of one volume among some files of a folder, in their order, by the numbers in their
// names: names of another kind beside a run of slices are left out with a note; numbers of channels
// ("_ch01") and times ("_t01") beside those of slices are chosen by the options. Names without
// numbers are taken as they sort. Throws Error with a list if slices are missing, or if there is no
// telling what is a slice.
std::vector<std::string> chooseSlices(const std::vector<std::string>& files,
                                      const OpenOptions& options, VolumeInfo& info);

// "slice9" before "slice10": runs of digits compare as numbers.
bool numericNameLess(const std::string& a, const std::string& b);

}  // namespace isobrick
