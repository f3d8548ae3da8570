#include "isobrick/preprocess/sources/zarr_store.h"

#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/zarr_array.h"
#include "isobrick/preprocess/sources/zarr_remote.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/range_reader.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

constexpr std::uint64_t kMostTableBytes = std::uint64_t{1} << 30;
constexpr std::uint64_t kMostUnpackedBytes = std::uint64_t{1} << 30;
constexpr std::string_view kMetadata[] = {"zarr.json", ".zarray", ".zgroup", ".zattrs"};

constexpr std::uint64_t kHeaderBytes = 30;  // of a member, before its name

// Of a file behind a URL.
void readRange(RemoteRanges& ranges, const ByteRange& range, void* out, const std::string& path,
               const CancelFlag* cancel) try {
  ranges.read(range, static_cast<std::byte*>(out));
} catch (const ReadFailure& failure) {
  if (cancel != nullptr) cancel->check();
  throw ResumableError("'" + path + "' " + withAdvice(failure.what(), "run again later"),
                       {.path = path, .offset = range.offset});
}

template <typename T>
T numberAt(const std::vector<std::byte>& bytes, std::size_t at) {
  return loadNumber<T>(bytes.data() + at, false);
}

std::vector<std::byte> readRun(const ZipFile& file, std::uint64_t offset, std::uint64_t bytes) {
  std::vector<std::byte> run(static_cast<std::size_t>(bytes));
  if (file.readAt(offset, run.data(), run.size()) != run.size())
    throw unreadable(file.path(), "the zip file is cut short; get it again");
  return run;
}

std::uint32_t checksumOf(const void* data, std::size_t bytes) {
  return static_cast<std::uint32_t>(crc32_z(0, static_cast<const Bytef*>(data), bytes));
}

bool isZipName(const std::string& name) {
  const std::string lower = lowercase(name);
  return lower.ends_with(".zip") || lower.ends_with(".ozx");
}

}  // namespace

void ZipFile::throwDamaged() const {
  throw unreadable(path_, "the zip file is damaged or cut short; get it again");
}

ZipFile::ZipFile(const std::string& path)
    : path_(path), file_(std::in_place, path), size_(file_->size()) {
  readTable(findTable());
}

ZipFile::ZipFile(const std::string& path, std::shared_ptr<RemoteRanges> ranges,
                 const CancelFlag* cancel)
    : path_(path), ranges_(std::move(ranges)), cancel_(cancel), size_(ranges_->size()) {
  readTable(findTable());
}

std::string ZipFile::identity() const {
  const std::string text = ranges_ == nullptr ? "" : ranges_->identity();
  return concat("zip file ", checksum64(text.data(), text.size()));
}

std::size_t ZipFile::readAt(std::uint64_t offset, void* out, std::size_t bytes, bool stays) const {
  if (file_) return file_->readAt(offset, out, bytes);
  if (offset >= size_) return 0;
  bytes = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, size_ - offset));
  if (stays) {
    const std::lock_guard lock(mutex_);
    const auto found = kept_.find(offset);
    if (found != kept_.end() && found->second.size() == bytes) {
      std::memcpy(out, found->second.data(), bytes);
      return bytes;
    }
  }
  readRange(*ranges_, {offset, bytes}, out, path_, cancel_);
  if (stays) {
    const auto* const begin = static_cast<const std::byte*>(out);
    const std::lock_guard lock(mutex_);
    kept_[offset].assign(begin, begin + bytes);
  }
  return bytes;
}

void ZipFile::announce(std::span<const ByteRange> ranges) const {
  if (ranges_ != nullptr) ranges_->announce(ranges);
}

ByteRange ZipFile::firstRangeOf(const Member& member, bool in_parts) const {
  constexpr std::uint64_t kNotMuch = std::uint64_t{4} << 20;
  const auto next = std::upper_bound(begins_.begin(), begins_.end(), member.header_offset);
  const std::uint64_t all = next == begins_.end() ? 0 : *next - member.header_offset;
  const bool takes_all =
      !file_ && all > kHeaderBytes && ((all <= kNotMuch && !in_parts) || member.method != 0);
  return {member.header_offset, takes_all ? all : kHeaderBytes};
}

