#include "tools/bench/row_task.h"

namespace isobrick {

void addRowTaskOptions(CLI::App& app, RowTask& task) {
  app.add_option("--row", task.row, "Which row to measure")->type_name("NAME")->required();
  app.add_option("--repeat", task.repeats, "Measured extractions, after one that is not")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000));
  app.add_flag("--cold", task.cold, "Measure the first extraction, with reading the volume");
  app.add_flag("!--no-huge-pages", task.huge_pages, "Refuse huge pages");
  app.add_option("--mesh", task.mesh_path, "Where to write the mesh, for distances")
      ->type_name("PATH");
}

std::vector<std::string> rowTaskWords(const RowTask& task) {
  std::vector<std::string> words = {"--row", task.row, "--repeat", std::to_string(task.repeats)};
  if (task.cold) words.emplace_back("--cold");
  if (!task.huge_pages) words.emplace_back("--no-huge-pages");
  if (!task.mesh_path.empty()) words.insert(words.end(), {"--mesh", task.mesh_path});
  return words;
}

}  // namespace isobrick
