// `isobrick info --graphics`: what draws on this machine.
#pragma once

namespace isobrick {

// Prints it, for people or as JSON. Throws Error if nothing draws here.
void printGraphics(bool json);

}  // namespace isobrick
