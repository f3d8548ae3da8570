#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/slice_names.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/preprocess/sources/tiff_file.h"
#include "isobrick/storage/abandonable.h"

namespace isobrick {
namespace {

class TiffSource final : public VolumeSource {
 public:
  TiffSource(VolumeInfo info, std::vector<std::string> paths, std::vector<TiffPage> slices,
             const StoredVoxels& stored, const CancelFlag* cancel)
      : info_(std::move(info)),
        paths_(std::move(paths)),
        slices_(std::move(slices)),
        is_plain_(std::ranges::all_of(slices_,
                                      [](const TiffPage& page) { return bool{page.pixels_at}; })),
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
    forEachSliceOfRows(info_, first, count, out,
                       [&](std::int64_t z, std::int64_t y, std::int64_t rows, std::byte* to) {
                         if (z != unpacked_) unpack(z);
                         const std::byte* from =
                             pixels_.data() +
                             static_cast<std::size_t>(y * info_.voxels.x) * stored_.bytes();
                         decodeVoxels(stored_, static_cast<std::size_t>(rows * info_.voxels.x), to,
                                      [&](std::byte* stored, std::size_t bytes) {
                                        std::memcpy(stored, from, bytes);
                                        from += bytes;
                                      });
                       });
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

  const TiffPage& slice(std::int64_t z) const { return slices_[static_cast<std::size_t>(z)]; }

