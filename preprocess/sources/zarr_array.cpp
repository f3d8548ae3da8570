#include "isobrick/preprocess/sources/zarr_array.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "isobrick/preprocess/crc32c.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/range_reader.h"

namespace isobrick {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostZarrAxes = 5;
constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 30;
constexpr std::uint64_t kMostChecksumBytes = 64;  // behind a packed chunk

// A piece of JSON for a line of a message.
std::string quotedJson(const Json& json) {
  return quotedText(json.dump(-1, ' ', true, Json::error_handler_t::replace), 60);
}

template <typename... Parts>
Error damagedStore(const std::string& path, const Parts&... why) {
  return unreadable(path, why..., "; get the whole store again");
}

std::int64_t product(const ZarrArray::Indices& v) {
  std::int64_t result = 1;
  for (const std::int64_t n : v) result *= n;  // checked when they were read
  return result;
}

// 0, 1, ..., count - 1
ZarrArray::Indices allAxes(std::size_t count) {
  ZarrArray::Indices axes(count);
  std::iota(axes.begin(), axes.end(), 0);
  return axes;
}

// Removes the last four bytes; true if they are the checksum of the others.
bool takeChecksum(std::vector<std::byte>& bytes) {
  const auto stated = loadNumber<std::uint32_t>(bytes.data() + bytes.size() - 4, false);
  bytes.resize(bytes.size() - 4);
  return isChecksum(crc32c(bytes), stated);
}

// Those of the specification, and what the numcodecs library adds.
constexpr std::pair<const char*, BlockCodec> kCodecs[] = {
    {"blosc", BlockCodec::kBlosc}, {"gzip", BlockCodec::kZlib},    {"zstd", BlockCodec::kZstd},
    {"zlib", BlockCodec::kZlib},   {"lz4", BlockCodec::kSizedLz4}, {"bz2", BlockCodec::kBz2},
    {"lzma", BlockCodec::kLzma}};

std::optional<BlockCodec> codecNamed(const std::string& name) {
  for (const auto& [known, codec] : kCodecs)
    if (name == known) return codec;
  return std::nullopt;
}

std::string codecNames() {
  ListText names;
  for (const auto& [name, codec] : kCodecs) names.add(name);
  return names.text();
}

// In version 3 the codecs of numcodecs have its name in front.
std::string codecName(const Json& codec) {
  constexpr std::string_view kPrefix = "numcodecs.";
  const std::string name = textOf(codec.is_string() ? codec : member(codec, "name"));
  return name.starts_with(kPrefix) ? name.substr(kPrefix.size()) : name;
}

std::string metadataText(const std::string& path) {
  if (const auto store = remoteStoreOf(path)) {
    if (auto text = store->document(path)) return *std::move(text);
    throw unreadable(path, "the server has no such file; check the address");
  }
  const StoreFile file(path);
  if (file.size() > RemoteStore::kMostDocumentBytes)
    throw unreadable(path, "it has ", file.size(),
                     " bytes, too many for the metadata of a Zarr store; check what it is");
  std::string text(static_cast<std::size_t>(file.size()), '\0');
  text.resize(file.readAt(0, text.data(), text.size()));
  return text;
}

}  // namespace

nlohmann::json readZarrJson(const std::string& path) {
  Json json = parseShallowJson(metadataText(path));
  if (!json.is_object()) throw damagedStore(path, "it is no JSON object");
  return json;
}

ZarrArray::ZarrArray(const std::string& folder) : folder_(folder) {
  std::string inside;
  zip_ = zipThrough(folder, inside);
  remote_ = remoteStoreOf(folder);
  metadata_path_ = folder + "/zarr.json";
  const bool is_version3 = storeFileIsThere(metadata_path_);
  if (!is_version3) metadata_path_ = folder + "/.zarray";
  const Json json = readZarrJson(metadata_path_);
  if (is_version3)
    readVersion3(json);
  else
    readVersion2(json);
  checkSizes();
}

