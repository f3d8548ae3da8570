// What hot_headers.h has, and JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "hot_headers.h"
