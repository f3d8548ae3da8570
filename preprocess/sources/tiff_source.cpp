#include "isobrick/preprocess/sources/tiff_source.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_file.h"
#include "isobrick/preprocess/sources/tiff_directory.h"
#include "isobrick/preprocess/sources/tiff_pages.h"
#include "isobrick/preprocess/sources/tiff_unpacking.h"
#include "isobrick/preprocess/sources/voxel_components.h"
#include "isobrick/storage/abandonable.h"

namespace isobrick {
namespace {

// The tags of a page that decide how its numbers lie in the file, with the standard's defaults.
struct PageTags {
  std::uint64_t is_smaller = 0, width = 0, height = 0, bits = 1, packing = 1, colours = 0;
  std::uint64_t bit_order = 1, corner = 1, samples = 1, planes = 1, prediction = 1, kind = 1;
  std::uint64_t rows_per_strip = ~std::uint64_t{0};
  bool has_tiles = false;
  std::vector<std::uint64_t> strips, strip_bytes;
};

// None: a tag has no value that could be, or differs between the numbers of a pixel.
std::optional<PageTags> tagsOf(const TiffDirectory& tiff, std::uint64_t page) {
  PageTags tags;
  const std::map<std::uint64_t, std::uint64_t*> numbers = {
      {254, &tags.is_smaller}, {256, &tags.width},      {257, &tags.height},
      {258, &tags.bits},       {259, &tags.packing},    {262, &tags.colours},
      {266, &tags.bit_order},  {274, &tags.corner},     {277, &tags.samples},
      {284, &tags.planes},     {317, &tags.prediction}, {278, &tags.rows_per_strip},
      {339, &tags.kind}};
  for (const TiffEntry& entry : tiff.entries(page)) {
    if (entry.tag >= 322 && entry.tag <= 325) tags.has_tiles = true;
    if (entry.tag == 273) tags.strips = tiff.wholeNumbers(entry);
    if (entry.tag == 279) tags.strip_bytes = tiff.wholeNumbers(entry);
    const auto found = numbers.find(entry.tag);
    if (found == numbers.end()) continue;
    const std::vector<std::uint64_t> values =
        entry.count <= kMostComponents ? tiff.wholeNumbers(entry) : std::vector<std::uint64_t>();
    if (values.empty() || std::ranges::count(values, values.front()) != std::ssize(values))
      return std::nullopt;
    *found->second = values.front();
  }
  return tags;
}

std::optional<TiffSlices::Form> formOf(const PageTags& tags) {
  constexpr std::uint64_t kSigned = 2, kFloat = 3, kRgb = 2, kSeparate = 2;
  const bool is_known = tags.colours <= kRgb && tags.bit_order == 1 && tags.corner == 1 &&
                        tags.kind >= 1 && tags.kind <= kFloat && tags.bits % 8 == 0 &&
                        tags.samples >= 1 && tags.samples <= kMostComponents;
  if (!is_known || tags.width == 0 || tags.height == 0) return std::nullopt;
  TiffSlices::Form form{tags.width, tags.height, tags.samples};
  form.is_half = tags.kind == kFloat && tags.bits == 16;
  form.is_separate = tags.planes == kSeparate && tags.samples > 1;
  const auto type = storedTypeOf(tags.kind == kFloat    ? 'f'
                                 : tags.kind == kSigned ? 'i'
                                                        : 'u',
                                 form.is_half ? 4 : tags.bits / 8);
  // Sizes below fit 64 bits with these, and no page has them.
  constexpr std::uint64_t kMostNumbers = std::uint64_t{1} << 48;
  const auto most = static_cast<std::uint64_t>(kMaxVoxelsPerAxis);
  if (!type || tags.width > most || tags.height > most ||
      tags.width * tags.height > kMostNumbers / tags.samples)
    return std::nullopt;
  form.type = *type;
  return form;
}

// Where the rows begin, if they lie one behind the other as they are.
std::optional<std::uint64_t> pixelsAt(const PageTags& tags, const TiffSlices::Form& form,
                                      std::uint64_t file_bytes) {
  if (tags.packing != 1 || tags.prediction != 1 || tags.has_tiles || form.is_half ||
      form.is_separate || tags.rows_per_strip == 0)
    return std::nullopt;
  const std::uint64_t row_bytes = form.width * form.samples * storedBytes(form.type);
  const std::uint64_t rows = std::min(tags.rows_per_strip, form.height);
  const std::uint64_t strips = (form.height - 1) / rows + 1;
  if (tags.strips.size() != strips || tags.strip_bytes.size() != strips) return std::nullopt;
  std::uint64_t end = tags.strips.front();
  for (std::uint64_t i = 0; i < strips; ++i) {
    const std::uint64_t bytes = std::min(rows, form.height - i * rows) * row_bytes;
    if (tags.strips[i] != end || tags.strip_bytes[i] != bytes || end > file_bytes)
      return std::nullopt;
    end += bytes;
  }
  if (end > file_bytes) return std::nullopt;
  return tags.strips.front();
}

// None: it is no TIFF.
std::optional<TiffDirectory> tiffAt(const std::string& path) {
  try {
    return std::optional<TiffDirectory>(std::in_place, path);
  } catch (const ResumableError&) {
    throw;
  } catch (const Error&) {
    return std::nullopt;
  }
}

// Appends the slices of a file. False: it has a picture of another form.
bool addSlices(const TiffDirectory& tiff, std::span<const std::uint64_t> pages, std::uint32_t file,
               TiffSlices& slices) {
  for (const std::uint64_t page : pages) {
    const std::optional<PageTags> tags = tagsOf(tiff, page);
    if (!tags) return false;
    if (tags->is_smaller != 0) continue;
    const std::optional<TiffSlices::Form> form = formOf(*tags);
    if (!form) return false;
    if (slices.slices.empty()) slices.form = *form;
    if (*form != slices.form || std::ssize(slices.slices) == kMaxVoxelsPerAxis) return false;
    slices.slices.push_back(
        {file, page, tiff.isBigEndian(), pixelsAt(*tags, *form, tiff.file().size())});
  }
  return true;
}

class TiffSource final : public VolumeSource {
 public:
  TiffSource(VolumeInfo info, std::vector<std::string> paths, const TiffSlices& slices,
             const StoredVoxels& stored, const CancelFlag* cancel)
      : info_(std::move(info)),
        paths_(std::move(paths)),
        slices_(slices),
        is_plain_(slices.arePlain()),
        stored_(stored),
        cancel_(cancel) {}

