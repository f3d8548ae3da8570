// PNG files into memory.
#pragma once

#include <string>

#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick::test {

// The picture of a PNG file with at most `most_side` pixels to each side. Throws Error, which names
// the file, for a larger one and for all that is no PNG.
PictureBytes readPng(const std::string& path, int most_side);

}  // namespace isobrick::test
