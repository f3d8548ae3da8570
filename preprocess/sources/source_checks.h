// The checks of every volume source before it promises a VolumeInfo. Private to
// preprocess/sources/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/volume_source.h"

namespace isobrick {

// `text` of a file or a library in quotes, fit for a line of a message: blanks for control
// characters, and no more than `most_characters` of it.
std::string quotedText(const std::string& text, std::size_t most_characters);
// The first of some names so, for a message: "'a', 'b', ...".
std::string quotedList(const std::vector<std::string>& names);
// The same of texts as they are.
class ListText {
 public:
  explicit ListText(std::string between = ", ", std::size_t most = 12)
      : between_(std::move(between)), most_(most) {}
  // The parts of concat() are the next one.
  template <typename... Parts>
  void add(const Parts&... parts) {
    if (count_ > most_) return;
    if (count_ > 0) text_ += between_;
    text_ += count_++ == most_ ? "..." : concat(parts...);
  }
  const std::string& text() const { return text_; }

 private:
  std::string between_, text_;
  std::size_t most_, count_ = 0;
};

// The number that a choice of a `kind`, "channel" or "time step", takes out of `count`, the first
// without a choice; `info` says so if there are several. Throws Error if there are fewer.
std::int64_t takeOne(const std::string& path, const std::string& kind,
                     std::optional<std::int64_t> wanted, std::int64_t count, VolumeInfo& info);

// Throws Error unless every axis has 2 .. kMaxVoxelsPerAxis voxels. Afterwards the products of
// `voxels` with a voxel's size fit 64 bits.
void checkVoxelCounts(const std::string& path, const Index3& voxels);

}  // namespace isobrick
