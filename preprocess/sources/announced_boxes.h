// A source behind a URL that is told what will be read. Private to preprocess/sources/.
#pragma once

#include <span>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// Some sources are one, too (dynamic_cast).
class AnnouncedBoxes {
 public:
  virtual ~AnnouncedBoxes() = default;
  // Asks the server for what VolumeSource::readBox() of these boxes needs, in this order and all at
  // once, as far as not too much is under way. By any number of threads.
  virtual void announceBoxes(std::span<const IndexBox> boxes) const = 0;
};

}  // namespace isobrick
