// Groups of a Zarr store: which images and arrays they hold. Private to preprocess/sources/.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace isobrick {

// The attributes of a group or an array, whichever the version; null if there are none.
nlohmann::json zarrAttributes(const std::string& folder);

// The images of a group's attributes, in either place; null if there are none.
nlohmann::json multiscalesOf(const nlohmann::json& attributes);

// A name that leads down from its folder, and nowhere else.
bool leadsDown(const std::string& name);

// `folder` itself if it is an image or an array, and otherwise the one below it: the only one, or
// that with this number, from 0. Images are those that a converter of bio-formats, a well or a
// plate lists; else images and arrays of three and more axes in the folders below. Throws Error
// with a list if there are several and no number, or none.
std::string chooseZarrVolume(const std::string& folder, std::optional<std::int64_t> number);

}  // namespace isobrick
