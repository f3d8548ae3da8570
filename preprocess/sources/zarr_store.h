// The files and groups of a Zarr store: in a folder, behind a URL (zarr_remote.h), or in a zip
// file, through which paths lead as through a folder ("scan.zarr.zip/0/.zarray"). Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/range_reader.h"

namespace isobrick {

class RemoteRanges;
class RemoteStore;

// A zip file with its table of members (APPNOTE.TXT of PKWARE, also of more than 4 GiB), of this
// machine or behind a URL. All members are thread-safe.
class ZipFile {
 public:
  struct Member {
    std::string name;
    std::uint64_t header_offset = 0, packed_bytes = 0, bytes = 0;
    std::uint32_t checksum = 0;  // CRC-32 of the bytes
    std::uint16_t method = 0, flags = 0;
  };

  // Reads the table. Throws Error for a file that is no zip file, or a damaged one.
  explicit ZipFile(const std::string& path);
  // Behind a URL, open. `cancel` may be null, and outlives it.
  ZipFile(const std::string& path, std::shared_ptr<RemoteRanges> ranges, const CancelFlag* cancel);

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  // Null behind a URL.
  const InputFile* file() const { return file_ ? &*file_ : nullptr; }
  const CancelFlag* cancel() const { return cancel_; }
  // A line that changes if it does, behind a URL.
  std::string identity() const;

  // As InputFile. With `stays`, bytes from behind a URL are kept, as they are read again.
  std::size_t readAt(std::uint64_t offset, void* out, std::size_t bytes, bool stays = false) const;
  // Behind a URL, asks for ranges of it that will be read.
  void announce(std::span<const ByteRange> ranges) const;
  // What is read first of a member: its header, or, behind a URL, all of it if it is packed, or is
  // not much and not read in parts.
  ByteRange firstRangeOf(const Member& member, bool in_parts) const;

  // Null if there is none of that name.
  const Member* find(const std::string& name) const;
  // Names below a folder of it ("" is the top), each once.
  std::vector<std::string> childrenOf(const std::string& folder) const;

 private:
  struct Table {
    std::uint64_t offset = 0, bytes = 0, members = 0;
  };
  [[noreturn]] void throwDamaged() const;
  Table findTable() const;
  void readTable(const Table& table);

  std::string path_;
  std::optional<InputFile> file_;
  std::shared_ptr<RemoteRanges> ranges_;  // in place of file_
  const CancelFlag* cancel_ = nullptr;
  std::uint64_t size_ = 0;
  std::vector<Member> members_;        // by name
  std::vector<std::uint64_t> begins_;  // of their headers, sorted, and of the table
  mutable std::mutex mutex_;           // guards the next one
  mutable std::map<std::uint64_t, std::vector<std::byte>> kept_;  // by offset
};

// The zip file that a path leads through, or is; the rest of the path is `inside` it. Null if there
// is none, and behind a URL if no store was entered that leads there. As long as one is held, the
// same path gives the same one, unless the file was changed.
std::shared_ptr<const ZipFile> zipThrough(const std::string& path, std::string& inside);

// The store behind a URL that a path leads through; null for all others, and for paths through a
// zip file.
std::shared_ptr<RemoteStore> remoteStoreOf(const std::string& path);

// As inputIsThere(). Behind a URL: of metadata.
bool storeFileIsThere(const std::string& path);
// The folders below one of the store, by name, in no order, as long as f returns true. Behind a URL
// those that consolidated metadata name.
void visitStoreFolders(const std::string& folder, const std::function<bool(std::string name)>& f);
// Whether it is a zip file with a Zarr store in it, at the top or below.
bool isZarrZip(const std::string& path);

// A file of the store, to be read as an InputFile. A packed member of a zip file is unpacked as a
// whole, and is in memory.
class StoreFile {
 public:
  // Of this machine, or of a zip file; `in_parts`: only some of it is needed.
  explicit StoreFile(const std::string& path, bool in_parts = false);
  // Behind a URL, open. `cancel` may be null, and outlives it.
  StoreFile(const std::string& path, std::shared_ptr<RemoteRanges> ranges,
            const CancelFlag* cancel);

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  // See ZipFile.
  std::size_t readAt(std::uint64_t offset, void* out, std::size_t bytes, bool stays = false) const;
  void announce(std::vector<ByteRange> ranges) const;

 private:
  void openMember(const std::string& name, bool in_parts);

  std::string path_;
  std::optional<InputFile> file_;
  std::shared_ptr<RemoteRanges> ranges_;  // of a file behind a URL
  const CancelFlag* cancel_ = nullptr;
  std::shared_ptr<const ZipFile> zip_;
  std::uint64_t begin_ = 0, size_ = 0;  // in the zip file
  std::vector<std::byte> unpacked_;     // empty: the bytes are in the file
  std::optional<std::uint32_t> checksum_;
};

// The attributes of a group or an array, whichever the version; null if there are none.
nlohmann::json zarrAttributes(const std::string& folder);

// The images of a group's attributes, in either place; null if there are none.
nlohmann::json multiscalesOf(const nlohmann::json& attributes);

// What a group's attributes say of the channels of its image, in the order of its axis.
std::vector<VolumeChannel> namedChannelsOf(const nlohmann::json& attributes);

// A name that leads down from its folder, and nowhere else.
bool leadsDown(const std::string& name);

// `folder` itself if it is an image or an array, and otherwise the one below it: the only one, or
// that with this number, from 0. Images are those that a converter of bio-formats, a well or a
// plate lists; else images and arrays of three and more axes in the folders below. Throws Error
// with a list if there are several and no number, or none.
std::string chooseZarrVolume(const std::string& folder, std::optional<std::int64_t> number);

}  // namespace isobrick
