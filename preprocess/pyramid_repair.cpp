#include "isobrick/preprocess/pyramid_repair.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <set>
#include <span>

#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/input_identity.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/pyramid_file_builder.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/torn_pyramid.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

// Of the file that is built beside the old one.
constexpr char kMendingEnding[] = ".isobrick.mending";

// The level table as a part.
format::PartEntry levelTableOf(const format::Header& header) {
  return {header.level_table_offset, header.level_table_checksum,
          static_cast<std::uint32_t>(header.level_count * sizeof(format::LevelRow)), 0};
}

// The line "name=value" of an identity; "" if it has none.
std::string identityValue(const std::string& identity, const std::string& name) {
  const std::size_t line = ("\n" + identity).find("\n" + name + "=");
  if (line == std::string::npos) return {};
  const std::size_t begin = line + name.size() + 1;
  return identity.substr(begin, identity.find('\n', begin) - begin);
}

class Repair {
 public:
  Repair(const std::string& path, const RepairOptions& options)
      : options_(options),
        torn_(path, options.memory_bytes / 2),
        provenance_(parseShallowJson(torn_.provenance())),
        lost_(torn_.lostBricks(options.cancel)) {}

  RepairReport run() {
    if (!torn_.sourceFailure().empty()) report_.losses.push_back(torn_.sourceFailure());
    for (std::size_t number = 0; number < torn_.files().size(); ++number) {
      const TornFile& file = torn_.files()[number];
      if (!torn_.superBricks())
        mend(file, std::nullopt);
      else if (!isWhole(file))
        mend(file, DividedFile{*torn_.superBricks(), number});
    }
    if (torn_.superBricks()) join();
    return std::move(report_);
  }

 private:
  bool isLost() const { return !lost_ || !lost_->empty(); }

  // Of a file, but for what its histogram, gradients and kinds of earlier programs hold.
  static bool isWhole(const TornFile& file) {
    if (!file.header() || file.isCorrected() || file.provenance().empty()) return false;
    const format::Header& header = *file.header();
    std::map<std::uint64_t, std::uint64_t> used = {{0, sizeof header}};  // the end by the begin
    used[header.brick_table_offset] = header.brick_table_offset + file.tableBytes();
    used[header.provenance_offset] = header.provenance_offset + header.provenance_bytes;
    std::vector<std::byte> bytes;
    const auto isSound = [&](const format::PartEntry& part) {
      if (part.stored_bytes > 0) used[part.offset] = part.offset + part.stored_bytes;
      return file.read(part, bytes);
    };
    bool is_whole = file.size() == header.file_bytes && file.rowCount() == header.brick_count;
    for (std::size_t row = 0; row < file.rowCount(); ++row) {
      const BrickRow known = file.row(row);
      is_whole = is_whole && file.isKnown(row) &&
                 std::ranges::all_of(known.parts, [&](const format::PartEntry& part) {
                   return !isInFile(part) || isSound(part);
                 });
    }
    for (const format::PartEntry& part :
         {levelTableOf(header), header.histogram, header.gradients, header.division})
      is_whole = is_whole && (part.stored_bytes == 0 || isSound(part));
    std::uint64_t at = 0;
    for (const auto& [begin, end] : used) {
      is_whole = is_whole && (begin <= at || file.hasZerosAlone(at, begin - at));
      at = std::max(at, end);
    }
    return is_whole;
  }

  // Null if there is none. Throws Error if it is not that of the pyramid.
  std::unique_ptr<VolumeSource> openSource() const {
    if (!options_.open_source) return nullptr;
    auto source = options_.open_source(textOf(member(provenance_, "source")));
    if (source == nullptr) return nullptr;
    const PyramidSpec& spec = torn_.spec();
    VolumeInfo chosen;
    chosen.voxel_type = spec.voxel_type;
    chosen.values = spec.values;
    source->chooseVoxelsAs(chosen);
    const VolumeInfo& info = source->info();
    const GridGeometry& grid = info.geometry;
    const char* other = nullptr;
    if (grid.origin != spec.geometry.origin || grid.direction != spec.geometry.direction)
      other = "place";
    if (grid.spacing != spec.geometry.spacing) other = "spacing";
    if (info.values != spec.values) other = "scale of values";
    if (info.voxel_type != spec.voxel_type) other = "type of voxels";
    if (info.voxels != spec.voxels) other = "number of voxels";
    if (other != nullptr)
      throw fileError(info.source, "'", info.source, "' has another ", other,
                      " than the volume that the pyramid was made of; name that one");
    return source;
  }

