// The same, and options.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "cold_headers.h"
