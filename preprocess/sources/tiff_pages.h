// Whether a TIFF file has all of its pages. Private to preprocess/sources/.
#pragma once

#include <string>

namespace isobrick {

// libtiff takes a file that ends within its list of pages as one of fewer pages, and ITK takes all
// pages to be as large as the first and reads beyond those that are not. Throws Error that names
// the file where the list leads out of it or in a circle, or where pages differ; smaller pictures
// beside the pages may. What else is wrong with a page is libtiff's to find.
void checkTiffPages(const std::string& path);

}  // namespace isobrick
