#include "tools/pvd_list.h"

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>
#include <map>

#include "isobrick/extract/sinks/xml_text.h"
#include "isobrick/storage/atomic_file.h"

namespace isobrick {
void writePvd(const std::string& path, const std::vector<ExtractResult>& surfaces) {
  std::string text =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  std::map<std::size_t, int> parts;  // of each step, so far
  for (const ExtractResult& surface : surfaces)
    text += fmt::format("    <DataSet timestep=\"{}\" part=\"{}\" file=\"{}\"/>\n", surface.step,
                        parts[surface.step]++,
                        xmlText(std::filesystem::path(surface.output).filename().string()));
  text += "  </Collection>\n</VTKFile>\n";
  AtomicFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace isobrick
