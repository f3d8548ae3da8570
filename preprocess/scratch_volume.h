// Room for intermediate results of a build.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "isobrick/storage/brick_layout.h"

namespace isobrick {

// Memory for large buffers: requests huge pages, which come ten times as fast as small ones. The
// bytes are not set to anything. Throws std::bad_alloc.
class LargeBuffer {
 public:
  LargeBuffer() = default;
  explicit LargeBuffer(std::size_t bytes);
  std::byte* data() const { return data_.get(); }
  std::size_t size() const { return bytes_; }
  // data(), for so many bytes. Throws std::logic_error if the buffer has fewer: nothing is ever
  // written beyond it, however its size was computed.
  std::byte* dataFor(std::size_t bytes) const;

 private:
  struct Free {
    void operator()(std::byte* data) const;
  };
  std::unique_ptr<std::byte, Free> data_;
  std::size_t bytes_ = 0;
};

// A dense box of elements, x fastest, in memory or in a file that has no name and vanishes with
// the process. Boxes that do not overlap may be read and written by several threads at once.
class ScratchVolume {
 public:
  enum class Place { kMemory, kFile };
  // The file is made in `folder`. Throws ResumableError if that fails.
  ScratchVolume(const IndexBox& box, std::size_t element_bytes, Place place,
                const std::string& folder);
  ScratchVolume(const Index3& dims, std::size_t element_bytes, Place place,
                const std::string& folder)
      : ScratchVolume(IndexBox{Index3(0), dims}, element_bytes, place, folder) {}
  ~ScratchVolume();
  ScratchVolume(const ScratchVolume&) = delete;
  ScratchVolume& operator=(const ScratchVolume&) = delete;

  // The indices of its elements.
  const IndexBox& box() const { return box_; }
  std::size_t elementBytes() const { return element_bytes_; }
  // Copies the elements of `box` from or to a dense block. A write to a full disk throws
  // ResumableError.
  void write(const IndexBox& box, const void* elements);
  void read(const IndexBox& box, void* elements) const;

 private:
  // Calls `f(bytes from the start, bytes from the block's start, byte count)` for every run of
  // elements that lie together.
  template <typename F>
  void forRuns(const IndexBox& box, F&& f) const;

  IndexBox box_;
  std::size_t element_bytes_;
  std::string folder_;
  LargeBuffer memory_;
  int fd_ = -1;
};

}  // namespace isobrick
