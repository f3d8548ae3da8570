// The mesh formats behind makeMeshFileSink(), and how they put numbers into bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <string_view>

#include "isobrick/extract/sinks/mesh_file_sink.h"

namespace isobrick {

// Writes the bytes of values, as this machine has them, into memory that is large enough.
class BytePointer {
 public:
  explicit BytePointer(std::byte* at) : at_(at) {}
  template <typename... Values>
  void put(Values... values) {
    (putOne(values), ...);
  }

 private:
  template <typename V>
  void putOne(V value) {
    std::memcpy(at_, &value, sizeof value);
    at_ += sizeof value;
  }
  std::byte* at_;
};

std::unique_ptr<MeshFileSink> makePlySink(const std::string& path, const MeshFileOptions& options);
std::unique_ptr<MeshFileSink> makeStlSink(const std::string& path, const MeshFileOptions& options);
std::unique_ptr<MeshFileSink> makeObjSink(const std::string& path, const MeshFileOptions& options);
std::unique_ptr<MeshFileSink> makeGlbSink(const std::string& path, const MeshFileOptions& options);
std::unique_ptr<MeshFileSink> makeVtpSink(const std::string& path, const MeshFileOptions& options);

// A .glb with --meshopt. With the greatest length of a file: tests lower it.
inline constexpr std::uint64_t kMostGlbBytes = std::numeric_limits<std::uint32_t>::max();
std::unique_ptr<MeshFileSink> makeMeshoptSink(const std::string& path,
                                              const MeshFileOptions& options,
                                              std::uint64_t most_bytes = kMostGlbBytes);

// With the greatest count that indices of 32 bits are used for: tests lower it.
std::unique_ptr<MeshFileSink> makeVtpSink(const std::string& path, const MeshFileOptions& options,
                                          std::uint64_t most_narrow);

// The text of headers on coordinates, beside their unit.
inline constexpr std::string_view kMeshSpace = "LPS";

// "X Y Z", with digits that read back as the same numbers.
std::string shiftText(const glm::dvec3& shift);

}  // namespace isobrick