void ZarrArray::refuse(const std::string& reason) const {
  throw unusable(metadata_path_, reason,
                 "; write the array again with what isobrick reads (docs/FORMATS.md)");
}

void ZarrArray::takeShape(const Json& json, const char* key, Indices& out) {
  const Json& list = member(json, key);
  if (!list.is_array() || list.empty() || list.size() > kMostZarrAxes)
    refuse(std::string("its ") + key + " " + quotedJson(list) + " is not a list of 1 to 5 numbers");
  out.clear();
  for (const Json& number : list) {
    if (!number.is_number_unsigned() || number.get<std::uint64_t>() == 0 ||
        number.get<std::uint64_t>() > std::uint64_t{1} << 40)
      refuse(std::string("its ") + key + " " + quotedJson(list) + " is not possible");
    out.push_back(static_cast<std::int64_t>(number.get<std::uint64_t>()));
  }
}

StoredType ZarrArray::typeNamed(const std::string& name) const {
  auto type = storedTypeNamed(name);
  if (name == "bool" || name == "b1") type = StoredType::kUint8;
  if (name.size() == 2 && !type)  // "i4"
    type = storedTypeOf(name[0], static_cast<std::size_t>(name[1] - '0'));
  if (!type)
    refuse("its voxels are of the type " + quotedText(name, 40) +
           ", which is none of the integers and floats that are read");
  return *type;
}

void ZarrArray::setOrder(const Indices& slowest_first) {
  order_ = slowest_first;
  strides_.assign(chunk_.size(), 0);
  std::int64_t stride = 1;
  for (std::size_t i = order_.size(); i-- > 0;) {
    const auto axis = static_cast<std::size_t>(order_[i]);
    strides_[axis] = stride;
    if (__builtin_mul_overflow(stride, chunk_[axis], &stride)) refuse("its chunks are too large");
  }
}

void ZarrArray::setFill(const Json& json) {
  const std::string text = textOf(json);
  if (json.is_number())
    fill_ = json.get<double>();
  else if (json.is_boolean())
    fill_ = json.get<bool>() ? 1 : 0;
  else if (json.is_null())
    fill_ = 0;
  else if (text == "NaN")
    fill_ = std::numeric_limits<double>::quiet_NaN();
  else if (text == "Infinity" || text == "-Infinity")
    fill_ = (text[0] == '-' ? -1 : 1) * std::numeric_limits<double>::infinity();
  else
    refuse("its fill_value " + quotedJson(json) + " is no number");
}

void ZarrArray::takeSeparator(const Json& json, const char* key) {
  const Json& separator = member(json, key);
  if (separator.is_null()) return;
  const std::string text = textOf(separator);
  if (text != "." && text != "/") refuse(std::string("its ") + key + " is neither . nor /");
  separator_ = text[0];
}

void ZarrArray::readVersion2(const Json& json) {
  if (member(json, "zarr_format") != 2) refuse("its zarr_format is not 2");
  takeShape(json, "shape", shape_);
  takeShape(json, "chunks", chunk_);
  outer_ = chunk_;
  stored_ = numpyType(member(json, "dtype"));
  readFilters(member(json, "filters"));
  const Json& compressor = member(json, "compressor");
  if (!compressor.is_null()) {
    const std::string id = textOf(member(compressor, "id"));
    if (const auto codec = codecNamed(id))
      pipeline_.codec = *codec;
    else if (!takeFilter(id, compressor, pipeline_))
      refuse("its compressor " + quotedText(id, 40) + " is not read (" + codecNames() + " are)");
  }
  const std::string order = textOf(member(json, "order"));
  if (order != "C" && order != "F") refuse("its order is neither C nor F");
  Indices axes = allAxes(shape_.size());
  if (order == "F") std::ranges::reverse(axes);
  if (chunk_.size() != shape_.size())
    refuse("its shape and its chunks have different numbers of axes");
  setOrder(axes);
  setFill(member(json, "fill_value"));
  takeSeparator(json, "dimension_separator");
}

