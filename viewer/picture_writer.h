// Pictures written from top to bottom, in bands of rows, none of which has to fit into memory; and
// the thread that writes such a file.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"

namespace isobrick {

// A picture without its pixels.
struct PictureShape {
  int width = 1;   // pixels
  int height = 1;  // pixels
  // The layers that it has beside the colours (Image).
  bool alpha = false, depth = false, normals = false;
  double pixels_per_inch = 0.0;  // of a print; 0: the file says nothing

  bool operator==(const PictureShape&) const = default;
};
PictureShape shapeOf(const Image& image);

// Takes bytes of a file for this offset. Bytes that were written may be written again.
using WriteAt = std::function<void(const void* data, std::size_t bytes, std::uint64_t offset)>;

// The bytes of a file, the same for any division into bands. Used by one thread at a time.
class BandEncoder {
 public:
  virtual ~BandEncoder() = default;
  // The next rows, with the layers of the shape. Throws Error, and what WriteAt throws.
  virtual void add(const Image& rows) = 0;
  virtual void finish() = 0;
};

// As encodeImage(). PNG is packed by all processors, a megabyte at a time.
std::unique_ptr<BandEncoder> makePngEncoder(const PictureShape& shape, WriteAt write);
std::unique_ptr<BandEncoder> makeExrEncoder(const PictureShape& shape, WriteAt write);
std::unique_ptr<BandEncoder> makeBandEncoder(ImageFormat format, const PictureShape& shape,
                                             WriteAt write);

class MemoryFile {
 public:
  void write(const void* data, std::size_t bytes, std::uint64_t offset);
  std::vector<char> take() { return std::move(bytes_); }

 private:
  std::vector<char> bytes_;
};

// A thread packs and writes rows while the next ones are drawn; two bands are in memory, the one
// that is written and one that waits. The file has its name when it is complete, and until then
// another (AtomicFile), which nothing is left of if the picture is given up. All members may be
// called by any thread.
class PictureWriter {
 public:
  // The format is that of the name. Throws Error if the file cannot be made.
  PictureWriter(const std::string& path, const PictureShape& shape);
  // Gives up what was not written.
  ~PictureWriter();
  PictureWriter(const PictureWriter&) = delete;
  PictureWriter& operator=(const PictureWriter&) = delete;

  // The next rows; the last of the shape complete the file. Waits until there is room for them.
  // Throws Cancelled if the picture was given up, and Error if rows before could not be written.
  void add(Image rows);
  // add() would not wait.
  bool hasRoom() const;

  // The file has its name, or cannot be written.
  bool done() const;
  // Until then. Throws as add(), and Cancelled, after it gave the picture up, if `cancel` says so.
  void wait(const CancelFlag* cancel = nullptr);

  // Ends the writing, and leaves nothing behind.
  void giveUp();

 private:
  class Output;
  void work(std::unique_ptr<Output> output);

  const int height_;
  CancelFlag given_up_;
  mutable std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::optional<Image> next_;
  bool done_ = false;
  std::exception_ptr failure_;
  std::thread thread_;
};

}  // namespace isobrick
