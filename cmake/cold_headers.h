// The same, and JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "hot_headers.h"