// "<i4": the order of its bytes, its kind and its size.
StoredVoxels ZarrArray::numpyType(const Json& name) const {
  const std::string text = textOf(name);
  if (text.size() < 3 || (text[0] != '<' && text[0] != '>' && text[0] != '|'))
    refuse("its dtype " + quotedJson(name) + " is no number");
  StoredVoxels stored;
  stored.type = typeNamed(text.substr(1));
  stored.big_endian = text[0] == '>' && stored.bytes() > 1;
  return stored;
}

void ZarrArray::readFilters(const Json& filters) {
  if (filters.is_null()) return;
  constexpr std::size_t kMostFilters = 4;
  if (!filters.is_array() || filters.size() > kMostFilters)
    refuse("its filters " + quotedJson(filters) + " are not read");
  for (const Json& filter : filters)
    if (!takeFilter(textOf(member(filter, "id")), filter, pipeline_))
      refuse("its filter " + quotedJson(filter) + " is not read (delta, shuffle and bitround are)");
}

// False for a filter that is not read.
bool ZarrArray::takeFilter(const std::string& name, const Json& configuration, Pipeline& pipeline) {
  if (name == "bitround") return true;  // what is left needs nothing
  ZarrFilter filter;
  if (name == "shuffle") {
    const Json& bytes = member(configuration, "elementsize");
    if (!bytes.is_number_unsigned() || bytes.get<std::uint64_t>() == 0 ||
        bytes.get<std::uint64_t>() > 64)
      refuse("the elementsize of its filter shuffle is not possible");
    filter.shuffled_bytes = static_cast<std::size_t>(bytes.get<std::uint64_t>());
  } else if (name == "delta") {
    filter.kind = ZarrFilter::Kind::kDelta;
    filter.unpacked = numpyType(member(configuration, "dtype"));
    const Json& packed = member(configuration, "astype");
    filter.packed = packed.is_null() ? filter.unpacked : numpyType(packed);
    const auto isFloat = [](const StoredVoxels& v) { return infoOf(v.type).name[0] == 'f'; };
    const bool is_same_type = filter.packed.type == filter.unpacked.type;
    if (filter.unpacked.bytes() != stored_.bytes() || !pipeline.filters.empty() ||
        (isFloat(filter.unpacked) && filter.unpacked.bytes() < 4) ||
        (!is_same_type && (isFloat(filter.packed) || isFloat(filter.unpacked))))
      refuse("its filter " + quotedJson(configuration) + " is not read for voxels of its type");
  } else {
    return false;
  }
  pipeline.filters.push_back(filter);
  return true;
}

ZarrArray::Pipeline ZarrArray::readCodecs(const Json& codecs) {
  if (!codecs.is_array() || codecs.empty()) refuse("it has no list of codecs");
  Pipeline pipeline;
  bool has_bytes = false;
  Indices axes = allAxes(chunk_.size());
  for (const Json& codec : codecs) {
    const std::string name = codecName(codec);
    const Json& configuration = member(codec, "configuration");
    if (name == "transpose" && !has_bytes) {
      const Json& order = member(configuration, "order");
      if (!order.is_array() || order.size() != axes.size()) refuse("its transpose has no order");
      Indices permuted;
      std::vector<bool> seen(axes.size(), false);
      for (const Json& axis : order) {
        if (!axis.is_number_unsigned() || axis.get<std::uint64_t>() >= axes.size() ||
            seen[axis.get<std::size_t>()])
          refuse("the order of its transpose is no permutation");
        seen[axis.get<std::size_t>()] = true;
        permuted.push_back(axes[axis.get<std::size_t>()]);
      }
      axes = permuted;
    } else if (name == "bytes" && !has_bytes) {
      has_bytes = true;
      const std::string endian = textOf(member(configuration, "endian"));
      if (stored_.bytes() > 1 && endian != "little" && endian != "big")
        refuse("its bytes have no order");
      stored_.big_endian = endian == "big" && stored_.bytes() > 1;
    } else if (name == "crc32c" && has_bytes) {
      ++(pipeline.codec == BlockCodec::kNone ? pipeline.checksums_before
                                             : pipeline.checksums_after);
    } else if (codecNamed(name) && has_bytes && pipeline.codec == BlockCodec::kNone) {
      pipeline.codec = *codecNamed(name);
    } else if (pipeline.codec != BlockCodec::kNone || pipeline.checksums_before > 0 ||
               !takeFilter(name, configuration, pipeline)) {
      refuse("its codec " + quotedText(name, 40) + " is not read" +
             (shards_.empty() ? "" : " in shards"));
    }
    constexpr std::size_t kMostCodecs = 8;
    if (codecs.size() > kMostCodecs) refuse("it has too many codecs");
  }
  if (!has_bytes) refuse("its codecs make no bytes");
  setOrder(axes);
  return pipeline;
}

