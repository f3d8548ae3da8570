// The output of `isobrick render`: one picture, numbered ones in a folder, or a movie.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/image.h"
#include "isobrick/viewer/picture_writer.h"
#include "tools/progress_bar.h"
#include "tools/render/picture_output.h"

namespace isobrick {

// Takes the pictures one after the other. Nothing has its final name before finish(), and without
// it nothing remains.
class PictureSequence {
 public:
  virtual ~PictureSequence() = default;
  // The files' format: what add() takes is encoded in it.
  virtual ImageFormat format() const = 0;
  virtual void add(const std::vector<char>& picture) = 0;
  virtual void finish() = 0;
};

// Whether the name is one of many pictures: folder/%04d.png, or a movie (.mp4).
bool isSequenceName(const std::string& output);
bool isMovieName(const std::string& output);

// Refuses to replace anything without `force`, and inputs always. A movie has H.264 pictures, so
// many a second, and is made by ffmpeg. Throws Error if it is not installed, or if the name has
// neither of the two forms.
std::unique_ptr<PictureSequence> makePictureSequence(const std::string& output,
                                                     double pictures_per_second,
                                                     const std::vector<std::string>& inputs,
                                                     bool force);

struct PicturePlan {
  std::string output;
  int pictures = 1;
  double pictures_per_second = 25.0;  // of a movie
  double pixels_per_inch = 0.0;       // of a print; 0: the files say nothing
  double megapixels = 1.0;            // of a picture, for the progress
  std::vector<std::string> inputs;    // that are not replaced
  bool force = false;
};

// Takes the rows of pictures from top to bottom, one picture after the other, and shows the
// progress. Nothing has its final name before finish().
class PictureOutput {
 public:
  // Throws Error, as makePictureSequence(), if the output cannot be written.
  explicit PictureOutput(PicturePlan plan);

  ImageFormat format() const;
  // `shape`: of the picture; `share`: of it that is complete with these rows, 0 .. 1.
  void add(std::size_t picture, PictureShape shape, Image rows, double share);
  // Throws Cancelled if the user says so.
  void finish();
  // By another thread than that of add(): a picture that is being written leaves nothing behind.
  void giveUp();

 private:
  PictureWriter& writer(const PictureShape& shape);

  const PicturePlan plan_;
  std::unique_ptr<PictureSequence> sequence_;  // null: it is one picture
  ProgressBar progress_;

  MemoryFile file_;  // of a sequence, the next one
  std::unique_ptr<BandEncoder> encoder_;

  std::mutex mutex_;  // guards all below
  bool given_up_ = false;
  std::shared_ptr<PictureWriter> writer_;
};

}  // namespace isobrick
