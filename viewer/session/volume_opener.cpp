#include "isobrick/viewer/session/volume_opener.h"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>

#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/pyramid_file.h"

namespace isobrick {

namespace {
constexpr std::uint64_t kPreviewMemory = std::uint64_t{64} << 20;  // more than it takes
}

OpenedVolume openPyramid(const std::string& path, std::uint64_t memory_bytes,
                         const RemoteOptions& remote, const CancelFlag* cancel, FileAccess access) {
  return runAbandonable(isRemotePath(path) ? cancel : nullptr, [=] {
    auto file = std::make_shared<const Pyramid>(path, memory_bytes, access, remote);
    ValueHistogram histogram = histogramOf(*file);
    return OpenedVolume{path, path, {}, std::move(file), std::move(histogram)};
  });
}

VolumeOpener::VolumeOpener(VolumeBuilder build, std::uint64_t memory_bytes,
                           const RemoteOptions& remote)
    : build_(std::move(build)),
      memory_bytes_(memory_bytes),
      remote_(remote),
      worker_([this](const std::string& source, const CancelFlag& cancel) {
        return work(source, cancel);
      }) {}

void VolumeOpener::open(const std::string& source) {
  const std::lock_guard lock(mutex_);
  worker_.request(source);
  preview_.reset();
}

void VolumeOpener::cancel() {
  const std::lock_guard lock(mutex_);
  worker_.cancel();
  preview_.reset();
}

void VolumeOpener::choose(std::size_t number) {
  const std::lock_guard lock(mutex_);
  if (number >= progress_.choices.size()) return;
  chosen_ = number;
  progress_.choices.clear();
}

std::size_t VolumeOpener::waitForChoice(const std::string& refusal,
                                        const std::vector<std::string>& choices,
                                        const CancelFlag& cancel) {
  constexpr std::chrono::milliseconds kLook{20};
  std::unique_lock lock(mutex_);
  chosen_.reset();
  progress_.choices = choices;
  progress_.refusal = refusal;
  progress_.phase.clear();
  while (!chosen_ && !cancel.requested()) {
    lock.unlock();
    std::this_thread::sleep_for(kLook);
    lock.lock();
  }
  progress_.choices.clear();
  cancel.check();
  return *chosen_;
}

std::optional<VolumeOpener::Outcome> VolumeOpener::poll() {
  auto outcome = worker_.poll();
  if (!outcome) return std::nullopt;
  return Outcome{std::move(outcome->request), std::move(outcome->result),
                 std::move(outcome->error)};
}

std::optional<OpenedVolume> VolumeOpener::takePreview() {
  const std::lock_guard lock(mutex_);
  return std::exchange(preview_, std::nullopt);
}

VolumeOpener::Status VolumeOpener::status() const {
  const std::lock_guard lock(mutex_);
  Status status = progress_;
  status.busy = worker_.busy();
  return status;
}

OpenedVolume VolumeOpener::work(const std::string& source, const CancelFlag& cancel) {
  const auto tell = [&](std::string_view phase, double share) {
    const std::lock_guard lock(mutex_);
    progress_ = {true, source, std::string(phase), std::clamp(share, 0.0, 1.0)};
  };
  const auto take = [&](const std::string& path, const PreviewOf& preview_of) {
    takeIn(path, preview_of, source, cancel);
  };
  const auto choose = [&](const std::string& refusal, const std::vector<std::string>& choices) {
    return waitForChoice(refusal, choices, cancel);
  };
  tell("", 0.0);
  const std::string path =
      isPyramidFile(source) ? source : build_(source, {tell, take, choose}, cancel);
  tell("", 1.0);
  cancel.check();
  OpenedVolume opened = openPyramid(path, memory_bytes_, remote_, &cancel);
  opened.source = source;
  return opened;
}

void VolumeOpener::takeIn(const std::string& path, const PreviewOf& preview_of,
                          const std::string& source, const CancelFlag& cancel) {
  try {
    OpenedVolume preview = openPyramid(path, std::min(memory_bytes_, kPreviewMemory));
    preview.source = source;
    preview.pyramid.clear();
    preview.preview_of = preview_of;
    // It is open: its name is not needed any more.
    removeName(path);
    const std::lock_guard lock(mutex_);
    if (!cancel.requested()) preview_ = std::move(preview);
  } catch (const Error&) {  // the next one, or the volume itself, will do
  }
}

}  // namespace isobrick
