# `cmake --install` and find_package(isobrick): storage, preprocess and extract; viewer and tests stay.
include(CMakePackageConfigHelpers)
