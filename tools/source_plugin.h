// Level 0 of indexes (`isobrick build --index`), for all executables of the command.
#pragma once

namespace isobrick {

// From then on this process reads level 0 of indexes by a library of its own, which is loaded when
// the first source is opened: it brings ITK, OpenVDB and HDF5.
void readLevel0ByPlugin();

}  // namespace isobrick