// Of chunks, or of smaller shards.
void ZarrArray::readShard(const Json& configuration) {
  Shard shard;
  shard.shape = chunk_;
  takeShape(configuration, "chunk_shape", chunk_);
  if (chunk_.size() != shape_.size()) refuse("its shards have another number of axes");
  for (std::size_t i = 0; i < chunk_.size(); ++i)
    if (shard.shape[i] % chunk_[i] != 0) refuse("its shards are no multiples of their chunks");
  const std::string place = textOf(member(configuration, "index_location"));
  if (place != "" && place != "end" && place != "start") refuse("its index_location is not read");
  shard.index_at_start = place == "start";
  const Json& codecs = member(configuration, "index_codecs");
  const auto nameOf = [&](std::size_t i) {
    return codecs.is_array() && i < codecs.size() ? codecName(codecs[i]) : std::string();
  };
  if (nameOf(0) != "bytes" ||
      textOf(member(member(codecs[0], "configuration"), "endian")) != "little" ||
      codecs.size() > 2 || (codecs.size() == 2 && nameOf(1) != "crc32c"))
    refuse("the codecs of its index are not little-endian bytes with or without crc32c");
  shard.index_has_checksum = codecs.size() == 2;
  constexpr std::size_t kMostShards = 4;
  if (shards_.size() == kMostShards) refuse("its shards are nested too deep");
  shards_.push_back(std::move(shard));
}

void ZarrArray::readVersion3(const Json& json) {
  if (member(json, "zarr_format") != 3) refuse("its zarr_format is not 3");
  if (textOf(member(json, "node_type")) != "array") refuse("it is no array");
  takeShape(json, "shape", shape_);
  const Json& grid = member(json, "chunk_grid");
  if (textOf(member(grid, "name")) != "regular") refuse("its chunk_grid is not regular");
  takeShape(member(grid, "configuration"), "chunk_shape", outer_);
  chunk_ = outer_;
  if (chunk_.size() != shape_.size())
    refuse("its shape and its chunks have different numbers of axes");
  stored_.type = typeNamed(textOf(member(json, "data_type")));
  setFill(member(json, "fill_value"));
  const Json& keys = member(json, "chunk_key_encoding");
  const std::string encoding = textOf(member(keys, "name"));
  if (encoding != "default" && encoding != "v2") refuse("its chunk_key_encoding is not read");
  separator_ = encoding == "default" ? '/' : '.';
  takeSeparator(member(keys, "configuration"), "separator");
  if (encoding == "default") key_prefix_ = std::string("c") + separator_;
  if (const Json& names = member(json, "dimension_names"); names.is_array())
    for (const Json& name : names) axis_names_.push_back(textOf(name));
  if (axis_names_.size() != shape_.size()) axis_names_.clear();
  const Json* codecs = &member(json, "codecs");
  while (codecs->is_array() && !codecs->empty() &&
         codecName(codecs->front()) == "sharding_indexed") {
    if (codecs->size() != 1) refuse("its shards are packed once more, which is not read");
    const Json& configuration = member(codecs->front(), "configuration");
    readShard(configuration);
    codecs = &member(configuration, "codecs");
  }
  pipeline_ = readCodecs(*codecs);
}

