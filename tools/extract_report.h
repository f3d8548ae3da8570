// The report of `isobrick extract`: an object of JSON, or lines to read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/mesh_check.h"
#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/preprocess/derived_volume.h"
#include "isobrick/storage/brick_pager.h"
#include "isobrick/storage/remote_options.h"
#include "isobrick/storage/share_number.h"
#include "tools/json_output.h"

namespace isobrick {

// In place of another pyramid: the number of the component that a vertex belongs to.
inline constexpr const char* kComponentAttribute = "component";

struct AttributeFacts {
  std::string name;
  std::string path;  // of the pyramid or mesh that it comes from; empty: of none
};

// The extraction of one surface.
struct ExtractResult {
  std::string output;    // empty: counted only
  std::string file;      // that it is of, if there are several
  std::size_t step = 0;  // its number among them
  double isovalue = 0;
  std::optional<std::uint64_t> label;  // whose surface it is
  std::optional<SurfaceShift> moved;   // by --denoise, if the volume was smoothed just now
  std::optional<SimplifyOptions> simplify;
  bool is_finest = true;    // level 0 everywhere
  MeshPlacement placement;  // of the file
  std::optional<SurfaceComponents> components;
  std::vector<std::uint8_t> is_kept;  // of each of the components, 0 or 1
  std::string ranked_by;              // of --keep-largest: "volume" or "area"
  double components_seconds = 0;      // to find them
  ExtractionReport report;            // of the last repeat
  std::uint64_t missing_voxels = 0;   // of the pyramid: without data
  std::uint64_t vertices = 0;
  std::vector<double> extract_seconds;  // one for every repeat, without the time in a file's sink
  std::vector<std::uint64_t> vertices_outside;  // of each attribute: of its pyramid
  std::optional<MeshQuality> quality;           // of --check
  double write_seconds = 0;  // inside the file's sink: writing, and waiting for the disk
};

struct ExtractResults {
  std::vector<ExtractResult> surfaces;
  std::vector<AttributeFacts> attributes;  // that vertices got
  std::optional<ShareNumber> part;
  LengthUnit unit = LengthUnit::kUnknown;  // of the world
  int threads = 0;
  double open_seconds = 0;
  BrickPager::Counters pager;            // of all surfaces and repeats
  std::optional<RemoteCounters> remote;  // of all since the beginning; of a URL
  RemoteCounters opening;
};

// Adds the surfaces of another volume, or of another label, to the report.
void addResults(ExtractResults one, ExtractResults& all);

// For one isovalue its own facts; for several a list of these.
Json jsonOfResults(const ExtractResults& results);
// On stdout.
void printResults(const ExtractResults& results);

// Of --check.
Json jsonOfQuality(const MeshQuality& quality);
// The same as lines on stdout.
void printQuality(const MeshQuality& quality);

// All of them, the largest area first.
Json jsonOfComponents(const SurfaceComponents& components);

// The ones of the largest area on stdout, numbered from 0 on, how many more there are, and how many
// are kept, with the measure by which they were chosen; empty: none.
void printComponents(const SurfaceComponents& components, const std::vector<std::uint8_t>& is_kept,
                     const std::string& ranked_by);

}  // namespace isobrick
