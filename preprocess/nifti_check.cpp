#include "preprocess/nifti_check.h"

#include <zlib.h>

#include <filesystem>
#include <memory>
#include <vector>

#include "storage/error.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

// "head.hdr" and "head.hdr.gz" keep their voxels in "head.img" or "head.img.gz".
std::string dataPath(const std::string& path) {
  std::string stem = path;
  if (stem.ends_with(".gz")) stem.resize(stem.size() - 3);
  if (!stem.ends_with(".hdr")) return path;
  stem.resize(stem.size() - 4);
  for (const char* ending : {".img", ".img.gz"})
    if (fs::exists(stem + ending)) return stem + ending;
  return path;
}

struct GzipClose {
  void operator()(gzFile_s* file) const { gzclose(file); }
};

}  // namespace

void checkNiftiWhole(const std::string& path, std::uint64_t needed_bytes) {
  const std::string data_path = dataPath(path);
  // Reads files that are not gzipped as they are.
  const std::unique_ptr<gzFile_s, GzipClose> file(gzopen(data_path.c_str(), "rb"));
  if (!file) throw Error("cannot open '" + data_path + "'; check the path and its permissions");
  constexpr unsigned kBufferBytes = 1 << 18;
  gzbuffer(file.get(), kBufferBytes);
  std::uint64_t bytes = 0;
  const bool is_plain = gzdirect(file.get()) != 0;
  if (is_plain) {
    bytes = fs::file_size(data_path);
  } else {
    std::vector<unsigned char> buffer(kBufferBytes);
    int got = 0;
    while ((got = gzread(file.get(), buffer.data(), kBufferBytes)) > 0)
      bytes += static_cast<std::uint64_t>(got);
    int error = Z_OK;
    gzerror(file.get(), &error);
    if (error != Z_OK && error != Z_STREAM_END)
      throw Error("cannot read '" + data_path + "': its gzip data are cut short or damaged after " +
                  std::to_string(bytes) + " bytes of content; get the whole file again");
  }
  if (bytes < needed_bytes)
    throw Error("cannot read '" + data_path + "': it has " + std::to_string(bytes) +
                (is_plain ? " bytes" : " bytes of content") + " and its header needs " +
                std::to_string(needed_bytes) + "; get the whole file again");
}

}  // namespace isobrick
