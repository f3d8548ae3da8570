#include "isobrick/extract/sinks/zip_writer.h"

#include <zlib.h>

#include <cstring>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Little-endian numbers and text, one behind the other.
class ZipRecord {
 public:
  template <typename... Numbers>
  ZipRecord& put(Numbers... numbers) {
    (putOne(numbers), ...);
    return *this;
  }
  ZipRecord& text(const std::string& text) {
    bytes_ += text;
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  template <typename Number>
  void putOne(Number number) {
    bytes_.append(reinterpret_cast<const char*>(&number), sizeof number);
  }
  std::string bytes_;
};

using U16 = std::uint16_t;
using U32 = std::uint32_t;
using U64 = std::uint64_t;
constexpr U16 kZipVersion = 20, kZip64Version = 45, kDeflate = 8, kUtf8Names = 1 << 11;
constexpr U16 kFirstOfJanuary1980 = 0x21;
// From this number on one stands in the extra field of zip64.
constexpr U32 kInExtra = 0xFFFFFFFF;
constexpr U16 kZip64Extra = 1, kNoExtra = 0x4249;

bool isWide(U64 number) { return number >= kInExtra; }
U32 narrowed(U64 number) { return isWide(number) ? kInExtra : static_cast<U32>(number); }
U16 lengthOf(const std::string& text) { return static_cast<U16>(text.size()); }

}  // namespace

PackedText packText(std::string_view text) {
  PackedText packed;
  packed.plain_bytes = text.size();
  const auto* const plain = reinterpret_cast<const Bytef*>(text.data());
  packed.checksum = static_cast<U32>(crc32_z(0, plain, text.size()));
  z_stream stream = {};
  constexpr int kRawWindow = -15;
  if (deflateInit2(&stream, Z_BEST_SPEED, Z_DEFLATED, kRawWindow, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw Error("zlib has no memory to pack a mesh; write another format");
  // The end of a flush takes a few bytes more.
  packed.bytes.resize(deflateBound(&stream, text.size()) + 16);
  stream.next_in = const_cast<Bytef*>(plain);
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = packed.bytes.data();
  stream.avail_out = static_cast<uInt>(packed.bytes.size());
  const int result = deflate(&stream, Z_SYNC_FLUSH);
  const bool is_whole = result == Z_OK && stream.avail_in == 0 && stream.avail_out > 0;
  packed.bytes.resize(packed.bytes.size() - stream.avail_out);
  deflateEnd(&stream);
  if (!is_whole) throw Error("zlib cannot pack a part of the mesh; write another format");
  return packed;
}

void ZipWriter::beginMember(const std::string& name) {
  Member& member = members_.emplace_back();
  member.name = name;
  member.header_at = file_.position();
  file_.continueFrom(member.header_at + 30 + name.size() + 20);
}

void ZipWriter::add(const PackedText& text) {
  Member& member = members_.back();
  file_.write(text.bytes.data(), text.bytes.size());
  member.packed_bytes += text.bytes.size();
  member.checksum = static_cast<U32>(
      crc32_combine(member.checksum, text.checksum, static_cast<z_off_t>(text.plain_bytes)));
  member.plain_bytes += text.plain_bytes;
}

void ZipWriter::endMember() {
  Member& member = members_.back();
  const unsigned char end[] = {3, 0};  // an empty last block
  file_.write(end, sizeof end);
  member.packed_bytes += sizeof end;
  // The room for large sizes is taken before these are known.
  const bool is_wide = isWide(member.plain_bytes) || isWide(member.packed_bytes);
  ZipRecord header;
  header
      .put(U32{0x04034b50}, is_wide ? kZip64Version : kZipVersion, kUtf8Names, kDeflate, U16{0},
           kFirstOfJanuary1980, member.checksum)
      .put(is_wide ? kInExtra : narrowed(member.packed_bytes))
      .put(is_wide ? kInExtra : narrowed(member.plain_bytes), lengthOf(member.name), U16{20})
      .text(member.name)
      .put(is_wide ? kZip64Extra : kNoExtra, U16{16}, is_wide ? member.plain_bytes : 0,
           is_wide ? member.packed_bytes : 0);
  file_.pwrite(header.bytes().data(), header.bytes().size(), member.header_at);
}

void ZipWriter::finish() {
  const U64 directory_at = file_.position(), count = members_.size();
  ZipRecord directory;
  for (const Member& member : members_) {
    const bool is_wide =
        isWide(member.plain_bytes) || isWide(member.packed_bytes) || isWide(member.header_at);
    const U16 version = is_wide ? kZip64Version : kZipVersion;
    directory
        .put(U32{0x02014b50}, version, version, kUtf8Names, kDeflate, U16{0}, kFirstOfJanuary1980,
             member.checksum)
        .put(is_wide ? kInExtra : narrowed(member.packed_bytes))
        .put(is_wide ? kInExtra : narrowed(member.plain_bytes), lengthOf(member.name))
        .put(static_cast<U16>(is_wide ? 28 : 0), U16{0}, U16{0}, U16{0}, U32{0})
        .put(is_wide ? kInExtra : narrowed(member.header_at))
        .text(member.name);
    if (is_wide)
      directory.put(kZip64Extra, U16{24}, member.plain_bytes, member.packed_bytes,
                    member.header_at);
  }
  const U64 bytes = directory.bytes().size();
  if (isWide(directory_at))
    directory
        .put(U32{0x06064b50}, U64{44}, kZip64Version, kZip64Version, U32{0}, U32{0}, count, count,
             bytes, directory_at)
        .put(U32{0x07064b50}, U32{0}, directory_at + bytes, U32{1});
  directory.put(U32{0x06054b50}, U16{0}, U16{0}, static_cast<U16>(count), static_cast<U16>(count),
                static_cast<U32>(bytes), narrowed(directory_at), U16{0});
  file_.write(directory.bytes().data(), directory.bytes().size());
}

}  // namespace isobrick
