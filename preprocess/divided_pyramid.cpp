#include "isobrick/preprocess/divided_pyramid.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <filesystem>
#include <memory>
#include <set>

#include "isobrick/preprocess/build_plan.h"
#include "isobrick/preprocess/hand_over.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/pyramid_file_builder.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/pyramid_tables.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

SuperBricks superBricksOf(const VolumeInfo& info, const BuildOptions& options) {
  const BrickLayout layout = pyramidSpecOf(info, options).layout();
  const std::int64_t cells = options.super_cells;
  const std::int64_t most = options.brick_cells * SuperBricks::kMostBricksAlong;
  if (cells < options.brick_cells || cells > most ||
      !std::has_single_bit(static_cast<std::uint64_t>(cells)))
    throw Error(concat("a super-brick of bricks of ", options.brick_cells, " cells has ",
                       options.brick_cells, " to ", most, " cells along an edge, a power of two"));
  if (layout.lattice().levels() < 2)
    throw fileError(info.source, "'", info.source,
                    "' fits into one brick: its pyramid has one level and is not divided; build it "
                    "as one file");
  return {layout, cells};
}

std::string pathIn(const std::string& folder, const std::string& name) {
  return (fs::path(folder) / name).string();
}

// Of a pyramid or a file of one; "" if its provenance is of no build.
std::string identityIn(const PyramidTables& tables) {
  return textOf(member(parseShallowJson(tables.provenance()), "identity"));
}

}  // namespace

std::vector<SuperBrickFile> superBrickFiles(const VolumeInfo& info, const BuildOptions& options) {
  const SuperBricks super_bricks = superBricksOf(info, options);
  const PyramidSpec spec = pyramidSpecOf(info, options);
  std::vector<SuperBrickFile> files;
  for (std::size_t number = 0; number < super_bricks.count(); ++number) {
    const BuildRegion region(spec, DividedFile{super_bricks, number});
    files.push_back({super_bricks.fileName(number),
                     region.needs().ownVoxels(region.rows().bricks(0)),
                     region.samples(0, region.windowBricks(0))});
  }
  return files;
}

BuildReport buildSuperBrick(VolumeSource& source, const std::string& folder, std::size_t number,
                            const BuildOptions& options) {
  InputWatch input(source, options.cancel);
  return buildSuperBrick(source, input, folder, number, options);
}

BuildReport buildSuperBrick(VolumeSource& source, InputWatch& input, const std::string& folder,
                            std::size_t number, const BuildOptions& options) {
  const DividedFile file{superBricksOf(source.info(), options), number};
  return buildPyramidFile(source, input, pathIn(folder, file.name()), options, file);
}

DividedFileState stateOfDividedFile(const std::string& path, const std::string& identity) {
  if (!isNameTaken(path)) return DividedFileState::kMissing;
  if (!isRegularFile(path)) return DividedFileState::kOfAnotherBuild;
  try {
    const PyramidTables tables(path, FileAccess::kRead, {});
    if (!tables.dividedFile() || identityIn(tables) != identity)
      return DividedFileState::kOfAnotherBuild;
    static_cast<void>(tables.divisionBytes());
    return tables.dividedFile()->name() == fs::path(path).filename() ? DividedFileState::kBuilt
                                                                     : DividedFileState::kDamaged;
  } catch (const Error&) {
    const bool is_ours = fileBytes(path) == 0 || beginsAsPyramid(path);
    return is_ours ? DividedFileState::kDamaged : DividedFileState::kOfAnotherBuild;
  }
}

namespace {

// Names of files, a few of many.
std::string someOf(const std::vector<std::string>& names) {
  constexpr std::size_t kMostNamed = 8;
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kMostNamed); ++i)
    text.append(i > 0 ? ", " : "").append(names[i]);
  if (names.size() > kMostNamed) text += ", ...";
  return text;
}

// The names in a folder that files of super-bricks may have: "0-2-1.isb".
std::set<std::string> superBrickNamesIn(const std::string& folder) {
  std::set<std::string> names;
  const std::error_code error = visitFolder(folder, [&](const FolderMember& file) {
    const std::string stem = file.path().stem().string();
    if (file.path().extension() == ".isb" && !stem.empty() &&
        stem.find_first_not_of("0123456789-") == std::string::npos)
      names.insert(file.name());
    return true;
  });
  if (error)
    throw fileError(folder, "'", folder, "' cannot be read: ", error.message(), "; check the path");
  if (names.empty())
    throw fileError(folder, "'", folder, "' has no files of super-bricks; build them first");
  return names;
}

