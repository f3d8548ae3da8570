// The font of panels and of notes in pictures: TrueType, from the file that CMake found
// (ISOBRICK_FONT). Without one there are no bytes.
#pragma once

namespace isobrick {

extern const unsigned char kInterfaceFont[];
extern const int kInterfaceFontBytes;

}  // namespace isobrick