void ZarrArray::checkSizes() {
  const auto check = [&](const Indices& counts, std::uint64_t unit, const char* what) {
    std::uint64_t bytes = unit;
    for (const std::int64_t n : counts)
      if (__builtin_mul_overflow(bytes, static_cast<std::uint64_t>(n), &bytes) ||
          bytes > kMostChunkBytes)
        refuse(std::string("its ") + what + " have more than 1 GiB");
  };
  check(chunk_, std::max<std::uint64_t>(stored_.bytes(), voxelBytes(stored_.delivered())),
        "chunks");
  for (std::size_t s = 0; s < shards_.size(); ++s) check(chunksOf(s), 16, "indices of shards");
}

std::size_t ZarrArray::storedChunkBytes() const {
  return static_cast<std::size_t>(product(chunk_)) * stored_.bytes();
}

// As they are packed.
std::size_t ZarrArray::filteredChunkBytes() const {
  std::size_t bytes = storedChunkBytes();
  for (const ZarrFilter& filter : pipeline_.filters) bytes = filter.packedBytes(bytes);
  return bytes;
}

ZarrArray::Indices ZarrArray::chunksOf(std::size_t shard) const {
  const Indices& inner = shard + 1 < shards_.size() ? shards_[shard + 1].shape : chunk_;
  Indices count;
  for (std::size_t i = 0; i < inner.size(); ++i)
    count.push_back(shards_[shard].shape[i] / inner[i]);
  return count;
}

std::uint64_t ZarrArray::chunkBytes() const {
  return static_cast<std::uint64_t>(product(chunk_)) * voxelBytes(stored_.delivered());
}

// Only numbers go into the name: nothing leads out of the folder.
std::string ZarrArray::pathOf(const Indices& outer) const {
  std::string key;
  for (const std::int64_t i : outer) {
    if (!key.empty()) key += separator_;
    key += std::to_string(i);
  }
  return folder_ + "/" + key_prefix_ + key;
}

// A disk may have been removed: then all chunks would be the fill value.
void ZarrArray::throwIfStoreWentAway() const {
  if (remote_ != nullptr ? !remote_->isStillThere(metadata_path_)
                         : !storeFileIsThere(metadata_path_))
    throw ResumableError("cannot read '" + folder_ + "': '" + metadata_path_ +
                             "' is not there any more; run again when it is",
                         {.path = folder_});
}

// The index of a shard, whose bytes are `run` of the file.
ZarrArray::ByteRun ZarrArray::tableOf(const StoreFile& file, std::size_t shard,
                                      const ByteRun& run) const {
  const std::uint64_t bytes = static_cast<std::uint64_t>(product(chunksOf(shard))) * 16 +
                              (shards_[shard].index_has_checksum ? 4 : 0);
  if (run.bytes < bytes) throw damagedStore(file.path(), "it is shorter than the index of a shard");
  return {shards_[shard].index_at_start ? run.offset : run.offset + run.bytes - bytes, bytes};
}

// The part of a shard, whose bytes are `run` of the file, with the chunk of this index; nothing if
// it is not stored.
std::optional<ZarrArray::ByteRun> ZarrArray::findInShard(const StoreFile& file, std::size_t shard,
                                                         ByteRun run, const Indices& index) const {
  const Indices count = chunksOf(shard);
  std::int64_t row = 0;
  for (std::size_t i = 0; i < count.size(); ++i) {
    const std::int64_t inner = shards_[shard].shape[i] / count[i];
    row = row * count[i] + index[i] * chunk_[i] / inner % count[i];
  }
  const ByteRun place = tableOf(file, shard, run);
  std::vector<std::byte> table(static_cast<std::size_t>(place.bytes));
  if (file.readAt(place.offset, table.data(), table.size(), true) != table.size())
    throw damagedStore(file.path(), "it became shorter meanwhile");
  if (shards_[shard].index_has_checksum && !takeChecksum(table))
    throw damagedStore(file.path(), "the index of the shard fails its checksum");
  const ByteRun found = {loadNumber<std::uint64_t>(table.data() + 16 * row, false),
                         loadNumber<std::uint64_t>(table.data() + 16 * row + 8, false)};
  if (found.offset == ~std::uint64_t{0} && found.bytes == ~std::uint64_t{0}) return std::nullopt;
  if (found.offset > run.bytes || found.bytes > run.bytes - found.offset)
    throw damagedStore(file.path(), "its index names bytes behind its end");
  return ByteRun{run.offset + found.offset, found.bytes};
}

