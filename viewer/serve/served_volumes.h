// The volumes that a server has, opened when somebody asks for them.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "isobrick/storage/remote_options.h"
#include "isobrick/viewer/session/volume_opener.h"

namespace isobrick {

struct ServedVolume {
  std::string name;  // that clients see
  std::string path;  // of a pyramid or a volume, or a URL
};

// Belongs to one thread. None of its members but the destructor waits for an opening.
class ServedVolumes {
 public:
  // So many are open at once, and share the memory; one that nobody uses is closed for another.
  static constexpr std::size_t kMostOpen = 4;

  // As VolumeOpener has them; `build` is called by one thread at a time for each volume.
  ServedVolumes(std::vector<ServedVolume> volumes, VolumeBuilder build, std::uint64_t memory_bytes,
                const RemoteOptions& remote);

  std::size_t count() const { return volumes_.size(); }
  std::size_t openCount() const;
  const std::string& pathOf(std::size_t volume) const { return volumes_[volume].served.path; }
  // The volume if it is open; else it begins to be opened, unless that has just failed. One whose
  // file was replaced is opened anew; who uses it keeps the old one. Sets `error` if it cannot be
  // opened now.
  std::shared_ptr<const OpenedVolume> open(std::size_t volume, std::string& error);
  // The same without opening it.
  std::shared_ptr<const OpenedVolume> find(std::size_t volume) const {
    return volumes_[volume].opened;
  }
  bool isOpening(std::size_t volume) const { return volumes_[volume].opener != nullptr; }
  // Its last opening failed.
  bool isFailed(std::size_t volume) const { return !volumes_[volume].error.empty(); }
  // Takes what was opened.
  void update();
  // Its row in the list: docs/SERVE.md, "Requests".
  nlohmann::ordered_json entryOf(std::size_t volume) const;
  // The object of GET /api/volume/N; the volume is open.
  nlohmann::ordered_json factsOf(std::size_t volume) const;

 private:
  struct Volume {
    ServedVolume served;
    std::shared_ptr<const OpenedVolume> opened = {};
    std::unique_ptr<VolumeOpener> opener = {};  // while it is opened
    std::string error = {};
    std::string file = {};                                // when its opening began
    std::chrono::steady_clock::time_point last_use = {};  // or failure
  };
  bool makeRoom();

  const VolumeBuilder build_;
  const std::uint64_t memory_bytes_;  // of each
  const RemoteOptions remote_;
  std::vector<Volume> volumes_;
};

// Another one for another file, also of the same name.
std::string editionOf(const OpenedVolume& volume);

// The number of the volume and what is asked of it, for "/api/volume/12/slice.png"; nothing for
// another path.
struct VolumePath {
  std::size_t volume = 0;
  std::string_view rest;  // "/slice.png"
};
std::optional<VolumePath> volumePathOf(std::string_view path);

}  // namespace isobrick
