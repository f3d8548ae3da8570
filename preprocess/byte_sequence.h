// Numbers one after the other as bytes, and the way back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace isobrick {

// Appends arrays of numbers, or of structs of them without padding, each with its length.
class ByteSequenceWriter {
 public:
  template <typename T>
  void add(std::span<const T> items) {
    static_assert(std::has_unique_object_representations_v<T> || std::is_floating_point_v<T>);
    const std::uint64_t count = items.size();
    append(&count, sizeof count);
    append(items.data(), items.size_bytes());
  }
  std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  void append(const void* data, std::size_t bytes) {
    const std::size_t end = bytes_.size();
    bytes_.resize(end + bytes);
    if (bytes > 0) std::memcpy(bytes_.data() + end, data, bytes);
  }
  std::vector<std::byte> bytes_;
};

// Reads them again. Safe with any bytes: what is not there is empty, and isSound() is false then.
class ByteSequenceReader {
 public:
  explicit ByteSequenceReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <typename T>
  std::vector<T> take() {
    std::uint64_t count = 0;
    if (bytes_.size() < sizeof count) return refuse<T>();
    std::memcpy(&count, bytes_.data(), sizeof count);
    bytes_ = bytes_.subspan(sizeof count);
    if (count > bytes_.size() / sizeof(T)) return refuse<T>();
    std::vector<T> items(count);
    if (count > 0) std::memcpy(items.data(), bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
    return items;
  }
  // Whether all was there so far.
  bool isSound() const { return is_sound_; }
  bool isAtEnd() const { return bytes_.empty(); }

 private:
  template <typename T>
  std::vector<T> refuse() {
    is_sound_ = false;
    bytes_ = {};
    return {};
  }
  std::span<const std::byte> bytes_;
  bool is_sound_ = true;
};

}  // namespace isobrick
