#include "tools/render/picture_output.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <sstream>
#include <utility>

#include "isobrick/preprocess/export/atomic_folder.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/viewer/image.h"
#include "tools/interrupt.h"
#include "tools/outputs.h"
#include "tools/program_run.h"

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

namespace {

namespace fs = std::filesystem;

class NumberedPictures : public PictureSequence {
 public:
  NumberedPictures(ImageFormat format, const NumberedFiles& files)
      : format_(format), name_(files.name), folder_(files.folder) {}
  ImageFormat format() const override { return format_; }
  void add(const std::vector<char>& picture) override {
    folder_.writeFile(name_.of(++count_), picture.data(), picture.size());
  }
  void finish() override { folder_.commit(&interruptFlag()); }

 private:
  ImageFormat format_;
  NumberedName name_;
  AtomicFolder folder_;
  std::int64_t count_ = 0;
};

std::optional<std::string> findInPath(const std::string& program) {
  const char* const path = std::getenv("PATH");
  std::istringstream folders(path != nullptr ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    const fs::path file = fs::path(folder.empty() ? "." : folder) / program;
    if (access(file.c_str(), X_OK) == 0 && isRegularFile(file)) return file.string();
  }
  return std::nullopt;
}

std::string requiredFfmpeg(const std::string& movie) {
  if (const auto found = findInPath("ffmpeg")) return *found;
  throw Error("cannot write '" + movie +
              "': ffmpeg, which makes movies, is not installed; install it, or write pictures "
              "with -o folder/%04d.png");
}

// ffmpeg reads the pictures one after the other from one file.
class Movie : public PictureSequence {
 public:
  Movie(const std::string& path, double pictures_per_second)
      : ffmpeg_(requiredFfmpeg(path)),
        pictures_per_second_(pictures_per_second),
        movie_(path),
        pictures_(path + ".pictures") {}
  ImageFormat format() const override { return ImageFormat::kPng; }
  void add(const std::vector<char>& picture) override {
    pictures_.write(picture.data(), picture.size());
  }
  void finish() override {
    // Players want even sizes, colours of half the resolution, and the index in front.
    runProgram({{ffmpeg_,
                 "-hide_banner",
                 "-loglevel",
                 "error",
                 "-nostdin",
                 "-y",
                 "-f",
                 "image2pipe",
                 "-c:v",
                 "png",
                 "-framerate",
                 fmt::format("{}", pictures_per_second_),
                 "-i",
                 "file:" + pictures_.temporaryPath(),
                 "-vf",
                 "pad=ceil(iw/2)*2:ceil(ih/2)*2",
                 "-c:v",
                 "libx264",
                 "-crf",
                 "18",
                 "-pix_fmt",
                 "yuv420p",
                 "-movflags",
                 "+faststart",
                 "-f",
                 "mp4",
                 "file:" + movie_.temporaryPath()},
                {}},
               &interruptFlag());
    movie_.commit(&interruptFlag());
  }

 private:
  std::string ffmpeg_;
  double pictures_per_second_;
  AtomicFile movie_, pictures_;
};

bool isMovieName(const std::string& output) { return lowerExtension(output) == ".mp4"; }

// A movie has H.264 pictures. Throws Error if ffmpeg is not installed, or if the name has neither
// of the two forms.
std::unique_ptr<PictureSequence> makePictureSequence(const PicturePlan& plan) {
  const std::string& output = plan.output;
  if (isMovieName(output)) {
    refuseReplacing({output}, plan.inputs, plan.force);
    return std::make_unique<Movie>(output, plan.pictures_per_second);
  }
  const std::optional<NumberedFiles> files = parseNumberedFiles(output);
  if (!files)
    throw Error("cannot write pictures to '" + output +
                "': they go into a folder of their own, and their name has one place for the "
                "number; write -o folder/%04d.png, or a movie with -o NAME.mp4");
  refuseReplacingFolder({files->folder}, plan.inputs, plan.force, [&](const std::string& folder) {
    return holdsNothingBut(folder, [&](const FolderMember& entry) {
      return entry.isRegularFile() && files->name.matches(entry.name());
    });
  });
  return std::make_unique<NumberedPictures>(imageFormatOf(output), *files);
}

}  // namespace

bool isSequenceName(const std::string& output) {
  return isMovieName(output) || fs::path(output).filename().string().find('%') != std::string::npos;
}

PictureOutput::PictureOutput(PicturePlan plan)
    : plan_(std::move(plan)),
      progress_(plan_.pictures > 1 ? plan_.pictures : plan_.megapixels,
                plan_.pictures > 1 ? "pictures" : "megapixels") {
  if (plan_.pictures > 1) {
    sequence_ = makePictureSequence(plan_);
    return;
  }
  imageFormatOf(plan_.output);
  refuseReplacing({plan_.output}, plan_.inputs, plan_.force);
  const AtomicFile probe(plan_.output);
}

PictureOutput::~PictureOutput() = default;

ImageFormat PictureOutput::format() const {
  return sequence_ ? sequence_->format() : imageFormatOf(plan_.output);
}

void PictureOutput::add(std::size_t picture, PictureShape shape, Image rows, double share) {
  interruptFlag().check();
  shape.pixels_per_inch = plan_.pixels_per_inch;
  progress_.show("draw", (static_cast<double>(picture) + share) / plan_.pictures);
  if (!sequence_) return writer(shape).add(std::move(rows));
  if (!encoder_)
    encoder_ = makeBandEncoder(format(), shape,
                               [this](const void* data, std::size_t bytes, std::uint64_t offset) {
                                 file_.write(data, bytes, offset);
                               });
  encoder_->add(rows);
  if (share < 1.0) return;
  encoder_->finish();
  encoder_.reset();
  sequence_->add(file_.take());
}

PictureWriter& PictureOutput::writer(const PictureShape& shape) {
  const std::lock_guard lock(mutex_);
  if (given_up_) throw Cancelled();
  if (!writer_) writer_ = std::make_shared<PictureWriter>(plan_.output, shape);
  return *writer_;
}

void PictureOutput::finish() {
  if (sequence_)
    sequence_->finish();
  else
    writer_->wait(&interruptFlag());
}

void PictureOutput::giveUp() {
  std::shared_ptr<PictureWriter> writer;
  {
    const std::lock_guard lock(mutex_);
    given_up_ = true;
    writer = writer_;
  }
  if (writer) writer->giveUp();
}

}  // namespace isobrick
