#include "isobrick/storage/source_bricks.h"

#include <utility>

namespace isobrick {
namespace {

SourceOpener& theOpener() {
  static SourceOpener opener;
  return opener;
}

}  // namespace

void setSourceOpener(SourceOpener opener) { theOpener() = std::move(opener); }

const SourceBricks& Level0Source::bricks() {
  if (const SourceBricks* const opened = opened_) return *opened;
  const std::lock_guard lock(mutex_);
  if (bricks_ == nullptr) {
    if (!theOpener())
      throw Error("'" + request_.pyramid +
                      "' is an index, whose finest level lies in the volume that it was made of, "
                      "and this program does not read volumes; choose a coarser level, or build a "
                      "pyramid of that volume in place of the index",
                  {.path = request_.pyramid});
    bricks_ = theOpener()(request_);
    opened_ = bricks_.get();
  }
  return *bricks_;
}

std::string Level0Source::name() const {
  const SourceBricks* const opened = opened_;
  return opened != nullptr ? "'" + opened->path() + "'" : "its source";
}

}  // namespace isobrick