  void unpack(std::int64_t z) {
    unpacked_ = -1;
    // A large picture takes seconds, and the library does not stop before its end.
    pixels_ = runAbandonable(cancel_, [path = paths_[slice(z).file], page = slice(z),
                                       pixels = std::move(pixels_)]() mutable {
      TiffFile(path).unpack(page, pixels);
      return std::move(pixels);
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
  const std::vector<TiffPage> slices_;
  const bool is_plain_;
  const StoredVoxels stored_;
  const CancelFlag* const cancel_;
  std::int64_t unpacked_ = -1;     // the slice in pixels_; -1: none
  std::vector<std::byte> pixels_;  // of a packed picture
  mutable std::mutex mutex_;       // guards the files
  mutable std::map<std::uint32_t, File> open_;
};

// The axis of slices: the named one, or the fastest one that could be; none: it is no volume.
std::optional<std::size_t> sliceAxis(const TiffImage& image) {
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < image.axes.size(); ++i) {
    const TiffAxis& axis = image.axes[i];
    if (axis.count == 1 || axis.name == 'C' || axis.name == 'T') continue;
    if (axis.name == 'Z') return i;
    found = i;
  }
  return found;
}

// "'cells' of 400 x 300 x 20 x 2 channels"
std::string imageText(const TiffImage& image) {
  std::string text = image.name.empty() ? "" : quotedText(image.name, 40) + " of ";
  if (!image.planes.empty())
    text += concat(image.planes.front().form.width, " x ", image.planes.front().form.height);
  for (const TiffAxis& axis : image.axes)
    if (axis.count > 1)
      text += concat(" x ", axis.count,
                     axis.name == 'C'   ? " channels"
                     : axis.name == 'T' ? " times"
                                        : "");
  return text;
}

// The chosen image, or the only one that is a volume.
const TiffImage& chooseImage(const std::string& path, const std::vector<TiffImage>& images,
                             const OpenOptions& options, VolumeInfo& info) {
  ListText list("; ", 20);
  std::vector<std::size_t> volumes;
  for (std::size_t i = 0; i < images.size(); ++i) {
    list.add(i, ": ", imageText(images[i]));
    if (sliceAxis(images[i])) volumes.push_back(i);
  }
  if (options.image) volumes = {static_cast<std::size_t>(*options.image)};
  if (images.size() == 1 && !options.image) volumes = {0};
  if (volumes.size() != 1 || volumes.front() >= images.size())
    throw unusable(path,
                   volumes.size() == 1 ? "it has no image " + std::to_string(volumes.front())
                   : volumes.empty()   ? "none of its images is a volume"
                                       : "it has several images",
                   " (", list.text(), ")", Remedy::kChooseImage);
  if (images.size() > 1) {
    info.notes.push_back(
        concat("of the images ", list.text(), ", number ", volumes.front(), " was taken"));
    info.encoding = concat("image ", volumes.front());
  }
  return images[volumes.front()];
}

// The planes of one channel at one time, which become the slices. `options` lose what was taken.
std::vector<TiffPage> choosePlanes(const std::string& path, const TiffImage& image,
                                   OpenOptions& options, VolumeInfo& info) {
  if (!image.unread.empty()) throw unusable(path, image.unread);
  const auto slices = sliceAxis(image);
  if (!slices)
    throw unusable(path, image.planes.size() == 1
                             ? "it is a single 2-D image; name the folder that holds all slices"
                             : "its planes (" + imageText(image) +
                                   ") are no slices of a volume; if they are, say so in its "
                                   "description (in Fiji: Image > Properties)");
  std::int64_t first = 0, step = 1;
  for (std::size_t i = 0; i < image.axes.size(); ++i) {
    const TiffAxis& axis = image.axes[i];
    first *= axis.count;
    step = i == *slices ? 1 : step * axis.count;
    if (i == *slices || axis.count == 1) continue;
    const bool has_meaning = axis.name == 'T' || axis.name == 'C';
    const bool is_time = axis.name == 'T' || (!has_meaning && options.time);
    auto& wanted = is_time ? options.time : options.channel;
    if (!has_meaning && !wanted)
      throw unusable(path, "its planes (", imageText(image), ") have a further axis",
                     Remedy::kChooseVariant);
    first += takeOne(path, is_time ? "time step" : "channel", wanted, axis.count, info);
    wanted.reset();
  }
  takeOne(path, "time step", options.time, 1, info);
  std::vector<TiffPage> planes;
  for (std::int64_t z = 0; z < image.axes[*slices].count; ++z) {
    planes.push_back(image.planes[static_cast<std::size_t>(first + z * step)]);
    if (planes.back().form.width == 0)
      throw unusable(path, "slice ", z, " of this channel and time is in ",
                     image.lacks.empty()
                         ? "no page; get the whole file again"
                         : quotedText(image.lacks, 80) + ", which is not beside it; put it there");
  }
  return planes;
}

// The numbers of a pixel may be channels.
void chooseComponent(const std::string& path, const TiffImage& image, const TiffForm& form,
                     OpenOptions& options, VolumeInfo& info) {
  if (form.samples == 1) {
    takeOne(path, "channel", options.channel, 1, info);
  } else if (!options.component && (options.channel || (image.has_channels && !form.is_colour))) {
    const std::string before = std::exchange(info.encoding, {});
    const auto channel = takeOne(path, "channel", options.channel, form.samples, info);
    info.encoding = before;
    options.component = ComponentChoice{false, channel};
  }
  checkComponentChoice(path, form.samples, options);
}

// Spacing and unit. Without a distance of slices, that of pixels along x is taken.
void takeLengths(const TiffLengths& lengths, VolumeInfo& info) {
  GridGeometry& geometry = info.geometry;
  geometry.spacing = lengths.spacing;
  if (lengths.spacing.x == 0) {
    geometry.spacing.x = geometry.spacing.y = 1;
    info.notes.emplace_back("the pixels have no distance; 1 was used");
  }
  if (lengths.spacing.z == 0) {
    geometry.spacing.z = geometry.spacing.x;
    info.notes.emplace_back(kNoSliceDistance);
  }
  takeLengthUnits(lengths.units, info);
}

// The volume of some slices.
std::unique_ptr<VolumeSource> openSlices(VolumeInfo info, std::vector<std::string> paths,
                                         std::vector<TiffPage> slices, const TiffLengths& lengths,
                                         const OpenOptions& options) {
  const TiffPage& first = slices.front();
  for (const TiffPage& slice : slices) {
    const std::string& path = paths[slice.file];
    if (!slice.unread.empty()) throw unusable(path, slice.unread);
    if (slice.form != first.form)
      throw unusable(path,
                     "the size or the type of its pixels is not that of the first slice; keep only "
                     "the slices of one volume");
  }
  info.voxels = Index3(first.form.width, first.form.height, std::ssize(slices));
  checkVoxelCounts(info.source, info.voxels);
  const std::size_t notes = info.notes.size();
  takeLengths(lengths, info);
  if (options.spacing) info.notes.resize(notes);  // they are of distances that are given
  tidyGeometry(info.source, info.geometry, info.voxels, info.notes);
  StoredVoxels stored;
  stored.type = *first.form.type();
  info.voxel_type = stored.delivered();
  if (!stored.keepsType())
    info.notes.push_back(std::string(infoOf(stored.type).name) +
                         " voxels were converted to float32");
  const std::string encoding = std::exchange(info.encoding, {});
  takeComponent(first.form.samples, options, stored, info);
  if (!encoding.empty())
    info.encoding = encoding + (info.encoding.empty() ? "" : "; ") + info.encoding;
  return std::make_unique<TiffSource>(std::move(info), std::move(paths), std::move(slices), stored,
                                      options.cancel);
}

// The chosen volume of a file.
std::unique_ptr<VolumeSource> openTiffImage(VolumeInfo info, const std::string& path,
                                            OpenOptions options) {
  info.format = "TIFF";
  TiffImages found = findTiffImages(path, options);
  const TiffImage& image = chooseImage(path, found.images, options, info);
  std::vector<TiffPage> slices = choosePlanes(path, image, options, info);
  chooseComponent(path, image, slices.front().form, options, info);
  info.named_channels = image.named_channels;
  return openSlices(std::move(info), found.paths, std::move(slices), image.lengths, options);
}

}  // namespace

std::unique_ptr<VolumeSource> openTiffFile(const std::string& path, const OpenOptions& options) {
  if (!TiffFile::isAt(path)) return nullptr;
  VolumeInfo info;
  info.source = path;
  return openTiffImage(std::move(info), path, options);
}

std::unique_ptr<VolumeSource> openTiffStack(VolumeInfo info, const std::vector<std::string>& files,
                                            const OpenOptions& options) {
  TiffFile first(files.front());
  const TiffResolution resolution = first.resolution();
  const std::string description = first.pages(options, 1).front().description;
  if (namesOtherFiles(description)) return openTiffImage(std::move(info), files.front(), options);
  info.format = "TIFF stack";
  const std::vector<std::string> paths = chooseSlices(files, options, info);
  std::vector<TiffPage> slices;
  for (const std::string& path : paths) {
    const std::size_t number = slices.size();
    options.checkCancel();
    options.report("scanning slices",
                   static_cast<double>(number) / static_cast<double>(paths.size()));
    std::vector<TiffPage> pages = TiffFile(path).pages(options);
    std::erase_if(pages, [](const TiffPage& page) { return page.is_smaller; });
    if (pages.size() != 1)
      throw unusable(path, "it holds ", pages.size(),
                     " slices, but the folder is read as a stack of single ones; name that file");
    slices.push_back(std::move(pages.front()));
    slices.back().description.clear();
    slices.back().file = static_cast<std::uint32_t>(number);
  }
  checkComponentChoice(info.source, slices.front().form.samples, options);
  return openSlices(std::move(info), paths, std::move(slices), tiffLengths(resolution, description),
                    options);
}

}  // namespace isobrick
