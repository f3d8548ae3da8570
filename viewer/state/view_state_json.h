// The state of a view as JSON text and back; view_file.h has the files.
#pragma once

#include <string>

#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

// Every field of ViewState under its own name; doubles come back to the bit.
std::string viewStateToJson(const ViewState& state);

// Fields that the text lacks keep their defaults, but a camera without a distance is not placed:
// isPlaced(). Throws Error, in one line that names the field,
// for text that is no JSON, an unknown field, and a value of another type or out of its range.
ViewState viewStateFromJson(const std::string& text);

}  // namespace isobrick
