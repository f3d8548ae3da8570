// Whether a NIfTI file is whole. ITK fills what is missing with zeros and says nothing. Private to
// preprocess/.
#pragma once

#include <cstdint>
#include <string>

namespace isobrick {

// Throws Error unless the file that holds the voxels (`path`, or the .img beside a .hdr; gzipped or
// not) has at least `needed_bytes` and, if gzipped, is undamaged up to its end. A gzipped file is
// inflated for that once.
void checkNiftiWhole(const std::string& path, std::uint64_t needed_bytes);

}  // namespace isobrick
