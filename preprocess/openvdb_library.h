// The OpenVDB library as a whole. Private to the files that read and write OpenVDB.
#pragma once

#include <openvdb/openvdb.h>
#include <openvdb/util/logging.h>

namespace isobrick {

// OpenVDB knows its grid types, and keeps to itself what it would print, from here on.
inline void initializeOpenVdb() {
  static const bool kDone = [] {
    openvdb::initialize();
    openvdb::logging::setLevel(openvdb::logging::Level::Fatal);
    return true;
  }();
  static_cast<void>(kDone);
}

}  // namespace isobrick