  const VolumeInfo& info() const override { return info_; }
  std::vector<std::string> files() const override { return paths_; }
  std::uint64_t bufferBytes() const override {
    if (is_plain_) return stored_.keepsType() ? 0 : kDecodeBufferBytes;
    // The picture, and a strip or a tile of the library's.
    return 2 * *stored_.bytesOf(info_.voxels.x * info_.voxels.y);
  }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    if (is_plain_) return VolumeSource::readRows(first, count, out);
    auto* to = static_cast<std::byte*>(out);
    for (std::int64_t row = first; row < first + count;) {
      const std::int64_t z = row / info_.voxels.y, y = row % info_.voxels.y;
      const std::int64_t rows = std::min(info_.voxels.y - y, first + count - row);
      if (z != unpacked_) unpack(z);
      const std::byte* from =
          page_.data() + static_cast<std::size_t>(y * info_.voxels.x) * stored_.bytes();
      const auto voxels = static_cast<std::size_t>(rows * info_.voxels.x);
      decodeVoxels(stored_, voxels, to, [&](std::byte* stored, std::size_t bytes) {
        std::memcpy(stored, from, bytes);
        from += bytes;
      });
      to += voxels * voxelBytes(info_.voxel_type);
      row += rows;
    }
  }

  bool readsBoxes() const override { return is_plain_; }
  void readBox(const IndexBox& box, void* out) const override {
    auto* to = static_cast<std::byte*>(out);
    const IndexBox part{{box.first.x, box.first.y, 0}, {box.count.x, box.count.y, 1}};
    for (std::int64_t z = box.first.z; z < box.end().z; ++z) {
      const File file = open(slice(z).file);
      StoredBlock block{
          *file, *slice(z).pixels_at, stored_, {info_.voxels.x, info_.voxels.y, 1}, z};
      block.stored.big_endian = slice(z).big_endian;
      block.read(part, to);
      to += static_cast<std::size_t>(part.size()) * voxelBytes(info_.voxel_type);
    }
  }

 private:
  using File = std::shared_ptr<const InputFile>;

  const TiffSlices::Slice& slice(std::int64_t z) const {
    return slices_.slices[static_cast<std::size_t>(z)];
  }

  void unpack(std::int64_t z) {
    unpacked_ = -1;
    // A large picture takes seconds, and the library does not stop before its end.
    page_ = runAbandonable(cancel_, [path = paths_[slice(z).file], page_at = slice(z).page_at,
                                     form = slices_.form, page = std::move(page_)]() mutable {
      unpackTiffPage(path, page_at, form, page);
      return std::move(page);
    });
    unpacked_ = z;
  }

