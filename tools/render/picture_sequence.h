// The files of many pictures: numbered ones in a folder, or a movie.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "isobrick/viewer/image.h"

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

}  // namespace isobrick
