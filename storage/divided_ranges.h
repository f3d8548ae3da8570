// Ranges of all files of a divided pyramid, as if they were one file.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "isobrick/storage/abandonable.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/range_reader.h"

namespace isobrick {

// Offsets are those of PyramidDivision; bytes between files are zero. A file is opened when its
// bytes are first asked for, and must be the one that was joined; kMostOpen of them stay open.
class DividedRanges final : public RangeReader {
 public:
  static constexpr std::size_t kMostOpen = 256, kMostOpenRemote = 128;
  // Threads that wait for a server to open a file that was only announced.
  static constexpr std::size_t kMostOpeners = 16;

  // Opens a file of this name, or throws Error. A request to `cancel` ends that.
  using Open = std::function<std::unique_ptr<RangeReader>(const std::string& path,
                                                          const CancelFlag& cancel)>;
  struct Files {
    std::shared_ptr<const PyramidDivision> division;
    std::function<std::string(const std::string& name)> path_of;  // of a file in the folder
    Open open;
    bool are_remote = false;
  };
  DividedRanges(std::unique_ptr<RangeReader> index, Files files);
  ~DividedRanges() override;

  std::uint64_t size() const override { return files_.division->endOffset(); }
  void read(const ByteRange& range, std::byte* out) override;
  void announce(std::span<const ByteRange> ranges) override;
  void abandon() override;
  std::string identity() const override { return index_->identity(); }
  RemoteCounters counters() const override;

  // The file with an offset and the offset in it; nothing if it is the index's.
  struct Place {
    std::string path;
    std::uint64_t offset = 0;
  };
  std::optional<Place> place(std::uint64_t offset) const;

 private:
  class SuperBrickFile;
  std::shared_ptr<SuperBrickFile> fileOf(std::size_t number);
  std::shared_ptr<SuperBrickFile> takeLeastUsed();

  // Shared by files that are being opened.
  struct Openers {
    CancelFlag abandoned;
    LoadThreads threads{kMostOpeners};
  };

  const std::unique_ptr<RangeReader> index_;
  const Files files_;
  mutable std::mutex mutex_;                                     // guards all below
  std::map<std::size_t, std::shared_ptr<SuperBrickFile>> open_;  // by number
  std::uint64_t uses_ = 0;
  RemoteCounters of_closed_;
  Openers openers_;  // last: its threads use all of the above
};

}  // namespace isobrick