// All files are there, and no others that look like them.
void checkNames(const std::string& folder, const SuperBricks& super_bricks,
                std::set<std::string> names) {
  std::vector<std::string> missing;
  for (std::size_t number = 0; number < super_bricks.count(); ++number)
    if (names.erase(super_bricks.fileName(number)) == 0)
      missing.push_back(super_bricks.fileName(number));
  if (!missing.empty())
    throw fileError(folder, "'", folder, "' lacks ", missing.size(), " of its ",
                    super_bricks.count(), " files: ", someOf(missing),
                    "; build these super-bricks, and join again");
  if (!names.empty())
    throw fileError(folder, "'", folder,
                    "' has files of another division: ", someOf({names.begin(), names.end()}),
                    "; move them away, and join again");
}

// The join of one pyramid; T is the voxel type.
template <typename T>
class Join {
 public:
  Join(const std::string& folder, const PyramidSpec& spec, const SuperBricks& super_bricks,
       const PyramidTables& any, const JoinOptions& options)
      : folder_(folder),
        spec_(spec),
        super_bricks_(super_bricks),
        index_{super_bricks, std::nullopt},
        region_(spec_, index_),
        identity_(identityIn(any)),
        provenance_(any.provenance()),
        plan_(makeBuildPlan(spec_, region_, nullptr, options.memory_bytes,
                            tbb::this_task_arena::max_concurrency())),
        files_(super_bricks.count()) {
    options_.cancel = options.cancel;
    options_.progress = options.progress;
  }

  JoinReport run() {
    const auto begin = PhaseTimes::Clock::now();
    const std::string path = pathIn(folder_, kIndexName);
    PyramidWriter writer(path, spec_, identity_, false, options_.cancel, index_);
    std::unique_ptr<LevelStore> store =
        makeLevelStore<T>(region_, plan_, region_.firstLevel(), folder_);
    ValueRange voxel_range;
    for (std::size_t number = 0; number < files_.size(); ++number) {
      tick("files", number);
      voxel_range.include(takeIn(number, *store));
    }
    BrickClosures closures(region_.layout(), region_.rows());
    LevelMaker<T>(spec_, region_, plan_, options_, folder_, writer, closures, statistics_, times_)
        .run(nullptr, std::move(store));
    for (std::size_t number = 0; number < files_.size(); ++number) {
      tick("ranges", number);
      correct(number, writer);
    }
    publish(writer, closures, voxel_range);
    report_.super_bricks = files_.size();
    report_.bricks += region_.rows().count();
    report_.file_bytes += report_.index_bytes;
    report_.seconds = std::chrono::duration<double>(PhaseTimes::Clock::now() - begin).count();
    return report_;
  }

 private:
  void tick(const char* phase, std::size_t number) const {
    if (options_.cancel != nullptr) options_.cancel->check();
    if (options_.progress)
      options_.progress(phase, static_cast<double>(number) / static_cast<double>(files_.size()));
  }

  std::unique_ptr<PyramidTables> open(std::size_t number) const {
    auto opened = std::make_unique<PyramidTables>(pathIn(folder_, super_bricks_.fileName(number)),
                                                  FileAccess::kRead, RemoteOptions{});
    const PyramidTables& tables = *opened;
    const std::optional<DividedFile>& file = tables.dividedFile();
    if (file && file->number != number)
      tables.fail("is the file of another super-brick; build it again");
    if (!file || file->super_bricks.cells() != super_bricks_.cells() ||
        tables.spec().voxels != spec_.voxels || tables.spec().voxel_type != spec_.voxel_type ||
        tables.spec().values != spec_.values ||
        tables.layout().brickCells() != region_.layout().brickCells() ||
        identityIn(tables) != identity_)
      tables.fail(
          "was built of another input, or with other options, than other files of its folder; "
          "build it again");
    return opened;
  }

  ValueRange takeIn(std::size_t number, LevelStore& store) {
    const std::unique_ptr<PyramidTables> opened = open(number);
    const PyramidTables& tables = *opened;
    const std::vector<std::byte> bytes = tables.divisionBytes();
    HandOverFacts facts;
    const BuildRegion region(spec_, DividedFile{super_bricks_, number});
    if (!takeHandOver<T>(bytes, spec_, region, facts, store, statistics_))
      tables.fail("has a damaged table for the join; build it again");
    // The index is small: that it stays so is worth more than the time to unpack it.
    options_.codec = facts.codec == format::Codec::kStored ? facts.codec : format::Codec::kZstd;
    format::FileEntry& file = files_[number];
    file.file_bytes = tables.header().file_bytes;
    file.header_checksum = tables.header().header_checksum;
    file.brick_table_offset = tables.header().brick_table_offset;
    report_.file_bytes += file.file_bytes;
    report_.bricks += tables.index().count();
    return facts.voxel_range;
  }

