// Units of length as files name them, and the way to millimetres.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/grid.h"

namespace isobrick {

// So many millimetres: a product and a quotient, so that 0.65 micrometres become just 0.00065.
struct LengthScale {
  double times = 1, over = 1;
  double of(double length) const { return length * times / over; }
  bool operator==(const LengthScale&) const = default;
};

// The scale of picometres, nanometres, micrometres, millimetres, centimetres, metres, angstroms and
// inches, as names ("Micrometres") and as symbols ("um"); none for any other word.
std::optional<LengthScale> lengthScale(const std::string& unit);

// The numbers of `geometry` along the world's axes are in these units, "" if none is stated.
// Converts them to millimetres, with a note if they were not. If a unit is missing or no length,
// all numbers stay and their unit is unknown, with a note if a file states only some units.
void takeLengthUnits(const std::array<std::string, 3>& units, GridGeometry& geometry,
                     std::vector<std::string>& notes);

}  // namespace isobrick
