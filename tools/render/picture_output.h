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

namespace isobrick {

// Whether the name is one of many pictures: folder/%04d.png, or a movie (.mp4).
bool isSequenceName(const std::string& output);

struct PicturePlan {
  std::string output;
  int pictures = 1;
  double pictures_per_second = 25.0;  // of a movie
  double pixels_per_inch = 0.0;       // of a print; 0: the files say nothing
  double megapixels = 1.0;            // of a picture, for the progress
  std::vector<std::string> inputs;    // that are not replaced
  bool force = false;
};

class PictureSequence;

// Takes the rows of pictures from top to bottom, one picture after the other, and shows the
// progress. Nothing has its final name before finish().
class PictureOutput {
 public:
  // Refuses to replace anything without `force`, and inputs always. Throws Error too if the output
  // cannot be written: many pictures go to a folder, or a movie, which is made by ffmpeg.
  explicit PictureOutput(PicturePlan plan);
  ~PictureOutput();

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
