// The file of a picture, written beside the drawing of it.
#pragma once

#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/picture_bands.h"

namespace isobrick {

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
