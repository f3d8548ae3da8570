// The mesh formats behind makeMeshFileSink(), and how they put numbers into bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>

#include "isobrick/extract/sinks/mesh_collection.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/storage/error.h"

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
std::unique_ptr<MeshFileSink> makeThreeMfSink(const std::string& path,
                                              const MeshFileOptions& options);

// makeMeshCollection() for the ending.
std::unique_ptr<MeshCollection> makeThreeMfCollection(const std::string& path,
                                                      const MeshFileOptions& options);
std::unique_ptr<MeshCollection> makeGlbCollection(const std::string& path,
                                                  const MeshFileOptions& options);

// A .glb with --meshopt. With the greatest length of a file: tests lower it.
inline constexpr std::uint64_t kMostGlbBytes = std::numeric_limits<std::uint32_t>::max();
std::unique_ptr<MeshFileSink> makeMeshoptSink(const std::string& path,
                                              const MeshFileOptions& options,
                                              std::uint64_t most_bytes = kMostGlbBytes);

// With the greatest count that indices of 32 bits are used for: tests lower it.
std::unique_ptr<MeshFileSink> makeVtpSink(const std::string& path, const MeshFileOptions& options,
                                          std::uint64_t most_narrow);

// "'PATH': WHAT"
inline Error meshError(const std::string& path, const std::string& what) {
  return Error("'" + path + "': " + what, {.path = path});
}

// A row of the table of formats.
struct MeshFormat {
  const char* extension;
  std::unique_ptr<MeshFileSink> (*make)(const std::string& path, const MeshFileOptions& options);
  bool has_attributes, has_colors, has_zlib, has_meshopt;
  // Null: a file holds one surface.
  std::unique_ptr<MeshCollection> (*make_several)(const std::string& path,
                                                  const MeshFileOptions& options) = nullptr;
};
// Of a file's name. Throws Error for other endings, and for options that the format does not take.
const MeshFormat& meshFormatOf(const std::string& path, const MeshFileOptions& options);

// "X Y Z", with digits that read back as the same numbers.
std::string shiftText(const glm::dvec3& shift);

}  // namespace isobrick