  BuildOptions buildOptions() const {
    const std::string identity = textOf(member(provenance_, "identity"));
    BuildOptions options = buildOptionsOf(torn_.spec());
    options.codec = codecOf(identityValue(identity, "codec"));
    const auto nan_as = parseShallowJson(identityValue(identity, "nan_as"));
    if (nan_as.is_number() && std::isfinite(nan_as.get<float>()))
      options.nan_as = nan_as.get<float>();
    options.mask_nan = options.mask_nan || identityValue(identity, "mask_nan") == "yes";
    if (torn_.superBricks()) options.super_cells = torn_.superBricks()->cells();
    options.tool_version = options_.tool_version;
    options.memory_bytes = options_.memory_bytes;
    options.keep_unfinished = false;
    options.cancel = options_.cancel;
    options.progress = options_.progress;
    return options;
  }

  // By its name, or else that of any part which is packed.
  format::Codec codecOf(const std::string& name) const {
    using enum format::Codec;
    for (const format::Codec codec : {kStored, kLz4, kZstd})
      if (name == codecName(codec)) return codec;
    for (const format::Codec codec : {kLz4, kZstd})
      for (const TornFile& file : torn_.files()) {
        const auto isOf = [&](const format::PartEntry& part) {
          return part.codec == static_cast<std::uint32_t>(codec);
        };
        if (file.header() && isOf(file.header()->histogram)) return codec;
        for (std::size_t row = 0; row < file.rowCount(); ++row)
          if (const BrickRow known = file.row(row);
              file.isKnown(row) && std::ranges::any_of(known.parts, isOf))
            return codec;
      }
    return kStored;
  }

  // The text in the file itself, or in another one of the pyramid.
  const std::string& provenanceOf(const TornFile& file) const {
    return file.provenance().empty() ? torn_.provenance() : file.provenance();
  }

  void build(VolumeSource& source, const TornFile& file,
             const std::optional<DividedFile>& divided) {
    mended_.reset();
    InputWatch input(source, options_.cancel);
    buildPyramidFile(source, input, file.path() + kMendingEnding, buildOptions(), divided,
                     provenanceOf(file));
    mended_.emplace(file.path(), AtomicFile::Leftover::kKeep, kMendingEnding);
  }

  // The source alone: together with old bricks it would not show that it is another one.
  bool mendFromSource(const TornFile& file, const std::optional<DividedFile>& divided) try {
    const std::unique_ptr<VolumeSource> source = openSource();
    if (source == nullptr) return false;
    build(*source, file, divided);
    if (publishIfProved(file, divided)) return true;
    throw fileError(source->info().source, "'", source->info().source,
                    "' has other voxels than the volume that the pyramid was made of, or another "
                    "version of the program made it; name that volume, or build it again");
  } catch (const Cancelled&) {
    throw;
  } catch (const ResumableError&) {
    throw;
  } catch (const Error& error) {
    report_.losses.emplace_back(error.what());
    return false;
  }

  void mend(const TornFile& file, const std::optional<DividedFile>& divided) {
    const bool has_provenance = !provenanceOf(file).empty();
    if (!has_provenance && torn_.spec().level0 != Level0Place::kStored) {
      report_.losses.push_back(concat("'", file.path(),
                                      "' is an index that has lost its provenance, and with it the "
                                      "place of its finest level; build it again"));
      return;
    }
    if ((isLost() || !has_provenance) && mendFromSource(file, divided)) return;
    if (!lost_) {
      report_.losses.push_back(concat("'", file.path(),
                                      "' has lost its brick table, and all bricks with it; name "
                                      "the volume that it was made of"));
      return;
    }
    // An index is told from its source's name to be of files or of a server.
    TornVolume volume(torn_,
                      torn_.spec().level0 == Level0Place::kBehindUrl ? "https://" : file.path());
    build(volume, file, divided);
    if (lost_->empty() && publishIfProved(file, divided)) return;
    nameLost();
    patch(file);
    if (lost_->empty() && !isWhole(TornFile(file.path())))
      report_.losses.push_back(concat("'", file.path(),
                                      "' has parts that this version of the program makes "
                                      "otherwise, or lost its rows of them; build it again"));
  }

  void nameLost() {
    if (!report_.lost.empty()) return;
    for (const std::int64_t number : *lost_) {
      const Index3 brick = indexAt(number, torn_.layout().bricks(0));
      report_.lost.push_back({brick, torn_.layout().brickOwnSamples(0, brick)});
    }
  }

