#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/export/formats/format_writers.h"
#include "isobrick/preprocess/export/formats/zarr_chunks.h"
#include "isobrick/preprocess/export/volume_rows.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/share_number.h"

namespace isobrick {
namespace {

// Keys stay in the order in which they are put.
using Json = nlohmann::ordered_json;

constexpr std::array kAxisNames = {"z", "y", "x"};

// Slowest axis first, as Zarr and OME have it.
template <typename V>
Json slowestFirst(const V& v) {
  return {v.z, v.y, v.x};
}

std::string typeName(VoxelType type) {
  return std::array{"|u1", "|i1", "<u2", "<i2", "<f4", "<u8", "<i8", "<u4", "<i4", "<f8"}
      [static_cast<std::size_t>(type)];
}

std::string jsonText(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json arrayOfVersion2(const VolumeInfo& info) {
  return {{"zarr_format", 2},
          {"shape", slowestFirst(info.voxels)},
          {"chunks", slowestFirst(Index3(kZarrChunkVoxels))},
          {"dtype", typeName(info.voxel_type)},
          {"compressor",
           {{"id", "blosc"},
            {"cname", kZarr2Packing.codec},
            {"clevel", kZarr2Packing.level},
            {"shuffle", 1},
            {"blocksize", 0}}},
          {"fill_value", 0},
          {"order", "C"},
          {"filters", nullptr},
          {"dimension_separator", "/"}};
}

Json codecOf(const char* name, Json configuration) {
  return {{"name", name}, {"configuration", std::move(configuration)}};
}

Json arrayOfVersion3(const VolumeInfo& info, const Index3& shard) {
  const auto type_bytes = voxelBytes(info.voxel_type);
  const Json little = codecOf("bytes", {{"endian", "little"}});
  const Json blosc = codecOf("blosc", {{"typesize", type_bytes},
                                       {"cname", kZarr3Packing.codec},
                                       {"clevel", kZarr3Packing.level},
                                       {"shuffle", "shuffle"},
                                       {"blocksize", 0}});
  const Json sharding = codecOf("sharding_indexed",
                                {{"chunk_shape", slowestFirst(Index3(kZarrChunkVoxels))},
                                 {"codecs", Json::array({little, blosc})},
                                 {"index_codecs", Json::array({little, Json{{"name", "crc32c"}}})},
                                 {"index_location", "end"}});
  return {{"zarr_format", 3},
          {"node_type", "array"},
          {"shape", slowestFirst(info.voxels)},
          {"data_type", voxelTypeName(info.voxel_type)},
          {"chunk_grid", codecOf("regular", {{"chunk_shape", slowestFirst(shard)}})},
          {"chunk_key_encoding", codecOf("default", {{"separator", "/"}})},
          {"fill_value", 0},
          {"codecs", Json::array({sharding})},
          {"dimension_names", kAxisNames},
          {"attributes", Json::object()}};
}

Json imageMetadata(const VolumeLevels& levels, bool is_version2) {
  const VolumeInfo& finest = levels.front()->info();
  Json axes = Json::array();
  for (const char* const name : kAxisNames) {
    axes.push_back({{"name", name}, {"type", "space"}});
    if (finest.geometry.unit == LengthUnit::kMillimetre) axes.back()["unit"] = "millimeter";
  }
  Json datasets = Json::array();
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const GridGeometry& geometry = levels[i]->info().geometry;
    datasets.push_back(
        {{"path", std::to_string(i)},
         {"coordinateTransformations",
          {{{"type", "scale"}, {"scale", slowestFirst(geometry.spacing)}},
           {{"type", "translation"}, {"translation", slowestFirst(geometry.origin)}}}}});
  }
  Json columns = Json::array();
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3 column = finest.geometry.direction[axis];
    columns.push_back({column.x, column.y, column.z});
  }
  Json multiscale = {{"name", std::filesystem::path(finest.source).stem().string()},
                     {"axes", axes},
                     {"datasets", datasets}};
  const Json own = {{"space", "LPS"}, {"direction", columns}, {"source", finest.source}};
  if (is_version2) {
    multiscale["version"] = "0.4";
    return {{"multiscales", Json::array({multiscale})}, {"isobrick", own}};
  }
  return {{"ome", {{"version", "0.5"}, {"multiscales", Json::array({multiscale})}}},
          {"isobrick", own}};
}

// Returns their bytes.
std::uint64_t writeDocuments(const Json& documents, AtomicFolder& folder) {
  std::uint64_t bytes = 0;
  for (const auto& [name, document] : documents.items()) {
    const std::string text = jsonText(document);
    folder.makeFolder(std::filesystem::path(name).parent_path().string());
    folder.writeFile(name, text.data(), text.size());
    bytes += text.size();
  }
  return bytes;
}

// The folder of a part, "scan.ome.zarr.part-3-of-8". In place of the metadata it has one document
// with all of them: so nothing takes it for the whole, and parts of other volumes are noticed.
std::string folderOfPart(const std::string& path, std::uint32_t part, std::uint32_t parts) {
  return concat(path, ".part-", part, "-of-", parts);
}
constexpr char kPartDocument[] = "isobrick-part.json";

// Puts the files of the folder, but for those directly in it, into the other one.
void takeFiles(const std::filesystem::path& from, const std::filesystem::path& below,
               AtomicFolder& folder, const CancelFlag* cancel) {
  if (cancel != nullptr) cancel->check();
  const std::error_code error = visitFolder(from / below, [&](const FolderMember& member) {
    const std::filesystem::path name = below / member.name();
    if (member.isFolder())
      takeFiles(from, name, folder, cancel);
    else if (!below.empty())
      folder.takeFile(member.path(), name);
    return true;
  });
  if (error) throw Error(concat("cannot read '", (from / below).string(), "': ", error.message()));
}

// If all parts are there, puts their files into the output, and removes them.
void joinParts(const Json& documents, const std::string& path, std::uint32_t parts,
               const ExportOptions& options, VolumeWriteReport& report) {
  for (std::uint32_t part = 1; part <= parts; ++part) {
    const std::string name = folderOfPart(path, part, parts) + "/" + kPartDocument;
    if (!isRegularFile(name)) {
      report.lost.push_back(concat("this is one of ", parts,
                                   " parts; the run that finds all of them there makes the whole"));
      return;
    }
    std::ifstream file(name, std::ios::binary);
    if (Json::parse(file, nullptr, false) != documents)
      throw unwritable(path, "its part ", part, " of ", parts,
                       " is of another volume, or was written with other options; remove it");
  }
  // Of two runs that find all of them, one does it; if it fails, another may.
  const std::string first = folderOfPart(path, 1, parts) + "/" + kPartDocument;
  const std::string taken = first + ".joined";
  if (std::rename(first.c_str(), taken.c_str()) != 0) return;
  try {
    AtomicFolder folder(path);
    for (std::uint32_t part = 1; part <= parts; ++part)
      takeFiles(folderOfPart(path, part, parts), {}, folder, options.cancel);
    writeDocuments(documents, folder);
    folder.commit(options.cancel);
  } catch (...) {
    std::rename(taken.c_str(), first.c_str());
    throw;
  }
  for (std::uint32_t part = 1; part <= parts; ++part) removeTree(folderOfPart(path, part, parts));
}

}  // namespace

