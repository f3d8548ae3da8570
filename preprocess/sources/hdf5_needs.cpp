#include <lzf.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <span>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/hdf5_dataset.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/unpack_block.h"

namespace isobrick {
namespace {

using Byte = unsigned char;

constexpr H5Z_filter_t kLzfFilter = 32000, kBitshuffleFilter = 32008, kZstdFilter = 32015;
// hdf5_source.cpp refuses larger chunks; a header inside one may say anything.
constexpr std::uint64_t kMostUnpackedBytes = std::uint64_t{1} << 30;

// Memory of the library, which takes over what a filter made.
class FilterBuffer {
 public:
  explicit FilterBuffer(std::size_t bytes)
      : bytes_(bytes), data_(static_cast<Byte*>(H5allocate_memory(bytes, false))) {}
  ~FilterBuffer() { H5free_memory(data_); }
  FilterBuffer(const FilterBuffer&) = delete;
  FilterBuffer& operator=(const FilterBuffer&) = delete;

  Byte* data() const { return data_; }
  std::size_t bytes() const { return bytes_; }
  // In place of the packed bytes; returns what a filter returns.
  std::size_t handOver(std::size_t* buffer_bytes, void** buffer) {
    std::swap(*buffer, reinterpret_cast<void*&>(data_));
    *buffer_bytes = bytes_;
    return bytes_;
  }

 private:
  std::size_t bytes_;
  Byte* data_;
};

// Filters return 0 for a failure.
std::size_t unpackZstd(unsigned flags, std::size_t, const unsigned*, std::size_t bytes,
                       std::size_t* buffer_bytes, void** buffer) {
  if ((flags & H5Z_FLAG_REVERSE) == 0) return 0;
  const std::uint64_t content = ZSTD_getFrameContentSize(*buffer, bytes);
  if (content == 0 || content > kMostUnpackedBytes) return 0;  // also what it says of no frame
  FilterBuffer out(content);
  if (out.data() == nullptr || ZSTD_decompress(out.data(), content, *buffer, bytes) != content)
    return 0;
  return out.handOver(buffer_bytes, buffer);
}

// The third parameter of h5py's filter is the size of a chunk.
std::size_t unpackLzf(unsigned flags, std::size_t count, const unsigned* values, std::size_t bytes,
                      std::size_t* buffer_bytes, void** buffer) {
  if ((flags & H5Z_FLAG_REVERSE) == 0 || count < 3 || values[2] == 0 ||
      values[2] > kMostUnpackedBytes)
    return 0;
  FilterBuffer out(values[2]);
  if (out.data() == nullptr ||
      lzf_decompress(*buffer, static_cast<unsigned>(bytes), out.data(), values[2]) != values[2])
    return 0;
  return out.handOver(buffer_bytes, buffer);
}

// Bit b of byte a becomes bit a of byte b.
std::uint64_t transposed(std::uint64_t bits) {
  const auto exchange = [&](std::uint64_t mask, int by) {
    const std::uint64_t differing = (bits ^ (bits >> by)) & mask;
    bits ^= differing ^ (differing << by);
  };
  exchange(0x00aa00aa00aa00aa, 7);
  exchange(0x0000cccc0000cccc, 14);
  exchange(0x00000000f0f0f0f0, 28);
  return bits;
}

// Bitshuffle keeps the first bits of all numbers together, then their second ones, and so on.
void unshuffleBits(const Byte* in, std::size_t numbers, std::size_t number_bytes, Byte* out) {
  const std::size_t row_bytes = numbers / 8;
  for (std::size_t byte = 0; byte < number_bytes; ++byte)
    for (std::size_t group = 0; group < row_bytes; ++group) {
      std::uint64_t bits = 0;
      for (std::size_t bit = 0; bit < 8; ++bit)
        bits |= std::uint64_t{in[(8 * byte + bit) * row_bytes + group]} << (8 * bit);
      bits = transposed(bits);
      for (std::size_t i = 0; i < 8; ++i)
        out[(8 * group + i) * number_bytes + byte] = static_cast<Byte>(bits >> (8 * i));
    }
}

// The parameters of a dataset: version (two), bytes of a number, numbers of a block, packing.
struct BitshuffleFormat {
  enum Packing : unsigned { kNone = 0, kLz4 = 2, kZstd = 3 };

  explicit BitshuffleFormat(std::span<const unsigned> values)
      : number_bytes(values.size() > 2 ? values[2] : 0),
        block_numbers(values.size() > 3 ? values[3] : 0),
        packing(values.size() > 4 ? values[4] : kNone) {
    constexpr std::size_t kUsualBytes = 8192, kLeast = 128;
    if (block_numbers == 0 && number_bytes > 0)
      block_numbers = std::max(kUsualBytes / number_bytes / 8 * 8, kLeast);
  }

