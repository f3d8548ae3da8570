#include "isobrick/viewer/session/volume_opener.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <utility>

#include "isobrick/storage/format.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {

namespace fs = std::filesystem;

bool isPyramidFile(const std::string& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return false;
  if (lowerExtension(path) == ".isb") return true;
  char magic[sizeof format::kMagic] = {};
  std::ifstream file(path, std::ios::binary);
  return file.read(magic, sizeof magic) &&
         std::equal(std::begin(magic), std::end(magic), std::begin(format::kMagic));
}

OpenedVolume openPyramid(const std::string& path, std::uint64_t memory_bytes) {
  auto file = std::make_shared<const Pyramid>(path, memory_bytes);
  ValueHistogram histogram = histogramOf(*file);
  return {path, path, std::move(file), std::move(histogram)};
}

VolumeOpener::VolumeOpener(VolumeBuilder build, std::uint64_t memory_bytes)
    : build_(std::move(build)),
      memory_bytes_(memory_bytes),
      worker_([this](const std::string& source, const CancelFlag& cancel) {
        return work(source, cancel);
      }) {}

void VolumeOpener::open(const std::string& source) { worker_.request(source); }
void VolumeOpener::cancel() { worker_.cancel(); }

std::optional<VolumeOpener::Outcome> VolumeOpener::poll() {
  auto outcome = worker_.poll();
  if (!outcome) return std::nullopt;
  return Outcome{outcome->request, std::move(outcome->result), outcome->error};
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
  tell("", 0.0);
  const std::string path = isPyramidFile(source) ? source : build_(source, tell, cancel);
  tell("", 1.0);
  cancel.check();
  OpenedVolume opened = openPyramid(path, memory_bytes_);
  opened.source = source;
  return opened;
}

}  // namespace isobrick