  // The closures of a super-brick's bricks, with the coarser levels that have its file's rows not.
  void correct(std::size_t number, PyramidWriter& writer) {
    const std::unique_ptr<PyramidTables> opened = open(number);
    const PyramidTables& tables = *opened;
    const TableRows rows = super_bricks_.rowsOf(number);
    std::vector<ValueRange> ranges;
    for (std::size_t row = 0; row < rows.count(); ++row) {
      const BrickRow stored = tables.index().row(row);
      ranges.push_back({stored.range_min, stored.range_max});
    }
    BrickClosures closures(region_.layout(), rows, ranges);
    const int last = super_bricks_.levels() - 1;
    const IndexBox border = rows.bricks(last);
    std::vector<T> samples;
    for (int level = region_.firstLevel(); level < region_.endLevel(); ++level) {
      const std::int64_t up = level - last;
      if (up > std::countr_zero(static_cast<std::uint64_t>(region_.layout().brickCells())))
        break;  // the file's bricks are smaller than its cells
      const Index3 first = border.first >> up;
      const Index3 end = ((border.end() - Index3(1)) >> up) + Index3(1);
      forEachIndex({first, end - first}, [&](const Index3& brick) {
        const IndexBox box = region_.layout().brickSampleBox(level, brick);
        samples.resize(static_cast<std::size_t>(box.size()));
        writer.readPart(region_.rows().row(level, brick), PartKind::kSamples,
                        samples.size() * sizeof(T), reinterpret_cast<std::byte*>(samples.data()));
        closures.includeInFiner(level, brick, SampleBlock<T>::dense(samples.data(), box));
      });
    }
    std::vector<std::uint32_t> changed;
    std::vector<float> least, greatest;
    for (std::size_t row = 0; row < rows.count(); ++row) {
      const ValueRange& range = closures.all()[row];
      const auto [level, brick] = rows.address(row);
      if (level == last)
        border_ranges_[static_cast<std::size_t>(
            linearIndex(brick, region_.layout().bricks(last)))] = range;
      else if (range != ranges[row]) {
        changed.push_back(static_cast<std::uint32_t>(row));
        least.push_back(range.min);
        greatest.push_back(range.max);
      }
    }
    report_.corrections += changed.size();
    files_[number].correction_count = static_cast<std::uint32_t>(changed.size());
    for (const std::vector<float>& values : {least, greatest})
      for (const float value : values) changed.push_back(std::bit_cast<std::uint32_t>(value));
    files_[number].corrections = writer.append(changed, options_.codec);
  }

  void publish(PyramidWriter& writer, const BrickClosures& closures,
               const ValueRange& voxel_range) {
    PyramidWriter::Summary summary;
    summary.voxel_range = voxel_range;
    summary.brick_ranges = closures.all();
    summary.histogram = statistics_.histogram(spec_.voxel_type, voxel_range);
    std::uint64_t voxels = 0;
    for (const std::uint64_t count : summary.histogram->counts()) voxels += count;
    const auto counts = summary.histogram->counts();
    if (voxels != static_cast<std::uint64_t>(elementCount(spec_.voxels)) || counts.front() == 0 ||
        counts.back() == 0 || closures.all().back() != voxel_range)
      throw fileError(
          folder_, "'", folder_,
          "': what the files of super-bricks count is not of one volume; build them again");
    summary.noise = statistics_.noise();
    summary.gradients = statistics_.gradients(*summary.histogram, voxel_range, spec_.voxels);
    summary.provenance_json = provenance_;
    summary.division = PyramidDivision::table(files_, border_ranges_);
    report_.index_bytes = writer.finish(summary, options_.codec);
  }

  const std::string folder_;
  const PyramidSpec spec_;
  const SuperBricks super_bricks_;
  const DividedFile index_;
  const BuildRegion region_;
  const std::string identity_, provenance_;
  const BuildPlan plan_;
  BuildOptions options_;
  VoxelStatistics statistics_;
  PhaseTimes times_;
  std::vector<format::FileEntry> files_;
  std::vector<ValueRange> border_ranges_{
      static_cast<std::size_t>(elementCount(spec_.layout().bricks(super_bricks_.levels() - 1)))};
  JoinReport report_;
};

}  // namespace

JoinReport joinPyramid(const std::string& folder, const JoinOptions& options) {
  const std::set<std::string> names = superBrickNamesIn(folder);
  const PyramidTables any(pathIn(folder, *names.begin()), FileAccess::kRead, {});
  if (!any.dividedFile() || !any.dividedFile()->number)
    any.fail("is not the file of a super-brick; move it out of the folder");
  const SuperBricks& super_bricks = any.dividedFile()->super_bricks;
  checkNames(folder, super_bricks, names);
  return visitVoxelType(any.spec().voxel_type, [&](auto tag) {
    return Join<typename decltype(tag)::Type>(folder, any.spec(), super_bricks, any, options).run();
  });
}

}  // namespace isobrick