  std::size_t number_bytes, block_numbers;
  unsigned packing;
};

// One chunk: whole blocks, a shorter one, and up to seven numbers that stay as they are.
class BitshuffleChunk {
 public:
  BitshuffleChunk(const BitshuffleFormat& format, std::span<const Byte> in)
      : format_(format), in_(in) {
    if (format_.packing == BitshuffleFormat::kNone) {
      out_bytes_ = in.size();
      return;
    }
    // Its own header: bytes of the chunk and of a block.
    const Byte* const header = take(12);
    if (header == nullptr) return;
    out_bytes_ = loadUnsigned(header, 8, true);
    format_.block_numbers =
        format_.number_bytes == 0 ? 0 : loadUnsigned(header + 8, 4, true) / format_.number_bytes;
  }

  // 0 if that is no number of bytes that a chunk has.
  std::size_t unpackedBytes() const {
    const bool is_whole = format_.number_bytes > 0 && format_.block_numbers > 0 &&
                          format_.block_numbers % 8 == 0 && out_bytes_ % format_.number_bytes == 0;
    return is_whole && out_bytes_ <= kMostUnpackedBytes ? out_bytes_ : 0;
  }

  bool unpack(Byte* out) {
    std::size_t numbers = out_bytes_ / format_.number_bytes;
    const FilterBuffer block(std::min(numbers, format_.block_numbers) * format_.number_bytes);
    while (numbers >= 8) {
      const std::size_t count = std::min(numbers, format_.block_numbers) / 8 * 8;
      const std::size_t bytes = count * format_.number_bytes;
      const Byte* const shuffled = takeBlock(bytes, block.data());
      if (shuffled == nullptr) return false;
      unshuffleBits(shuffled, count, format_.number_bytes, out);
      out += bytes;
      numbers -= count;
    }
    const Byte* const rest = take(numbers * format_.number_bytes);
    if (rest == nullptr) return false;
    std::memcpy(out, rest, numbers * format_.number_bytes);
    return true;
  }

 private:
  const Byte* take(std::size_t bytes) {
    if (bytes > in_.size()) return nullptr;
    const Byte* const taken = in_.data();
    in_ = in_.subspan(bytes);
    return taken;
  }

  const Byte* takeBlock(std::size_t bytes, Byte* unpacked) {
    if (format_.packing == BitshuffleFormat::kNone) return take(bytes);
    const Byte* const size = take(4);
    if (size == nullptr || unpacked == nullptr) return nullptr;
    const std::size_t packed_bytes = loadUnsigned(size, 4, true);
    const Byte* const packed = take(packed_bytes);
    if (packed == nullptr) return nullptr;
    const bool is_zstd = format_.packing == BitshuffleFormat::kZstd;
    const std::string fault = unpackBlock(is_zstd ? BlockCodec::kZstd : BlockCodec::kLz4,
                                          std::as_bytes(std::span(packed, packed_bytes)),
                                          std::as_writable_bytes(std::span(unpacked, bytes)));
    return fault.empty() ? unpacked : nullptr;
  }

  BitshuffleFormat format_;
  std::span<const Byte> in_;
  std::size_t out_bytes_ = 0;
};

std::size_t unpackBitshuffle(unsigned flags, std::size_t count, const unsigned* values,
                             std::size_t bytes, std::size_t* buffer_bytes, void** buffer) {
  if ((flags & H5Z_FLAG_REVERSE) == 0) return 0;
  BitshuffleChunk chunk(BitshuffleFormat({values, count}),
                        {static_cast<const Byte*>(*buffer), bytes});
  if (chunk.unpackedBytes() == 0) return 0;
  FilterBuffer out(chunk.unpackedBytes());
  if (out.data() == nullptr || !chunk.unpack(out.data())) return 0;
  return out.handOver(buffer_bytes, buffer);
}

constexpr H5Z_class2_t kOwnFilters[] = {
    {H5Z_CLASS_T_VERS, kLzfFilter, 0, 1, "lzf", nullptr, nullptr, unpackLzf},
    {H5Z_CLASS_T_VERS, kBitshuffleFilter, 0, 1, "bitshuffle", nullptr, nullptr, unpackBitshuffle},
    {H5Z_CLASS_T_VERS, kZstdFilter, 0, 1, "zstd", nullptr, nullptr, unpackZstd}};

bool isThere(H5Z_filter_t filter) {
  if (H5Zfilter_avail(filter) > 0) return true;
  return std::ranges::any_of(kOwnFilters, [&](const H5Z_class2_t& own) {
    return own.id == filter && H5Zregister(&own) >= 0;
  });
}

// Debian's package of a filter's plugin, as the start of a sentence's end.
std::string packageOf(H5Z_filter_t filter) {
  constexpr struct {
    H5Z_filter_t filter;
    const char* package;
  } kPackages[] = {{307, "hdf5-filter-plugin"},
                   {32001, "hdf5-filter-plugin-blosc-serial"},
                   {32004, "hdf5-filter-plugin"},
                   {32013, "hdf5-filter-plugin-zfp-serial"}};
  for (const auto& known : kPackages)
    if (known.filter == filter)
      return std::string("install its plugin (Debian's ") + known.package + ")";
  return "install its plugin (PyPI's hdf5plugin has many) and set HDF5_PLUGIN_PATH to its folder";
}

// Throws Error that says which filter is missing here, and how to get it, unless all chunks of a
// dataset with these properties can be unpacked: by the library, by its plugins, or by isobrick's
// own filters for LZF, Zstandard and Bitshuffle, for which Debian has no plugin, or none that loads
// without MPI. `name` is the dataset's for the message.
void requireFilters(hid_t creation, const std::string& name) {
  const int filters = H5Pget_nfilters(creation);
  for (int i = 0; i < filters; ++i) {
    unsigned flags = 0, config = 0;
    std::size_t values = 0;
    std::array<char, 80> text{};
    const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &values,
                                               nullptr, text.size() - 1, text.data(), &config);
    if (isThere(filter)) continue;
    throw unreadable(name, "its chunks are packed with the filter ", filter, " ",
                     quotedText(text.data(), 60), ", which this machine's HDF5 lacks; ",
                     packageOf(filter), ", or repack with h5repack -f GZIP=1");
  }
}

namespace fs = std::filesystem;

std::string besideOf(const std::string& path, const std::string& name) {
  return (fs::path(path).parent_path() / name).string();
}

class NeedsFinder {
 public:
  NeedsFinder(const std::string& name, const OpenOptions& options)
      : name_(name), options_(options) {}

