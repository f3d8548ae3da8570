#include "tools/source_plugin.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include "isobrick/storage/error.h"
#include "isobrick/storage/source_bricks.h"
#include "tools/own_folder.h"

namespace isobrick {
namespace {

constexpr char kPluginName[] = "isobrick-sources.so";

// The library stays: what it opened is used to the end of the process.
const SourceOpener& openerOfPlugin() {
  static const SourceOpener* const opener = [] {
    const std::string path = requiredFile(kPluginName);
    void* const library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    void* const symbol = library != nullptr ? dlsym(library, "isobrickSourceOpener") : nullptr;
    if (symbol == nullptr)
      throw Error(fmt::format("cannot load '{}': {}; install isobrick again", path, dlerror()));
    return reinterpret_cast<const SourceOpener* (*)()>(symbol)();
  }();
  return *opener;
}

}  // namespace

void readLevel0ByPlugin() {
  setSourceOpener([](const SourceRequest& request) { return openerOfPlugin()(request); });
}

}  // namespace isobrick
