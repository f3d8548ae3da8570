// Units of length by their names, in headers and in words of users.
#pragma once

#include <optional>
#include <string>

namespace isobrick {

// So many millimetres: a product and a quotient, so that 0.65 micrometres become just 0.00065.
struct LengthScale {
  double times = 1, over = 1;
  double of(double length) const { return length * times / over; }
  bool operator==(const LengthScale&) const = default;
};

// The scale of picometres, nanometres, micrometres, millimetres, centimetres, metres, angstroms,
// inches and feet, as names ("Micrometres") and as symbols ("um"); none for any other word.
std::optional<LengthScale> lengthScale(const std::string& unit);

}  // namespace isobrick
