// The volumes that a server has, opened when somebody asks for them.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
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
  using Opened = std::shared_ptr<const OpenedVolume>;
  // So many are open at once, and share the memory; one that nobody uses is closed for another.
  static constexpr std::size_t kMostOpen = 4;

  // As VolumeOpener has them; `build` is called by one thread at a time for each volume.
  ServedVolumes(const std::vector<ServedVolume>& volumes, VolumeBuilder build,
                std::uint64_t memory_bytes, const RemoteOptions& remote);

  std::size_t count() const { return volumes_.size(); }
  std::size_t openCount() const;
  const std::string& pathOf(std::size_t volume) const { return volumes_[volume].served.path; }
  // The volume if it is open; else null, and it begins to be opened. One whose file was replaced is
  // opened anew; who uses it keeps the old one. Throws Refusal (asked.h): with 500 if its opening
  // has just failed, with 503 if others are in use.
  Opened open(std::size_t volume);
  // The same without opening it.
  Opened find(std::size_t volume) const { return volumes_[volume].opened; }
  // Takes what was opened.
  void update();
  // Its row in the list: docs/SERVE.md, "Requests".
  nlohmann::ordered_json entryOf(std::size_t volume) const;
  // The object of GET /api/volume/N; the volume is open.
  nlohmann::ordered_json factsOf(std::size_t volume) const;

 private:
  struct Volume {
    ServedVolume served;
    Opened opened = {};
    std::unique_ptr<VolumeOpener> opener = {};            // while it is opened
    std::string error = {};                               // of its last opening
    std::string file = {};                                // when that began
    std::chrono::steady_clock::time_point last_use = {};  // or failure
  };
  void makeRoom();

  const VolumeBuilder build_;
  const std::uint64_t memory_bytes_;  // of each
  const RemoteOptions remote_;
  std::vector<Volume> volumes_;
};

// Another one for another file, also of the same name.
std::string editionOf(const OpenedVolume& volume);

}  // namespace isobrick
