// Whether a TIFF file has all of its pages. Private to preprocess/sources/.
#pragma once

#include <string>

namespace isobrick {

// libtiff takes a file that ends within its list of pages as one of fewer pages. Throws Error that
// names the file where the list leads out of it, or in a circle. What is wrong with a page itself
// is libtiff's to find.
void checkTiffPages(const std::string& path);

}  // namespace isobrick
