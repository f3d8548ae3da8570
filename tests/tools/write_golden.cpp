// Writes the pyramids of tests/golden and their dumps anew, as the library makes them now:
//
//   write_golden FOLDER
#include <cstdio>
#include <exception>
#include <fstream>

#include "tests/support/golden_pyramid.h"

int main(int argc, char** argv) {
  using namespace isobrick::test;
  if (argc != 2) {
    std::fprintf(stderr, "write_golden: give the folder, as in: write_golden tests/golden\n");
    return 2;
  }
  try {
    for (const GoldenPyramid& golden : goldenPyramids()) {
      const std::string path = std::string(argv[1]) + "/" + golden.name;
      buildGoldenPyramid(golden, path + ".isb");
      std::ofstream(path + ".txt") << dumpOf(readPlainPyramid(path + ".isb"));
    }
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "write_golden: %s\n", error.what());
    return 1;
  }
}
