// check_mesh FILE.ply [--box x0 y0 z0 x1 y1 z1] [--tolerance T] [--embedded]
//
// Prints what the mesh checker says about a mesh. With --box the mesh may be open at the border of
// that box (in the coordinates of the file) and must be inside it. With --embedded no two triangles
// may cross.
// Exit: 0 the mesh is ok, 1 it is not or cannot be read, 2 wrong usage.

#include <cstdlib>
#include <exception>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/crossing_triangles.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/ply_reader.h"

namespace {

constexpr const char* kUsage =
    "usage: check_mesh FILE.ply [--box x0 y0 z0 x1 y1 z1] [--tolerance T] [--embedded]\n";

struct Arguments {
  std::string file;
  bool is_embedded = false;
  isobrick::test::MeshCheckOptions options;
};

std::optional<double> parseNumber(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') return std::nullopt;
  return value;
}

std::optional<Arguments> parseArguments(const std::vector<std::string>& words) {
  Arguments arguments;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const bool is_box = words[i] == "--box";
    const bool is_tolerance = words[i] == "--tolerance";
    if (words[i] == "--embedded") {
      arguments.is_embedded = true;
      continue;
    }
    if (!is_box && !is_tolerance) {
      if (words[i].starts_with("--") || !arguments.file.empty()) return std::nullopt;
      arguments.file = words[i];
      continue;
    }
    std::vector<double> numbers;
    for (std::size_t wanted = is_box ? 6 : 1; wanted > 0; --wanted) {
      if (++i >= words.size()) return std::nullopt;
      const std::optional<double> number = parseNumber(words[i]);
      if (!number) return std::nullopt;
      numbers.push_back(*number);
    }
    if (is_tolerance) {
      arguments.options.tolerance = numbers[0];
    } else {
      arguments.options.box = isobrick::test::MeshBox{{numbers[0], numbers[1], numbers[2]},
                                                      {numbers[3], numbers[4], numbers[5]}};
    }
  }
  if (arguments.file.empty()) return std::nullopt;
  return arguments;
}

}  // namespace

int main(int argc, char** argv) {
  const auto arguments = parseArguments(std::vector<std::string>(argv + 1, argv + argc));
  if (!arguments) {
    std::cerr << kUsage;
    return 2;
  }
  try {
    const isobrick::test::PlyMesh mesh = isobrick::test::readPly(arguments->file);
    const isobrick::test::MeshReport report =
        isobrick::test::checkMesh(mesh.positions, mesh.triangles, arguments->options);
    std::cout << report.summary();
    std::size_t crossing = 0;
    if (arguments->is_embedded) {
      crossing = isobrick::test::crossingTriangles(mesh.positions, mesh.triangles).size();
      std::cout << "crossing pairs of triangles: " << crossing << "\n";
    }
    return report.ok() && crossing == 0 ? 0 : 1;
  } catch (const std::exception& e) {
    std::cerr << "check_mesh: " << e.what() << "\n";
    return 1;
  }
}