// The end record, and in front of it that of a file of more than 4 GiB.
ZipFile::Table ZipFile::findTable() const {
  constexpr std::uint64_t kEndRecord = 22, kLocator = 20, kEndRecord64 = 56, kMostComment = 65535;
  const std::uint64_t tail_bytes = std::min(size_, kEndRecord + kMostComment);
  if (tail_bytes < kEndRecord) throwDamaged();
  const std::uint64_t tail_begin = size_ - tail_bytes;
  const std::vector<std::byte> tail = readRun(*this, tail_begin, tail_bytes);
  std::size_t at = tail.size() - kEndRecord;
  while (numberAt<std::uint32_t>(tail, at) != 0x06054b50 ||
         numberAt<std::uint16_t>(tail, at + 20) != tail.size() - at - kEndRecord)
    if (at-- == 0) throwDamaged();
  Table table{numberAt<std::uint32_t>(tail, at + 16), numberAt<std::uint32_t>(tail, at + 12),
              numberAt<std::uint16_t>(tail, at + 10)};
  if (table.offset == 0xffffffff || table.bytes == 0xffffffff || table.members == 0xffff) {
    const std::uint64_t end = tail_begin + at;
    if (end < kLocator) throwDamaged();
    const auto locator = readRun(*this, end - kLocator, kLocator);
    if (numberAt<std::uint32_t>(locator, 0) != 0x07064b50) throwDamaged();
    const auto place = numberAt<std::uint64_t>(locator, 8);
    if (place > end || end - place < kEndRecord64) throwDamaged();
    const auto record = readRun(*this, place, kEndRecord64);
    if (numberAt<std::uint32_t>(record, 0) != 0x06064b50) throwDamaged();
    table = {numberAt<std::uint64_t>(record, 48), numberAt<std::uint64_t>(record, 40),
             numberAt<std::uint64_t>(record, 32)};
  }
  if (table.offset > size_ || table.bytes > size_ - table.offset || table.bytes > kMostTableBytes)
    throwDamaged();
  return table;
}

void ZipFile::readTable(const Table& table) {
  constexpr std::size_t kRow = 46;
  const std::vector<std::byte> rows = readRun(*this, table.offset, table.bytes);
  if (table.members > rows.size() / kRow) throwDamaged();
  std::size_t at = 0;
  for (std::uint64_t i = 0; i < table.members; ++i) {
    if (rows.size() - at < kRow || numberAt<std::uint32_t>(rows, at) != 0x02014b50) throwDamaged();
    const std::size_t name_bytes = numberAt<std::uint16_t>(rows, at + 28);
    const std::size_t extra_bytes = numberAt<std::uint16_t>(rows, at + 30);
    const std::size_t comment_bytes = numberAt<std::uint16_t>(rows, at + 32);
    if (rows.size() - at - kRow < name_bytes + extra_bytes + comment_bytes) throwDamaged();
    Member member;
    member.flags = numberAt<std::uint16_t>(rows, at + 8);
    member.method = numberAt<std::uint16_t>(rows, at + 10);
    member.checksum = numberAt<std::uint32_t>(rows, at + 16);
    member.packed_bytes = numberAt<std::uint32_t>(rows, at + 20);
    member.bytes = numberAt<std::uint32_t>(rows, at + 24);
    member.header_offset = numberAt<std::uint32_t>(rows, at + 42);
    member.name.assign(reinterpret_cast<const char*>(&rows[at + kRow]), name_bytes);
    // The numbers of 64 bits stand in the extra field, those that have no room in the row.
    const std::size_t extra_end = at + kRow + name_bytes + extra_bytes;
    for (std::size_t field = at + kRow + name_bytes; extra_end - field >= 4;) {
      const std::size_t bytes = numberAt<std::uint16_t>(rows, field + 2);
      std::size_t next = field + 4;
      const std::size_t end = next + bytes;
      if (end > extra_end) break;
      if (numberAt<std::uint16_t>(rows, field) == 1)
        for (std::uint64_t* number : {&member.bytes, &member.packed_bytes, &member.header_offset}) {
          if (*number != 0xffffffff || end - next < 8) continue;
          *number = numberAt<std::uint64_t>(rows, next);
          next += 8;
        }
      field = end;
    }
    at += kRow + name_bytes + extra_bytes + comment_bytes;
    members_.push_back(std::move(member));
  }
  // Of two of one name the later one counts, as for those who unpack it all.
  std::ranges::stable_sort(members_,
                           [](const Member& a, const Member& b) { return a.name < b.name; });
  for (const Member& member : members_) begins_.push_back(member.header_offset);
  begins_.push_back(table.offset);
  std::ranges::sort(begins_);
}

const ZipFile::Member* ZipFile::find(const std::string& name) const {
  const auto behind = std::upper_bound(
      members_.begin(), members_.end(), name,
      [](const std::string& wanted, const Member& member) { return wanted < member.name; });
  if (behind == members_.begin() || std::prev(behind)->name != name) return nullptr;
  return &*std::prev(behind);
}

