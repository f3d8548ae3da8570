#include "isobrick/preprocess/sources/stored_array.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <utility>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/byte_stream.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"

namespace isobrick {
namespace {

using Form = NumberFiles::Form;

std::shared_ptr<const InputFile> openNumbers(const NumberFiles& files, const std::string& path) {
  return std::make_shared<const InputFile>(path,
                                           path == files.header_path ? "" : files.header_path);
}

// The characters of a file one by one.
class CharacterReader {
 public:
  CharacterReader(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : file_(std::move(file)), at_(offset) {}

  // The next one, or -1 at the end.
  int next() {
    if (next_ == filled_) {
      filled_ = file_->readAt(at_, text_.data(), text_.size());
      at_ += filled_;
      next_ = 0;
      if (filled_ == 0) return -1;
    }
    return static_cast<unsigned char>(text_[next_++]);
  }
  // Of the next character.
  std::uint64_t offset() const { return at_ - (filled_ - next_); }
  const std::string& path() const { return file_->path(); }

 private:
  std::shared_ptr<const InputFile> file_;
  std::uint64_t at_;
  std::array<char, 16 << 10> text_;
  std::size_t next_ = 0, filled_ = 0;
};

std::uint64_t behindLines(const std::shared_ptr<const InputFile>& file, const NumberFiles& files) {
  CharacterReader reader(file, files.first_byte);
  std::uint64_t lines = files.skipped_lines;
  while (lines > 0) {
    const int character = reader.next();
    if (character < 0)
      throw unreadable(file->path(),
                       "it has fewer lines than its header skips; correct the header");
    if (character == '\n') --lines;
  }
  return reader.offset();
}

// Two digits a byte; other characters mean nothing.
class HexStream final : public ByteStream {
 public:
  HexStream(std::shared_ptr<const InputFile> file, std::uint64_t offset)
      : reader_(std::move(file), offset) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* const to = static_cast<std::byte*>(out);
    for (std::size_t got = 0; got < bytes; ++got) {
      const int high = nextDigit(), low = high < 0 ? -1 : nextDigit();
      if (low < 0) return got;
      to[got] = static_cast<std::byte>(high << 4 | low);
    }
    return bytes;
  }
  std::uint64_t bufferBytes() const override { return sizeof *this; }

 private:
  int nextDigit() {
    for (int c = reader_.next(); c >= 0; c = reader_.next()) {
      if (c >= '0' && c <= '9') return c - '0';
      if (c >= 'a' && c <= 'f') return c - 'a' + 10;
      if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    }
    return -1;
  }

  CharacterReader reader_;
};

// Half a byte a number, the lower half first; each row begins with a byte of its own.
class NibbleStream final : public ByteStream {
 public:
  NibbleStream(std::shared_ptr<const InputFile> file, std::uint64_t offset, std::uint64_t row)
      : reader_(std::move(file), offset), row_(row) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* const to = static_cast<std::uint8_t*>(out);
    for (std::size_t got = 0; got < bytes; ++got, ++at_) {
      const std::uint64_t x = at_ % row_;
      if (x % 2 == 0) pair_ = reader_.next();
      if (pair_ < 0) return got;
      to[got] = static_cast<std::uint8_t>(x % 2 == 0 ? pair_ & 15 : pair_ >> 4);
    }
    return bytes;
  }

 private:
  CharacterReader reader_;
  std::uint64_t row_;
  std::uint64_t at_ = 0;  // of the next number
  int pair_ = 0;
};

// The content of one file, with nothing skipped but lines.
std::unique_ptr<ByteStream> contentStream(const NumberFiles& files,
                                          std::shared_ptr<const InputFile> file,
                                          std::uint64_t offset, StoredType type,
                                          std::uint64_t numbers) {
  const std::string path = file->path();
  switch (files.form) {
    case Form::kGzip:
      return makeInflateStream(path, makeFileStream(std::move(file), offset));
    case Form::kBzip2:
      return makeBunzipStream(path, makeFileStream(std::move(file), offset));
    case Form::kText:
      return makeTextNumbers(std::move(file), offset, type, numbers);
    case Form::kHex:
      return std::make_unique<HexStream>(std::move(file), offset);
    case Form::kNibbles:
      return std::make_unique<NibbleStream>(std::move(file), offset, files.row_numbers);
    case Form::kBytes:
      break;
  }
  return makeFileStream(std::move(file), offset);
}

// A share of each file, one behind the other; one file is open at a time.
class NumberStream final : public ByteStream {
 public:
  NumberStream(NumberFiles files, StoredType type, std::uint64_t bytes)
      : files_(std::move(files)), type_(type), share_bytes_(bytes / files_.paths.size()) {}