// The chunk or shard in a file.
ZarrArray::Indices ZarrArray::outerOf(const Indices& index) const {
  Indices outer;
  for (std::size_t i = 0; i < index.size(); ++i)
    outer.push_back(index[i] / (outer_[i] / chunk_[i]));
  return outer;
}

// Of a file behind a URL: a chunk as a whole, or the index of a shard.
FirstRequest ZarrArray::firstRequest() const {
  if (shards_.empty()) return {.bytes = mostPackedBytes(filteredChunkBytes()) + kMostChecksumBytes};
  const auto rows = static_cast<std::uint64_t>(product(chunksOf(0)));
  return {.bytes = 16 * rows + (shards_[0].index_has_checksum ? 4 : 0),
          .is_of_end = !shards_[0].index_at_start};
}

// Nothing if the store does not have it.
std::optional<StoreFile> ZarrArray::openOuter(const std::string& path) const {
  if (remote_ == nullptr) {
    if (!storeFileIsThere(path)) return std::nullopt;
    return StoreFile(path, !shards_.empty());
  }
  auto ranges = remote_->open(path, firstRequest(), !shards_.empty());
  if (ranges == nullptr) return std::nullopt;
  return StoreFile(path, std::move(ranges), remote_->cancel());
}

void ZarrArray::announce(std::span<const Indices> chunks) const {
  std::map<std::string, std::vector<const Indices*>> files;
  for (const Indices& index : chunks) files[pathOf(outerOf(index))].push_back(&index);
  std::vector<ByteRange> in_zip;
  for (const auto& [path, in_it] : files)
    if (remote_ != nullptr)
      remote_->announce(path, firstRequest());
    else if (const auto* const member = zip_->find(path.substr(zip_->path().size() + 1)))
      in_zip.push_back(zip_->firstRangeOf(*member, !shards_.empty()));
  if (zip_ != nullptr) zip_->announce(in_zip);
  if (shards_.size() != 1) return;  // shards in shards: their indices would be waited for in turn
  const auto allOf = [](const StoreFile& file) { return ByteRun{0, file.size()}; };
  for (const auto& [path, in_it] : files)
    if (const auto file = zip_ != nullptr ? openOuter(path) : std::nullopt) {
      const ByteRun table = tableOf(*file, 0, allOf(*file));
      file->announce({{table.offset, table.bytes}});
    }
  for (const auto& [path, in_it] : files) {
    const auto file = openOuter(path);
    if (!file) continue;
    std::vector<ByteRange> runs;
    for (const Indices* const index : in_it)
      if (const auto run = findInShard(*file, 0, allOf(*file), *index))
        runs.push_back({run->offset, run->bytes});
    file->announce(std::move(runs));
  }
}

bool ZarrArray::readPacked(const std::string& path, const Indices& index,
                           std::vector<std::byte>& out) const {
  const std::optional<StoreFile> file = openOuter(path);
  if (!file) {
    throwIfStoreWentAway();
    return false;
  }
  std::optional<ByteRun> run = ByteRun{0, file->size()};
  for (std::size_t shard = 0; run && shard < shards_.size(); ++shard)
    run = findInShard(*file, shard, *run, index);
  if (!run) return false;
  if (run->bytes > mostPackedBytes(filteredChunkBytes()) + kMostChecksumBytes)
    throw damagedStore(path, "a chunk takes ", run->bytes, " bytes there, and unpacked ",
                       storedChunkBytes());
  out.resize(static_cast<std::size_t>(run->bytes));
  if (file->readAt(run->offset, out.data(), out.size()) != out.size())
    throw damagedStore(path, "it became shorter meanwhile");
  return true;
}