std::vector<std::string> ZipFile::childrenOf(const std::string& folder) const {
  const std::string prefix = folder.empty() ? "" : folder + "/";
  std::vector<std::string> names;
  auto at = std::lower_bound(
      members_.begin(), members_.end(), prefix,
      [](const Member& member, const std::string& wanted) { return member.name < wanted; });
  for (; at != members_.end() && at->name.starts_with(prefix); ++at) {
    const std::size_t end = at->name.find('/', prefix.size());
    if (end == std::string::npos) continue;
    std::string name = at->name.substr(prefix.size(), end - prefix.size());
    if (names.empty() || names.back() != name) names.push_back(std::move(name));
  }
  return names;
}

std::shared_ptr<const ZipFile> zipThrough(const std::string& path, std::string& inside) {
  std::string file;
  for (std::size_t end = 0; end != std::string::npos;) {
    end = path.find('/', end + 1);
    file = path.substr(0, end);
    if (isZipName(file) && (isRegularFile(file) || isRemotePath(file))) {
      inside = end == std::string::npos ? "" : path.substr(end + 1);
      break;
    }
    file.clear();
  }
  if (file.empty()) return nullptr;
  static std::mutex mutex;
  static std::map<std::string, std::weak_ptr<const ZipFile>> open_files;
  const std::lock_guard lock(mutex);
  std::weak_ptr<const ZipFile>& known = open_files[file];
  if (isRemotePath(file)) {
    auto zip = known.lock();
    const auto store = RemoteStore::through(file);
    if (store == nullptr || (zip != nullptr && zip->cancel() == store->cancel())) return zip;
    constexpr std::uint64_t kEndBytes = std::uint64_t{66} << 10;  // its end record with any comment
    auto ranges = store->open(file, {.bytes = kEndBytes, .is_of_end = true}, false);
    if (ranges == nullptr)
      throw unreadable(file, "the server has no such file (404); check the address");
    zip = std::make_shared<const ZipFile>(file, std::move(ranges), store->cancel());
    known = zip;
    return zip;
  }
  const InputFile now(file);
  if (auto zip = known.lock()) {
    const auto isEqual = [](const std::timespec& a, const std::timespec& b) {
      return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec;
    };
    if (zip->size() == now.size() && isEqual(zip->file()->changedAt(), now.changedAt())) return zip;
  }
  auto zip = std::make_shared<const ZipFile>(file);
  known = zip;
  return zip;
}

std::shared_ptr<RemoteStore> remoteStoreOf(const std::string& path) {
  std::string inside;
  return zipThrough(path, inside) == nullptr ? RemoteStore::through(path) : nullptr;
}

bool storeFileIsThere(const std::string& path) {
  if (const auto store = remoteStoreOf(path)) return store->document(path).has_value();
  std::string inside;
  const auto zip = zipThrough(path, inside);
  return zip == nullptr ? inputIsThere(path) : zip->find(inside) != nullptr;
}

void visitStoreFolders(const std::string& folder, const std::function<bool(std::string)>& f) {
  std::string inside;
  const auto zip = zipThrough(folder, inside);
  const auto store = remoteStoreOf(folder);
  if (zip != nullptr || store != nullptr) {
    for (std::string& name : zip != nullptr ? zip->childrenOf(inside) : store->childrenOf(folder))
      if (!f(std::move(name))) return;
    return;
  }
  visitFolder(folder,
              [&](const FolderMember& member) { return !member.isFolder() || f(member.name()); });
}

bool isZarrZip(const std::string& path) {
  std::string inside;
  const auto zip = zipThrough(path, inside);
  if (zip == nullptr) return false;
  const std::function<bool(const std::string&, int)> holdsOne = [&](const std::string& folder,
                                                                    int depth) {
    const std::string prefix = folder.empty() ? "" : folder + "/";
    for (const std::string_view name : kMetadata)
      if (zip->find(prefix + std::string(name)) != nullptr) return true;
    if (depth == 0) return false;
    const std::vector<std::string> children = zip->childrenOf(folder);
    return std::ranges::any_of(
        children, [&](const std::string& child) { return holdsOne(prefix + child, depth - 1); });
  };
  return holdsOne(inside, 1);
}

StoreFile::StoreFile(const std::string& path, bool in_parts) : path_(path) {
  std::string inside;
  zip_ = zipThrough(path, inside);
  if (zip_ != nullptr) {
    openMember(inside, in_parts);
    return;
  }
  file_.emplace(path);
  size_ = file_->size();
}

