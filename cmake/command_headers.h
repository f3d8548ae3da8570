// What cold_headers.h has, and what reads options and prints.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "cold_headers.h"