VolumeWriteReport writeOmeZarr(VolumeLevels& levels, const std::string& path,
                               const ExportOptions& options) {
  const bool is_version2 = options.zarr_version == 2;
  VolumeWriteReport report;
  report.space = "LPS";
  if (levels.front()->info().geometry.direction != glm::dmat3(1.0))
    report.lost.push_back(
        "OME-Zarr has no direction; it is kept in the attribute 'isobrick', which other programs "
        "ignore");
  const ShareNumber part = options.zarr_part.value_or(ShareNumber{});
  AtomicFolder folder(options.zarr_part ? folderOfPart(path, part.number, part.of) : path);
  Json documents = Json::object();
  const Json image = imageMetadata(levels, is_version2);
  if (is_version2) {
    documents[".zgroup"] = {{"zarr_format", 2}};
    documents[".zattrs"] = image;
  } else {
    documents["zarr.json"] = {{"zarr_format", 3}, {"node_type", "group"}, {"attributes", image}};
  }
  double total = 0, before = 0;
  for (const auto& level : levels) total += static_cast<double>(volumeBytes(level->info()));
  for (std::size_t i = 0; i < levels.size(); ++i) {
    makeReadBoxes(levels[i], folderOf(folder.temporaryPath()), options);
    const VolumeInfo& info = levels[i]->info();
    const double share = static_cast<double>(volumeBytes(info));
    const std::string level = std::to_string(i);
    const auto tick = [&](double done) {
      if (options.progress) options.progress((before + share * done) / total);
    };
    if (is_version2) {
      documents[level + "/.zarray"] = arrayOfVersion2(info);
      report.bytes += writeZarrChunks(*levels[i], folder, level, options, tick);
    } else {
      documents[level + "/zarr.json"] = arrayOfVersion3(info, zarrShardOf(info, options));
      const auto shards = static_cast<std::size_t>(elementCount(zarrShardsOf(info, options)));
      report.bytes +=
          writeZarrShards(*levels[i], folder, level, options, runOfShare(shards, part), tick);
    }
    before += share;
  }
  report.bytes += writeDocuments(
      options.zarr_part ? Json::object({{kPartDocument, documents}}) : documents, folder);
  publish(folder, options);
  if (options.zarr_part) joinParts(documents, path, part.of, options, report);
  return report;
}

}  // namespace isobrick