  struct Place {
    hid_t dataset, file;
    std::string path;  // of the file
    std::string name;  // of the dataset, for messages
  };

  void check(const Place& place, int depth) {
    const Hdf5Handle creation(H5Dget_create_plist(place.dataset), H5Pclose);
    requireFilters(creation.id(), place.name);
    findRawFiles(creation.id(), place.path);
    if (H5Pget_layout(creation.id()) != H5D_VIRTUAL) return;
    constexpr int kMostDepth = 8;
    if (depth == kMostDepth)
      throw unusable(name_, "it is virtual over too many steps; copy it into one dataset");
    checkVirtual(creation.id(), place, depth);
  }

  Hdf5Needs take() { return std::move(needs_); }

 private:
  void checkVirtual(hid_t creation, const Place& place, int depth) {
    std::size_t count = 0;
    H5Pget_virtual_count(creation, &count);
    const auto textOf = [&](auto&& get, std::size_t i) {
      const ssize_t length = get(creation, i, nullptr, 0);
      std::string text(static_cast<std::size_t>(std::max<ssize_t>(length, 0)), '\0');
      if (length > 0) get(creation, i, text.data(), text.size() + 1);
      return text;
    };
    for (std::size_t i = 0; i < count; ++i) {
      options_.checkCancel();
      const std::string file = textOf(H5Pget_virtual_filename, i);
      const std::string dataset = textOf(H5Pget_virtual_dsetname, i);
      if (file.find('%') != std::string::npos || dataset.find('%') != std::string::npos)
        throw unusable(name_, "it takes its voxels from as many files as match ",
                       quotedText(file, 100),
                       ", of which nobody knows whether all are there; copy it into one dataset");
      checkVirtualSource(file, dataset, place, depth);
    }
  }

  // Searches as the library does: beside the file, then in the working directory.
  void checkVirtualSource(const std::string& file, const std::string& dataset, const Place& user,
                          int depth) {
    const bool is_same = file == ".";
    const std::string beside = besideOf(user.path, file);
    const std::string path = is_same ? user.path : inputIsThere(beside) ? beside : file;
    if (!is_same) addFile(path, user.path);
    const Hdf5Handle opened(
        is_same ? H5I_INVALID_HID : H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    const hid_t holder = is_same ? user.file : opened.id();
    const Hdf5Handle found(H5Dopen2(holder, dataset.c_str(), H5P_DEFAULT), H5Dclose);
    if (!found.isValid())
      throw unreadable(path, "it has no dataset ", quotedText(dataset, 100), ", from which '",
                       user.name, "' takes its voxels; get the whole file");
    check({found.id(), holder, path, path + ":" + dataset}, depth + 1);
  }

  // The library searches them in the working directory, unless told that they lie beside.
  void findRawFiles(hid_t creation, const std::string& path) {
    const int count = H5Pget_external_count(creation);
    for (int i = 0; i < count; ++i) {
      std::array<char, 4096> text{};
      H5Pget_external(creation, static_cast<unsigned>(i), text.size() - 1, text.data(), nullptr,
                      nullptr);
      const std::string beside = besideOf(path, text.data());
      if (i == 0) needs_.raw_files_lie_beside = inputIsThere(beside);
      addFile(needs_.raw_files_lie_beside ? beside : text.data(), path);
    }
  }

  void addFile(const std::string& file, const std::string& named_by) {
    auto& files = needs_.files;
    if (std::ranges::find(files, file) != files.end()) return;
    const InputFile check(file, named_by);  // throws the reason why it cannot be opened
    files.push_back(file);
  }

  const std::string& name_;
  const OpenOptions& options_;
  Hdf5Needs needs_;
};

}  // namespace

Hdf5Needs checkHdf5Needs(hid_t dataset, hid_t file, const std::string& path,
                         const std::string& name, const OpenOptions& options) {
  NeedsFinder finder(name, options);
  finder.check({dataset, file, path, name}, 0);
  return finder.take();
}

}  // namespace isobrick
