// How alike two pictures look.
#pragma once

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/stream/plane_sampler.h"

namespace isobrick::test {

PictureBytes bytesOf(const Image& image);

// The structural similarity of the colours (Wang et al. 2004), the mean over squares of 8 x 8
// pixels and the three channels: 1 for the same picture, less for any other; 0 if their sizes
// differ.
double similarity(const PictureBytes& a, const PictureBytes& b);

}  // namespace isobrick::test
