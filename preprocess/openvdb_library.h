// The OpenVDB library as a whole. Private to the files that read and write OpenVDB.
#pragma once

#include <openvdb/openvdb.h>
#include <openvdb/util/logging.h>

namespace isobrick {

// From here on OpenVDB has its grid types registered, and prints nothing.
inline void initializeOpenVdb() {
  static const bool kDone = [] {
    openvdb::initialize();
    openvdb::logging::setLevel(openvdb::logging::Level::Fatal);
    return true;
  }();
  static_cast<void>(kDone);
}

}  // namespace isobrick
