#include "tests/support/test_paths.h"

namespace isobrick::test {

// Definitions of this file alone, so that the others do not depend on where the build is.
std::string sharedData() { return ISOBRICK_SHARED_DATA; }
std::string goldenFolder() { return ISOBRICK_GOLDEN_FOLDER; }
std::string rangeServerScript() { return ISOBRICK_RANGE_SERVER; }
std::string isobrickCommand() { return ISOBRICK_COMMAND; }
std::string isobrickWithFaults() { return ISOBRICK_WITH_FAULTS; }
std::string isobrickExtractWithFaults() { return ISOBRICK_EXTRACT_WITH_FAULTS; }
std::string isobrickViewWithFaults() { return ISOBRICK_VIEW_WITH_FAULTS; }

}  // namespace isobrick::test
