// Where the tests find what they do not make themselves.
#pragma once

#include <string>

namespace isobrick::test {

// Folder of the real volumes; it need not exist.
std::string sharedData();

// Folder of the checked-in pyramids.
std::string goldenFolder();

// The server of ranges: tests/support/range_server.h.
std::string rangeServerScript();

// The `isobrick` command of this build.
std::string isobrickCommand();

// The same with faults: tests/tools/isobrick_with_faults.cpp.
std::string isobrickWithFaults();
std::string isobrickExtractWithFaults();
std::string isobrickViewWithFaults();

}  // namespace isobrick::test