  // Whether the file of the old one's name would have all that is whole of it.
  bool isProved(const TornFile& file, const std::optional<DividedFile>& divided,
                const TornFile& mended) const {
    if (!mended.header()) return false;
    if (!file.header())
      return headerChecksumInIndex(*divided->number) == mended.header()->header_checksum;
    format::Header old = *file.header(), now = *mended.header();
    if (file.provenance().empty())
      for (format::Header* const header : {&old, &now}) {
        header->file_bytes = header->provenance_bytes = header->provenance_checksum = 0;
        header->header_checksum = 0;
      }
    if (std::memcmp(&old, &now, sizeof old) != 0) return false;
    for (std::size_t row = 0; row < file.rowCount(); ++row)
      if (file.isKnown(row) && !std::ranges::equal(file.rowBytes(row), mended.rowBytes(row)))
        return false;
    return true;
  }

  // Nothing if the index is damaged.
  std::optional<std::uint64_t> headerChecksumInIndex(std::size_t number) const {
    std::vector<std::byte> table;
    format::FileEntry entry;
    if (!torn_.index()->header() ||
        !torn_.index()->read(torn_.index()->header()->division, table) ||
        table.size() < (number + 1) * sizeof entry)
      return std::nullopt;
    std::memcpy(&entry, table.data() + number * sizeof entry, sizeof entry);
    return entry.header_checksum;
  }

  bool publishIfProved(const TornFile& file, const std::optional<DividedFile>& divided) {
    const TornFile mended(mended_->temporaryPath());
    if (!isProved(file, divided, mended)) return false;
    publish(file, *mended_);
    if (file.header() && file.header()->provenance_checksum != mended.header()->provenance_checksum)
      report_.losses.push_back(concat("'", file.path(),
                                      "' has lost its provenance, and has that of its repair now; "
                                      "all else is as it was"));
    return true;
  }
  void publish(const TornFile& file, AtomicFile& mended) {
    if (file.size() > 0) static_cast<void>(fchmod(mended.fd(), file.mode()));
    mended.commit(options_.cancel);
    report_.mended.push_back(file.path());
  }

  // A copy of the file with parts of the one that was built now.
  void patch(const TornFile& file) {
    if (!file.header()) return;
    const TornFile mended(mended_->temporaryPath());
    const format::Header& header = *file.header();
    AtomicFile copy(file.path());
    std::vector<std::byte> bytes(std::size_t{1} << 20);
    for (std::uint64_t at = 0; at < file.size(); at += bytes.size()) {
      if (options_.cancel != nullptr) options_.cancel->check();
      copy.pwrite(bytes.data(), readBytesAt(file.fd(), at, bytes.data(), bytes.size()).bytes, at);
    }
    bool is_better = file.isCorrected();
    const auto put = [&](const format::PartEntry& old, const format::PartEntry& now) {
      if (old.stored_bytes == 0 || file.read(old, bytes) || now.checksum != old.checksum ||
          now.stored_bytes != old.stored_bytes || !mended.read(now, bytes))
        return;
      copy.pwrite(bytes.data(), bytes.size(), old.offset);
      is_better = true;
    };
    for (std::size_t row = 0; row < file.rowCount(); ++row) {
      if (!file.isKnown(row)) continue;
      const std::span<const std::byte> own = file.rowBytes(row);
      copy.pwrite(own.data(), own.size(), header.brick_table_offset + row * own.size());
      const BrickRow old = file.row(row), now = mended.row(row);
      for (const PartKind kind : kPartKinds)
        if (isInFile(old.part(kind))) put(old.part(kind), now.part(kind));
    }
    put(header.histogram, mended.header()->histogram);
    put(header.gradients, mended.header()->gradients);
    put(header.division, mended.header()->division);
    put(levelTableOf(header), levelTableOf(*mended.header()));
    copy.pwrite(file.provenance().data(), file.provenance().size(), header.provenance_offset);
    copy.pwrite(&header, sizeof header, 0);
    copy.continueFrom(header.file_bytes);
    copy.cutAfterPosition();
    if (is_better) publish(file, copy);
  }

  void join() try {
    const std::string& index = torn_.index()->path();
    joinPyramid(folderOf(index), {options_.memory_bytes, options_.cancel, options_.progress});
    report_.mended.push_back(index);
  } catch (const Cancelled&) {
    throw;
  } catch (const Error& error) {
    report_.losses.emplace_back(error.what());
  }

  const RepairOptions& options_;
  const TornPyramid torn_;
  const nlohmann::json provenance_;
  const std::optional<std::set<std::int64_t>> lost_;
  RepairReport report_;
  std::optional<AtomicFile> mended_;  // of the last build: goes with this object
};

}  // namespace

RepairReport repairPyramid(const std::string& path, const RepairOptions& options) {
  return Repair(path, options).run();
}

}  // namespace isobrick
