// The common part of all views of a volume (source_views.h, derived_volume.h).
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// Passes everything on to the source. `what` says how the voxels differ from the source's, in full
// precision: it goes into VolumeInfo::encoding, and so into the identity of what is built.
class SourceView : public VolumeSource {
 public:
  const VolumeInfo& info() const final { return info_; }
  bool readsBoxes() const override { return source_->readsBoxes(); }
  std::vector<std::string> files() const final { return source_->files(); }
  std::vector<std::string> notesOfReading() const override { return source_->notesOfReading(); }
  std::string identity() const final {
    const std::string identity = source_->identity();
    return identity.empty() ? identity : identity + "; " + info_.encoding;
  }
  std::uint64_t bufferBytes() const override { return source_->bufferBytes(); }
  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    source_->readRows(first, count, out);
  }
  void readBox(const IndexBox& box, void* out) const override { source_->readBox(box, out); }
  void announce(std::span<const IndexBox> boxes) const override { source_->announce(boxes); }
  void chooseVoxels(const CancelFlag* cancel,
                    const std::function<void(double)>& progress) override {
    const std::size_t notes = source_->info().notes.size();
    source_->chooseVoxels(cancel, progress);
    takeChoice(notes);
  }
  void chooseVoxelsAs(const VolumeInfo& chosen) override {
    const std::size_t notes = source_->info().notes.size();
    source_->chooseVoxelsAs(chosen);
    takeChoice(notes);
  }

 protected:
  SourceView(std::unique_ptr<VolumeSource> source, const std::string& what)
      : source_(std::move(source)), info_(source_->info()) {
    info_.encoding += (info_.encoding.empty() ? "" : "; ") + what;
  }

  std::unique_ptr<VolumeSource> source_;
  VolumeInfo info_;

 private:
  // The source's voxels, which it may choose later.
  virtual void takeVoxels(const VolumeInfo& chosen) {
    info_.voxel_type = chosen.voxel_type;
    info_.values = chosen.values;
    info_.range = chosen.range;
  }
  // With the notes of the source from number `first_note` on.
  void takeChoice(std::size_t first_note) {
    const VolumeInfo& chosen = source_->info();
    takeVoxels(chosen);
    info_.notes.insert(info_.notes.end(),
                       chosen.notes.begin() + static_cast<std::ptrdiff_t>(first_note),
                       chosen.notes.end());
  }
};

}  // namespace isobrick