  std::size_t read(void* out, std::size_t bytes) override {
    auto* to = static_cast<std::byte*>(out);
    std::size_t got = 0;
    while (got < bytes && (left_ > 0 || openNext())) {
      const auto part = static_cast<std::size_t>(std::min<std::uint64_t>(left_, bytes - got));
      const std::size_t read = content_->read(to + got, part);
      got += read;
      left_ -= read;
      if (read == part) continue;
      if (files_.paths.size() == 1) break;  // the source has a message of its own
      throw tooShort(share_bytes_ - left_);
    }
    return got;
  }

  void finish() override {
    if (content_ != nullptr) content_->finish();
  }
  std::uint64_t bufferBytes() const override {
    constexpr std::uint64_t kUnpackBytes = 320 << 10;  // of gzip, and of text
    constexpr std::uint64_t kBunzipBytes = 4 << 20;
    return files_.form == Form::kBzip2 ? kBunzipBytes : kUnpackBytes;
  }

 private:
  Error tooShort(std::uint64_t have) const {
    return unreadable(files_.paths[next_ - 1], "it has ", have,
                      " bytes of numbers, and the header '", files_.header_path, "' needs ",
                      share_bytes_, "; get the whole file again");
  }

  bool openNext() {
    if (next_ == files_.paths.size()) return false;
    const std::string& path = files_.paths[next_++];
    const auto file = openNumbers(files_, path);
    const std::uint64_t offset = behindLines(file, files_);
    std::uint64_t skipped =
        static_cast<std::uint64_t>(std::max<std::int64_t>(files_.skipped_bytes, 0));
    if (files_.skipped_bytes == NumberFiles::kAllBefore) {
      const std::uint64_t have =
          files_.form == Form::kBytes
              ? file->size() - offset
              : skipBytes(*contentStream(files_, file, offset, type_, UINT64_MAX), UINT64_MAX);
      if (have < share_bytes_) throw tooShort(have);
      skipped = have - share_bytes_;
    }
    const bool is_packed = files_.form != Form::kBytes && files_.form != Form::kNibbles;
    content_ = contentStream(files_, file, offset + (is_packed ? 0 : skipped), type_,
                             (skipped + share_bytes_) / storedBytes(type_));
    if (is_packed) skipBytes(*content_, skipped);
    left_ = share_bytes_;
    return true;
  }

  NumberFiles files_;
  StoredType type_;
  std::uint64_t share_bytes_;
  std::size_t next_ = 0;  // of files_.paths
  std::unique_ptr<ByteStream> content_;
  std::uint64_t left_ = 0;  // bytes of the share
};

// All numbers, as `bytes` of the type `type`: of text in little-endian order, otherwise as they are
// stored. Throws Error that names the file and the byte if one ends early or is damaged.
std::unique_ptr<ByteStream> makeNumberStream(const NumberFiles& files, StoredType type,
                                             std::uint64_t bytes) {
  // Whatever is missing is missed before the first number is read.
  for (const std::string& path : files.paths) {
    const auto file = openNumbers(files, path);
    const std::uint64_t needed = files.first_byte + bytes / files.paths.size();
    if (files.form == Form::kBytes && file->size() < needed)
      throw unreadable(path, "it has ", file->size(), " bytes, and the header '", files.header_path,
                       "' needs ", needed, "; get the whole file again");
  }
  return std::make_unique<NumberStream>(files, type, bytes);
}

}  // namespace

std::vector<std::string> NumberFiles::all() const {
  std::vector<std::string> files;
  if (paths.front() != header_path) files.push_back(header_path);
  files.insert(files.end(), paths.begin(), paths.end());
  return files;
}

std::optional<std::uint64_t> NumberFiles::offsetOfBytes(std::uint64_t bytes) const {
  if (form != Form::kBytes || paths.size() != 1) return std::nullopt;
  const auto file = openNumbers(*this, paths.front());
  const std::uint64_t lines = behindLines(file, *this);
  const std::uint64_t have = file->size();
  const auto skipped = static_cast<std::uint64_t>(std::max<std::int64_t>(skipped_bytes, 0));
  if (have < lines || have - lines < skipped || have - lines - skipped < bytes)
    throw unreadable(paths.front(), "it has ", have, " bytes, and its header",
                     paths.front() == header_path ? "" : " '" + header_path + "'", " needs ", bytes,
                     " behind byte ", lines + skipped, "; get the whole file again");
  return skipped_bytes == kAllBefore ? have - bytes : lines + skipped;
}

