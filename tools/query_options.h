// The options with which extract and render say what surface they want.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/storage/pyramid.h"
#include "tools/choice_options.h"
#include "tools/parse_text.h"
#include "tools/region_options.h"
#include "tools/volume_input.h"

namespace isobrick {

struct QueryOptions {
  VolumeInput input;
  std::vector<std::string> files;                // of commands that take several: see queryOfFile()
  std::vector<std::size_t> isovalues_by_word;    // how many each --iso gave
  double isovalue = 0;                           // the first one, or the one of makeQuery()
  std::vector<std::optional<double>> isovalues;  // all; nothing: 'auto', until chooseIsovalues()
  std::optional<InsideOf> inside = InsideOf::kAbove;  // none: as the volume says
  ChoiceOptions choice;
  std::vector<ChoiceOptions> or_finer;
  std::optional<Corners> box;
  bool box_in_world = false;  // with a unit: in millimetres
  bool cap = false;
  RegionOptions region;
  std::optional<SimplifyOptions> simplify;
  bool world = false;
  std::uint64_t memory_bytes = Pyramid::kDefaultBudgetBytes;
  bool no_map = false;
  int threads = 0;
};

// FILE, --iso and all that narrow the query down. More than one isovalue, and more than one FILE,
// are refused unless `several`; then FILE is in `files` alone.
void addQueryOptions(CLI::App& app, QueryOptions& options, bool several = false);
// The options for one of its files: all isovalues, or, if --iso was given once for each of several
// files, those of its own. Throws UsageError for another number of them.
QueryOptions queryOfFile(const QueryOptions& all, std::size_t file);

// --simplify.
void addSimplifyOption(CLI::App& app, QueryOptions& options);

// findPyramid() of its input.
void findPyramid(QueryOptions& options);
// The same of its masks.
void findMasks(QueryOptions& options);
// Opens its masks, each with `memory_bytes`.
void openMasks(QueryOptions& options, std::uint64_t memory_bytes);

// --no-map, as the other commands have it too.
void addNoMapFlag(CLI::App& app, bool& no_map);

// Opens a pyramid, local or behind a URL. Throws Cancelled at once after Ctrl-C, even while a
// server is waited for.
std::shared_ptr<const Pyramid> openPyramidFile(const std::string& path, std::uint64_t memory_bytes,
                                               FileAccess access, const RemoteOptions& remote);

inline FileAccess fileAccess(bool no_map) { return no_map ? FileAccess::kRead : FileAccess::kMap; }

// A value of the pyramid's voxels, with as few digits as tell them apart.
std::string valueText(const Pyramid& pyramid, double value);

// For --iso auto, takes the first isovalue that is suggested for the pyramid, and says on stderr
// which one that is. Throws Error if all voxels are equal.
void chooseIsovalues(QueryOptions& options, const Pyramid& pyramid);

// Throws UsageError if an isovalue is given twice.
void refuseTwinIsovalues(std::vector<std::optional<double>> isovalues);

// The side of the object in a volume with this "vdb.class" among its VolumeInfo::properties: a
// level set is negative inside.
InsideOf insideOfClass(const std::string& vdb_class);
// The side of the object: for 'auto' what the pyramid's source said of itself.
InsideOf insideOf(const QueryOptions& options, const Pyramid& pyramid);

// The query in voxel indices, whatever the user's units are; stopped by Ctrl-C.
Query makeQuery(const QueryOptions& options, const Pyramid& pyramid);

// One line on stderr, and true, if the isovalue separates no voxels, so that the mesh will be
// empty.
bool warnOfEmptySurface(const QueryOptions& options, const Pyramid& pyramid);
// The same of a volume whose voxels are `range`, as stored.
bool warnOfEmptySurface(const VolumeInput& input, double isovalue, const Pyramid& pyramid,
                        const ValueRange& range);

}  // namespace isobrick
