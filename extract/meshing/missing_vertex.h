// A vertex that should have been made before it was used.
#pragma once

#include "isobrick/extract/session/brick_traversal.h"
#include "isobrick/storage/error.h"

namespace isobrick {

// Throws the Error for a brick whose samples or ranges do not fit together; if their bytes could
// not be read, the Error of the read.
[[noreturn]] inline void failMissingVertex(const MeshContext& context, const BrickWork& work) {
  context.throwIfReadsFailed();
  throw Error("'" + context.pyramid.path() + "' contradicts itself in " +
                  brickName(work.level, work.brick) +
                  ": its samples and value ranges do not fit together; check it with 'isobrick "
                  "verify' and build it again",
              {.path = context.pyramid.path(), .level = work.level, .brick = work.brick});
}

}  // namespace isobrick