StoreFile::StoreFile(const std::string& path, std::shared_ptr<RemoteRanges> ranges,
                     const CancelFlag* cancel)
    : path_(path), ranges_(std::move(ranges)), cancel_(cancel), size_(ranges_->size()) {}

void StoreFile::openMember(const std::string& name, bool in_parts) {
  constexpr std::uint16_t kEncrypted = 1, kStored = 0, kDeflated = 8;
  const auto damaged = [&] { return unreadable(path_, "it is damaged; get the zip file again"); };
  const ZipFile::Member* const member = zip_->find(name);
  if (member == nullptr) throw unreadable(path_, "the zip file does not have it; get it again");
  if ((member->flags & kEncrypted) != 0)
    throw unusable(path_, "it is encrypted; unpack the zip file to a folder");
  if (member->method != kStored && member->method != kDeflated)
    throw unusable(
        path_, "it is packed by method ", member->method,
        ", and isobrick reads 0 (stored) and 8 (deflated); unpack the zip file to a folder");
  const ByteRange first = zip_->firstRangeOf(*member, in_parts);
  std::vector<std::byte> head(static_cast<std::size_t>(first.bytes));
  const bool is_header = first.bytes == kHeaderBytes;
  const bool stays = is_header || std::ranges::any_of(
                                      kMetadata, [&](auto known) { return name.ends_with(known); });
  head.resize(zip_->readAt(first.offset, head.data(), head.size(), stays));
  if (head.size() < kHeaderBytes || numberAt<std::uint32_t>(head, 0) != 0x04034b50) throw damaged();
  const std::uint64_t before =
      kHeaderBytes + numberAt<std::uint16_t>(head, 26) + numberAt<std::uint16_t>(head, 28);
  begin_ = member->header_offset + before;
  if (begin_ > zip_->size() || member->packed_bytes > zip_->size() - begin_) throw damaged();
  size_ = member->bytes;
  if (member->method == kStored) {
    if (member->packed_bytes != member->bytes) throw damaged();
    checksum_ = member->checksum;
    if (is_header) return;
  }
  if (std::max(member->bytes, member->packed_bytes) > kMostUnpackedBytes)
    throw unusable(path_,
                   "it is deflated and has more than 1 GiB; unpack the zip file to a folder");
  std::vector<std::byte> packed;
  if (is_header) {
    packed = readRun(*zip_, begin_, member->packed_bytes);
  } else {
    if (before + member->packed_bytes > head.size()) throw damaged();
    const auto begin = head.begin() + static_cast<std::ptrdiff_t>(before);
    packed.assign(begin, begin + static_cast<std::ptrdiff_t>(member->packed_bytes));
  }
  if (member->method == kStored) {
    unpacked_ = std::move(packed);
  } else {
    unpacked_.resize(static_cast<std::size_t>(size_));
    if (!unpackBlock(BlockCodec::kDeflate, packed, unpacked_).empty()) throw damaged();
  }
  if (!isChecksum(checksumOf(unpacked_.data(), unpacked_.size()), member->checksum))
    throw damaged();
}

void StoreFile::announce(std::vector<ByteRange> ranges) const {
  if (ranges_ != nullptr) return ranges_->announce(ranges);
  if (zip_ == nullptr || !unpacked_.empty()) return;
  for (ByteRange& range : ranges) range.offset += begin_;
  zip_->announce(ranges);
}

std::size_t StoreFile::readAt(std::uint64_t offset, void* out, std::size_t bytes,
                              bool stays) const {
  if (file_) return file_->readAt(offset, out, bytes);
  if (offset >= size_) return 0;
  bytes = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, size_ - offset));
  if (ranges_ != nullptr) {
    readRange(*ranges_, {offset, bytes}, out, path_, cancel_);
    return bytes;
  }
  if (!unpacked_.empty()) {
    std::memcpy(out, unpacked_.data() + offset, bytes);
    return bytes;
  }
  const std::size_t read = zip_->readAt(begin_ + offset, out, bytes, stays);
  if (read == size_ && checksum_ && !isChecksum(checksumOf(out, read), *checksum_))
    throw unreadable(path_, "it fails its checksum; get the zip file again");
  return read;
}

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// What OME-Zarr says of a group, whichever the version.
const Json& omeMember(const Json& attributes, const char* key) {
  const Json& ome = member(attributes, "ome");
  return member(ome.is_object() ? ome : attributes, key);
}