namespace {

using Use = StoredAxis::Use;

// What is chosen of an array: an index of each axis that is not of space.
struct ArrayChoice {
  std::vector<std::uint64_t> indices;     // 0 for axes of space
  std::optional<std::size_t> value_axis;  // of several values
  std::uint64_t values = 1;               // along it
  OpenOptions options;                    // with the choice of one of them
};

class ArrayChooser {
 public:
  ArrayChooser(const StoredArray& array, const OpenOptions& options, VolumeInfo& info)
      : array_(array), info_(info) {
    choice_.options = options;
    choice_.indices.resize(array.axes.size());
  }

  ArrayChoice choose() {
    OpenOptions& options = choice_.options;
    for (std::size_t i = 0; i < array_.axes.size(); ++i) {
      const StoredAxis& axis = array_.axes[i];
      if (axis.size == 1) continue;
      if (axis.use == Use::kTime) {
        choice_.indices[i] = stepOf(axis.size, "time step", options.time, 0);
        info_.time_step = {static_cast<std::int64_t>(choice_.indices[i]), axis.size};
      }
      if (axis.use == Use::kImages)
        choice_.indices[i] = stepOf(axis.size, "image", options.image, std::nullopt);
      if (axis.use == Use::kValues || axis.use == Use::kUnnamed) takeValues(i);
    }
    refuseUnused(options.time, "time steps");
    refuseUnused(options.image, "images");
    // An axis that is not there has the index 0.
    if (choice_.values == 1 && options.channel.value_or(1) == 0) options.channel.reset();
    // What one program calls a component is a channel for another.
    if (!options.component && options.channel) {
      options.component = ComponentChoice{.index = *options.channel};
      info_.channel = {*options.channel, static_cast<std::int64_t>(choice_.values)};
    }
    if (!options.component && is_unnamed_ && unnamed_time_)
      options.component = ComponentChoice{.index = *unnamed_time_};
    checkComponentChoice(info_.source, choice_.values, options);
    return std::move(choice_);
  }

 private:
  // Takes the choice away, so that what is left was not used.
  std::uint64_t stepOf(std::int64_t count, const std::string& one,
                       std::optional<std::int64_t>& given, std::optional<std::int64_t> otherwise) {
    const std::string all =
        "it has " + std::to_string(count) + " " + one + "s, 0 to " + std::to_string(count - 1);
    const auto wanted = given ? std::exchange(given, std::nullopt) : otherwise;
    if (!wanted) throw unusable(info_.source, all, "; choose one", Remedy::kChooseImage);
    const std::int64_t step = *wanted;
    if (step < 0 || step >= count) throw unusable(info_.source, all, ", and none is number ", step);
    info_.notes.push_back(concat(one, " ", step, " of ", count, ", counted from 0, was taken"));
    // Another step is another volume when a pyramid is compared with its input.
    info_.encoding += (info_.encoding.empty() ? "" : ", ") + (one + " " + std::to_string(step));
    return static_cast<std::uint64_t>(step);
  }

  void takeValues(std::size_t axis) {
    if (choice_.value_axis)
      throw unusable(
          info_.source, "its voxels have ", choice_.values, " times ", array_.axes[axis].size,
          " values, along two axes, and one such axis is read; extract one volume first");
    choice_.value_axis = axis;
    choice_.values = static_cast<std::uint64_t>(array_.axes[axis].size);
    is_unnamed_ = array_.axes[axis].use == Use::kUnnamed;
    if (is_unnamed_) unnamed_time_ = std::exchange(choice_.options.time, std::nullopt);
  }

  void refuseUnused(const std::optional<std::int64_t>& given, const std::string& several) const {
    if (given && *given != 0)
      throw unusable(info_.source, "it has no ", several, " to choose from; leave out the choice");
  }

