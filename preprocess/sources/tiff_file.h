// A TIFF file as libtiff reads it, and the volumes that its pages are (tiff_images.cpp). Private to
// preprocess/sources/.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/sources/stored_voxels.h"
#include "isobrick/storage/grid.h"

struct tiff;

namespace isobrick {

// The numbers of a picture: the same in all pictures of a volume.
struct TiffForm {
  std::uint32_t width = 0, height = 0;
  std::uint16_t samples = 1;  // numbers of a pixel
  std::uint16_t bits = 1;     // of a number
  char kind = 'u';            // of storedTypeOf(); '?': a kind that is not read
  bool is_separate = false;   // one number of all pixels lies behind the other
  bool is_colour = false;     // red, green and blue
  bool operator==(const TiffForm&) const = default;

  // Numbers of fewer bits than a byte or two have the next type; none: numbers that are not read.
  std::optional<StoredType> type() const;
};

struct TiffPage {
  TiffForm form;
  std::uint64_t at = 0;     // byte of its directory
  std::uint32_t file = 0;   // for lists of pages of several files
  bool is_smaller = false;  // a smaller picture, or a mask, of another page
  bool big_endian = false;  // the file is
  // Byte of the first number, if all lie there row by row as they are.
  std::optional<std::uint64_t> pixels_at;
  std::string unread;       // why its pixels cannot be read; empty: they can
  std::string description;  // of the first page, and of those where a series of tifffile begins
};

// What the first page says of lengths.
struct TiffResolution {
  int unit = 2;         // 1: none, 2: inch, 3: centimetre
  double x = 0, y = 0;  // pixels a unit; 0: not stated
  std::string lsm;      // the header of a Zeiss LSM
};

// For one thread. All members throw Error that names the file, in the words of libtiff if it finds
// a fault. The file may be hostile: sizes are checked before anything is allocated.
class TiffFile {
 public:
  // Throws Error that names the file too if its first bytes are not those of a TIFF.
  explicit TiffFile(const std::string& path);

  // Whether the file begins as one.
  static bool isAt(const std::string& path);

  // At most `most` pages, in their order. Throws Error if the list of pages leads out of the file
  // or in a circle.
  std::vector<TiffPage> pages(const OpenOptions& options, std::size_t most = SIZE_MAX);
  // Before pages().
  TiffResolution resolution() const;

  // The numbers of a page: rows from the upper left corner, the numbers of a pixel side by side, in
  // this machine's byte order, as its type(). `buffer` is used if it has room.
  void unpack(const TiffPage& page, std::vector<std::byte>& buffer);

 private:
  struct Close {
    void operator()(tiff* file) const;
  };

  template <typename T>
  T tag(std::uint32_t number) const;
  void goTo(std::uint64_t page_at);
  TiffPage page() const;
  void checkLastPage(std::uint64_t at) const;
  TiffForm form() const;
  std::string whyUnread(const TiffForm& form) const;
  std::optional<std::uint64_t> plainPixels(const TiffForm& form) const;
  void unpackPlane(const TiffForm& form, std::uint16_t plane, std::byte* out);
  void placeRow(const TiffForm& form, const std::byte* from, std::uint64_t columns, std::byte* to);
  Error failed() const;

  const InputFile file_;
  std::string message_;  // the library's last one
  std::unique_ptr<tiff, Close> tiff_;
  std::vector<std::byte> part_;  // a tile or a strip
  std::vector<std::byte> wide_;  // a row of it
};

// An axis of planes: 'Z', 'C' (channels), 'T' (times), or a letter of unknown meaning.
struct TiffAxis {
  char name = 'Z';
  std::int64_t count = 1;
};

// Lengths as the file states them.
struct TiffLengths {
  glm::dvec3 spacing{0.0};  // 0: not stated
  std::array<std::string, 3> units;
};

struct TiffImage {
  std::string name;
  std::vector<TiffAxis> axes;    // of its planes, the slowest first
  std::vector<TiffPage> planes;  // one without width is in no file
  bool has_channels = false;     // the numbers of a pixel are channels
  std::string unread;            // why it cannot be read; empty: it can
  std::string lacks;             // a file with some planes that is not there
  TiffLengths lengths;
  std::vector<VolumeChannel> named_channels = {};
};

struct TiffImages {
  std::vector<std::string> paths;  // of the files that the planes are in, the first one's first
  std::vector<TiffImage> images;
};

// The images of a file by its description: hyperstacks of ImageJ (also with one page for all
// planes), OME-TIFF (also of several files), series of tifffile, Zeiss LSM; otherwise pages of one
// form are the slices of an image. Smaller pictures beside the pages are left out. Throws Error
// that names the file if its description contradicts its pages.
TiffImages findTiffImages(const std::string& path, const OpenOptions& options);

// The lengths that a first page states: those of OME-TIFF, ImageJ or Zeiss LSM, or the resolution
// in pixels an inch, a centimetre or a unit.
TiffLengths tiffLengths(const TiffResolution& said, const std::string& description);

// Whether it is that of an OME-TIFF of several files.
bool namesOtherFiles(const std::string& description);

}  // namespace isobrick