// The metadata of an array; null if the folder is none.
Json arrayOf(const std::string& folder) {
  if (storeFileIsThere(folder + "/zarr.json")) {
    Json json = readZarrJson(folder + "/zarr.json");
    return textOf(member(json, "node_type")) == "array" ? json : Json();
  }
  return storeFileIsThere(folder + "/.zarray") ? readZarrJson(folder + "/.zarray") : Json();
}

// Names below a group, and no more than any store has that was not made for it.
class ZarrVolumes {
 public:
  explicit ZarrVolumes(std::string root) : root_(std::move(root)) { collect("", 0); }

  const std::vector<std::string>& names() const { return names_; }

 private:
  static constexpr std::size_t kMostGroups = 20000;
  static constexpr int kDeepest = 5;

  std::string folderOf(const std::string& name) const {
    return name.empty() ? root_ : root_ + "/" + name;
  }

  void collect(const std::string& name, int depth) {
    if (++groups_ > kMostGroups || depth > kDeepest) return;
    const std::string folder = folderOf(name);
    const Json attributes = zarrAttributes(folder);
    const Json array = arrayOf(folder);
    if (!array.is_null()) {
      if (member(array, "shape").size() >= 3) names_.push_back(name);
    } else if (!multiscalesOf(attributes).is_null()) {
      names_.push_back(name);
    } else {
      for (const std::string& child : childrenOf(folder, attributes))
        collect(name.empty() ? child : name + "/" + child, depth + 1);
    }
  }

  static std::vector<std::string> childrenOf(const std::string& folder, const Json& attributes) {
    std::vector<std::string> names;
    const auto take = [&](const Json& list, const char* key) {
      for (const Json& one : list) {
        std::string name = textOf(key == nullptr ? one : member(one, key));
        if (leadsDown(name)) names.push_back(std::move(name));
      }
    };
    if (!omeMember(attributes, "bioformats2raw.layout").is_null())
      take(omeMember(zarrAttributes(folder + "/OME"), "series"), nullptr);
    take(member(omeMember(attributes, "plate"), "wells"), "path");
    take(member(omeMember(attributes, "well"), "images"), "path");
    take(omeMember(attributes, "labels"), nullptr);
    if (!names.empty()) return names;
    visitStoreFolders(folder, [&](std::string name) {
      names.push_back(std::move(name));
      return names.size() < kMostGroups;
    });
    std::ranges::sort(names, numericNameLess);
    return names;
  }

  std::string root_;
  std::vector<std::string> names_;
  std::size_t groups_ = 0;
};

}  // namespace

Json zarrAttributes(const std::string& folder) {
  if (storeFileIsThere(folder + "/zarr.json"))
    return member(readZarrJson(folder + "/zarr.json"), "attributes");
  if (storeFileIsThere(folder + "/.zattrs")) return readZarrJson(folder + "/.zattrs");
  return {};
}

Json multiscalesOf(const Json& attributes) {
  const Json& list = omeMember(attributes, "multiscales");
  return list.is_array() && !list.empty() ? list : Json();
}

std::vector<VolumeChannel> namedChannelsOf(const Json& attributes) {
  std::vector<VolumeChannel> channels;
  const Json& list = member(omeMember(attributes, "omero"), "channels");
  if (!list.is_array()) return channels;
  for (const Json& channel : list)
    channels.push_back(
        {textOf(member(channel, "label")), parseHexColor(textOf(member(channel, "color")))});
  return channels;
}

bool leadsDown(const std::string& name) {
  if (name.empty() || name.front() == '/' || name.size() > 1000) return false;
  for (const unsigned char c : name)
    if (c < ' ' || c == '\\') return false;
  for (const fs::path& part : fs::path(name))
    if (part == ".." || part == ".") return false;
  return true;
}

std::string chooseZarrVolume(const std::string& folder, std::optional<std::int64_t> number) {
  if (!arrayOf(folder).is_null() || !multiscalesOf(zarrAttributes(folder)).is_null()) return folder;
  const ZarrVolumes volumes(folder);
  const std::vector<std::string>& names = volumes.names();
  if (names.empty())
    throw unusable(folder, "it is a Zarr group with neither an image nor an array of three axes",
                   isRemotePath(folder) ? " that its metadata name" : "",
                   "; name the folder of one");
  if (!number && names.size() > 1)
    throw unusable(folder, "it holds ", names.size(), " images or arrays: ", quotedList(names),
                   "; name one, as in '", folder, "/", names.front(), "'");
  if (number && static_cast<std::uint64_t>(*number) >= names.size())
    throw unusable(folder, "it has no image ", *number, "; it has ", quotedList(names),
                   ", counted from 0");
  return folder + "/" + names[static_cast<std::size_t>(number.value_or(0))];
}

}  // namespace isobrick
