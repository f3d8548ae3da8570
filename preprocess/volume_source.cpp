#include "isobrick/preprocess/volume_source.h"

#include <stdexcept>

namespace isobrick {

void VolumeSource::readBox(const IndexBox&, void*) const {
  throw std::logic_error("this volume source is read by rows; ask readsBoxes() first");
}

}  // namespace isobrick