  const StoredArray& array_;
  VolumeInfo& info_;
  ArrayChoice choice_;
  bool is_unnamed_ = false;
  std::optional<std::int64_t> unnamed_time_;
};

// Where the rows of the chosen volume are among the numbers, in bytes.
struct ArrayPlaces {
  std::uint64_t first = 0;
  RowStrides strides;
  std::uint64_t total = 0;  // of the whole array
};

ArrayPlaces placesIn(const StoredArray& array, const std::vector<std::uint64_t>& indices,
                     const std::string& path) {
  ArrayPlaces places;
  places.total = storedBytes(array.stored.type);
  int space_axis = 0;
  for (std::size_t i = 0; i < array.axes.size(); ++i) {
    if (array.axes[i].use == Use::kSpace) {
      if (space_axis == 1) places.strides.row_bytes = places.total;
      if (space_axis == 2) places.strides.slice_bytes = places.total;
      ++space_axis;
    } else if (space_axis > 0) {  // of those before x, voxels are made
      places.first += indices[i] * places.total;
    }
    if (__builtin_mul_overflow(places.total, static_cast<std::uint64_t>(array.axes[i].size),
                               &places.total))
      throw unusable(path, "it has more numbers than 64 bits count; correct its header");
  }
  return places;
}

std::unique_ptr<VolumeSource> openChosen(const VolumeInfo& info, const StoredArray& array,
                                         const StoredVoxels& stored,
                                         const std::vector<std::uint64_t>& indices,
                                         const CancelFlag* cancel) {
  const ArrayPlaces places = placesIn(array, indices, info.source);
  const std::uint64_t row_bytes = static_cast<std::uint64_t>(info.voxels.x) * stored.bytes();
  const bool is_dense =
      places.strides.row_bytes == row_bytes &&
      places.strides.slice_bytes == row_bytes * static_cast<std::uint64_t>(info.voxels.y);
  const NumberFiles& files = array.files;
  const std::optional<std::uint64_t> offset = files.offsetOfBytes(places.total);
  if (is_dense && offset) {
    RawRun run;
    run.path = files.paths.front();
    run.header_path = files.header_path;
    run.offset_bytes = *offset + places.first;
    return openRawRun(info, run, stored);
  }
  return openStream(info, stored, makeNumberStream(files, array.stored.type, places.total),
                    places.first, files.all(), places.strides, cancel);
}

}  // namespace

Index3 volumeVoxels(const std::string& path, const std::vector<StoredAxis>& axes) {
  Index3 voxels(1);
  int space_axis = 0;
  for (const StoredAxis& axis : axes)
    if (axis.use == Use::kSpace) voxels[space_axis++] = axis.size;
  if (voxels.z == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  checkVoxelCounts(path, voxels);
  return voxels;
}

std::unique_ptr<VolumeSource> openStoredArray(VolumeInfo info, const StoredArray& array,
                                              const OpenOptions& options) {
  ArrayChoice choice = ArrayChooser(array, options, info).choose();
  StoredVoxels stored = array.stored;
  info.voxel_type = stored.delivered();
  if (!stored.keepsType() && !stored.map)
    info.notes.push_back(std::string(infoOf(stored.type).name) +
                         " voxels were converted to float32");
  if (!choice.value_axis) return openChosen(info, array, stored, choice.indices, options.cancel);
  // Values that lie together are a matter of decoding, others are volumes of their own.
  const auto is_space = [](const StoredAxis& axis) { return axis.use == Use::kSpace; };
  const auto x_axis = std::ranges::find_if(array.axes, is_space);
  const VolumeInfo of_one = info;
  StoredVoxels together = stored;
  takeComponent(choice.values, choice.options, together, info);
  const std::size_t axis = *choice.value_axis;
  if (static_cast<std::ptrdiff_t>(axis) < x_axis - array.axes.begin())
    return openChosen(info, array, together, choice.indices, options.cancel);
  const auto openValue = [&](const VolumeInfo& value_info, std::uint64_t value) {
    choice.indices[axis] = value;
    return openChosen(value_info, array, stored, choice.indices, options.cancel);
  };
  if (!choice.options.component->magnitude) {
    info.voxel_type = of_one.voxel_type;
    return openValue(info, static_cast<std::uint64_t>(choice.options.component->index));
  }
  std::vector<std::unique_ptr<VolumeSource>> sources;
  for (std::uint64_t value = 0; value < choice.values; ++value)
    sources.push_back(openValue(of_one, value));
  return makeMagnitudeSource(std::move(info), std::move(sources));
}

}  // namespace isobrick
