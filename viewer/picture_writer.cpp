#include "isobrick/viewer/picture_writer.h"

#include <chrono>
#include <cstring>
#include <utility>

#include "isobrick/storage/atomic_file.h"

namespace isobrick {

PictureShape shapeOf(const Image& image) {
  return {image.width,          image.height,           !image.alpha.empty(),
          !image.depth.empty(), !image.normals.empty(), image.pixels_per_inch};
}

std::unique_ptr<BandEncoder> makeBandEncoder(ImageFormat format, const PictureShape& shape,
                                             WriteAt write) {
  return format == ImageFormat::kPng ? makePngEncoder(shape, std::move(write))
                                     : makeExrEncoder(shape, std::move(write));
}

void MemoryFile::write(const void* data, std::size_t bytes, std::uint64_t offset) {
  if (bytes == 0) return;
  if (offset + bytes > bytes_.size()) bytes_.resize(offset + bytes);
  std::memcpy(bytes_.data() + offset, data, bytes);
}

class PictureWriter::Output {
 public:
  Output(const std::string& path, const PictureShape& shape)
      : file_(path),
        encoder_(makeBandEncoder(imageFormatOf(path), shape,
                                 [this](const void* data, std::size_t bytes, std::uint64_t offset) {
                                   file_.pwrite(data, bytes, offset);
                                 })) {}
  void add(const Image& rows) { encoder_->add(rows); }
  void publish(const CancelFlag& cancel) {
    encoder_->finish();
    file_.commit(&cancel);
  }

 private:
  AtomicFile file_;
  std::unique_ptr<BandEncoder> encoder_;
};

PictureWriter::PictureWriter(const std::string& path, const PictureShape& shape)
    : height_(shape.height) {
  auto output = std::make_unique<Output>(path, shape);
  thread_ = std::thread([this, output = std::move(output)]() mutable { work(std::move(output)); });
}

PictureWriter::~PictureWriter() {
  giveUp();
  thread_.join();
}

void PictureWriter::work(std::unique_ptr<Output> output) {
  std::exception_ptr failure;
  try {
    for (int rows = 0; rows < height_;) {
      Image taken;
      {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return next_ || given_up_.requested(); });
        given_up_.check();
        taken = std::move(*std::exchange(next_, std::nullopt));
      }
      changed_.notify_all();
      output->add(taken);
      rows += taken.height;
      given_up_.check();
    }
    output->publish(given_up_);
  } catch (...) {
    failure = std::current_exception();
  }
  output.reset();  // nothing is left behind before done() says so
  const std::lock_guard lock(mutex_);
  done_ = true;
  failure_ = failure;
  next_.reset();
  changed_.notify_all();
}

void PictureWriter::add(Image rows) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !next_ || done_; });
  if (failure_) std::rethrow_exception(failure_);
  if (done_) throw Cancelled();
  next_ = std::move(rows);
  changed_.notify_all();
}

bool PictureWriter::hasRoom() const {
  const std::lock_guard lock(mutex_);
  return !next_ || done_;
}

bool PictureWriter::done() const {
  const std::lock_guard lock(mutex_);
  return done_;
}

void PictureWriter::wait(const CancelFlag* cancel) {
  // A signal handler can only set the flag, so no call wakes this thread.
  constexpr auto kBetweenLooks = std::chrono::milliseconds(5);
  std::unique_lock lock(mutex_);
  while (!changed_.wait_for(lock, kBetweenLooks, [&] { return done_; })) {
    if (cancel == nullptr || !cancel->requested() || given_up_.requested()) continue;
    given_up_.request();
    changed_.notify_all();
  }
  if (failure_) std::rethrow_exception(failure_);
}

void PictureWriter::giveUp() {
  std::unique_lock lock(mutex_);
  given_up_.request();
  changed_.notify_all();
  changed_.wait(lock, [&] { return done_; });
}

}  // namespace isobrick