  // Some files stay open: a build reads the same slices for one row of bricks after the other.
  File open(std::uint32_t number) const {
    constexpr std::size_t kMostOpen = 160;
    const std::lock_guard lock(mutex_);
    if (const auto found = open_.find(number); found != open_.end()) return found->second;
    if (open_.size() >= kMostOpen) {
      // Sweeps go up: the lowest one is needed last, unless a new sweep begins below it.
      const bool is_below = number < open_.begin()->first;
      open_.erase(is_below ? std::prev(open_.end()) : open_.begin());
    }
    return open_[number] = std::make_shared<const InputFile>(paths_[number]);
  }

  const VolumeInfo info_;
  const std::vector<std::string> paths_;
  const TiffSlices slices_;
  const bool is_plain_;
  const StoredVoxels stored_;
  const CancelFlag* const cancel_;
  std::int64_t unpacked_ = -1;   // the slice in page_; -1: none
  std::vector<std::byte> page_;  // of a packed picture
  mutable std::mutex mutex_;     // guards the files
  mutable std::map<std::uint32_t, File> open_;
};

}  // namespace

bool TiffSlices::arePlain() const {
  return std::ranges::all_of(slices, [](const Slice& slice) { return bool{slice.pixels_at}; });
}

std::optional<TiffSlices> findTiffSlices(const std::vector<std::string>& paths,
                                         const OpenOptions& options) {
  TiffSlices slices;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    options.checkCancel();
    options.report("scanning slices", static_cast<double>(i) / static_cast<double>(paths.size()));
    const std::optional<TiffDirectory> tiff = tiffAt(paths[i]);
    if (!tiff) return std::nullopt;
    // Its error counts: ITK, which would look next, follows pages in a circle for ever.
    const std::vector<std::uint64_t> pages = tiff->pages();
    try {
      if (!addSlices(*tiff, pages, static_cast<std::uint32_t>(i), slices)) return std::nullopt;
    } catch (const ResumableError&) {
      throw;
    } catch (const Error&) {
      return std::nullopt;
    }
  }
  if (slices.slices.empty()) return std::nullopt;
  return slices;
}

std::unique_ptr<VolumeSource> openTiffSlices(VolumeInfo info, std::vector<std::string> paths,
                                             const TiffSlices& slices, const StoredVoxels& stored,
                                             const OpenOptions& options) {
  return std::make_unique<TiffSource>(std::move(info), std::move(paths), slices, stored,
                                      options.cancel);
}

namespace {

// What all kinds of volumes share.
void describe(const std::string& first_path, const TiffSlices& slices, const OpenOptions& options,
              VolumeInfo& info, StoredVoxels& stored) {
  const TiffSlices::Form& form = slices.form;
  info.voxels = Index3(static_cast<std::int64_t>(form.width),
                       static_cast<std::int64_t>(form.height), std::ssize(slices.slices));
  checkVoxelCounts(info.source, info.voxels);
  std::vector<std::string> unsaid;  // of distances that are given
  takeTiffLengths(first_path, info.geometry, options.spacing ? unsaid : info.notes);
  tidyGeometry(info.source, info.geometry, info.voxels, info.notes);
  stored.type = form.type;
  info.voxel_type = stored.delivered();
  if (!stored.keepsType() || form.is_half)
    info.notes.push_back((form.is_half ? "float16" : std::string(infoOf(form.type).name)) +
                         " voxels were converted to float32");
}

}  // namespace

std::unique_ptr<VolumeSource> openTiffFile(const std::string& path, const OpenOptions& options) {
  const std::optional<TiffSlices> slices = findTiffSlices({path}, options);
  if (!slices) return nullptr;
  if (slices->slices.size() == 1)
    throw unusable(path, "it is a single 2-D image; name the folder that holds all slices");
  checkComponentChoice(path, slices->form.samples, options);
  VolumeInfo info;
  info.source = path;
  info.format = "TIFF";
  StoredVoxels stored;
  describe(path, *slices, options, info, stored);
  takeComponent(slices->form.samples, options, stored, info);
  return openTiffSlices(std::move(info), {path}, *slices, stored, options);
}

std::unique_ptr<VolumeSource> openTiffStack(VolumeInfo info, const std::vector<std::string>& paths,
                                            const OpenOptions& options) {
  const std::optional<TiffSlices> slices = findTiffSlices(paths, options);
  // A file of several pages is no slice.
  if (!slices || slices->form.samples != 1 || slices->slices.size() != paths.size() ||
      slices->slices.back().file + 1 != paths.size())
    return nullptr;
  info.format = "TIFF stack";
  StoredVoxels stored;
  describe(paths.front(), *slices, options, info, stored);
  return openTiffSlices(std::move(info), paths, *slices, stored, options);
}

}  // namespace isobrick