void ZarrArray::unpack(const std::string& path, std::vector<std::byte> packed,
                       std::vector<std::byte>& out) const {
  const auto fail = [&](const std::string& why) { throw damagedStore(path, why); };
  const auto takeChecksums = [&](std::vector<std::byte>& bytes, int count) {
    for (int i = 0; i < count; ++i) {
      if (bytes.size() < 4) fail("it is cut short");
      if (!takeChecksum(bytes)) fail("it fails its checksum");
    }
  };
  takeChecksums(packed, pipeline_.checksums_after);
  out.resize(filteredChunkBytes() + 4 * static_cast<std::size_t>(pipeline_.checksums_before));
  if (const std::string why = unpackBlock(pipeline_.codec, packed, out); !why.empty()) fail(why);
  takeChecksums(out, pipeline_.checksums_before);
  for (std::size_t i = pipeline_.filters.size(); i-- > 0;) {
    std::swap(packed, out);
    // Only the first filter in the order of writing may change the number of bytes.
    undoZarrFilter(pipeline_.filters[i], packed, i == 0 ? storedChunkBytes() : packed.size(), out);
  }
}

bool ZarrArray::readChunk(const Indices& index, std::vector<std::byte>& out) const {
  const std::string path = pathOf(outerOf(index));
  const auto voxels = static_cast<std::size_t>(product(chunk_));
  std::vector<std::byte> packed;
  if (!readPacked(path, index, packed)) {
    out.resize(static_cast<std::size_t>(chunkBytes()));
    visitNumberType(stored_.delivered(), [&](auto tag) {
      using T = typename decltype(tag)::Type;
      const double low = static_cast<double>(std::numeric_limits<T>::lowest());
      const double high = static_cast<double>(std::numeric_limits<T>::max());
      const bool fits = std::is_floating_point_v<T> ||
                        (fill_ >= low && fill_ <= high && fill_ == std::floor(fill_));
      // Only if it is needed: other programs write any value.
      if (!fits) refuse("chunks are missing, and its fill_value is none of its numbers");
      std::fill_n(reinterpret_cast<T*>(out.data()), voxels, static_cast<T>(fill_));
    });
    return false;
  }
  if (stored_.keepsType()) {
    unpack(path, std::move(packed), out);
    stored_.decodeInPlace(out.data(), voxels);
  } else {
    std::vector<std::byte> unpacked;
    unpack(path, std::move(packed), unpacked);
    out.resize(static_cast<std::size_t>(chunkBytes()));
    stored_.decode(unpacked.data(), voxels, out.data());
  }
  return true;
}

std::vector<std::string> ZarrArray::files(const Indices& fixed) const {
  if (zip_ != nullptr) return {zip_->path()};
  constexpr std::int64_t kMostFiles = 20000;
  std::vector<std::string> files = {metadata_path_};
  Indices first(shape_.size(), 0), count(shape_.size(), 1);
  std::int64_t all = 1;
  for (std::size_t i = 0; i < shape_.size(); ++i) {
    if (fixed[i] >= 0)
      first[i] = fixed[i] / outer_[i];
    else
      count[i] = (shape_[i] + outer_[i] - 1) / outer_[i];
    if (__builtin_mul_overflow(all, count[i], &all)) return files;  // no such store can be
  }
  const std::int64_t step = (all + kMostFiles - 1) / kMostFiles;
  for (std::int64_t at = 0; at < all; at += step) {
    Indices outer = first;
    std::int64_t rest = at;
    for (std::size_t i = shape_.size(); i-- > 0;) {
      outer[i] += rest % count[i];
      rest /= count[i];
    }
    std::string path = pathOf(outer);
    if (isPresent(path)) files.push_back(std::move(path));
  }
  return files;
}

}  // namespace isobrick
