#include "tools/render/picture_output.h"

#include <utility>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/viewer/image.h"
#include "tools/interrupt.h"
#include "tools/output_check.h"

namespace isobrick {

PictureOutput::PictureOutput(PicturePlan plan)
    : plan_(std::move(plan)),
      progress_(plan_.pictures > 1 ? plan_.pictures : plan_.megapixels,
                plan_.pictures > 1 ? "pictures" : "megapixels") {
  if (plan_.pictures > 1) {
    sequence_ =
        makePictureSequence(plan_.output, plan_.pictures_per_second, plan_.inputs, plan_.force);
    return;
  }
  imageFormatOf(plan_.output);
  refuseReplacing({plan_.output}, plan_.inputs, plan_.force);
  const AtomicFile probe(plan_.output);
}

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
