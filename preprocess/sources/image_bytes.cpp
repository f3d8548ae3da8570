#include "isobrick/preprocess/sources/image_bytes.h"

#include "isobrick/preprocess/byte_order.h"
#include "isobrick/preprocess/input_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

// The first bytes of a file, as many as there are.
std::string beginOf(const InputFile& file) {
  std::string begin(2048, '\0');
  begin.resize(file.readAt(0, begin.data(), begin.size()));
  return begin;
}

// 1024 bytes and an extension, whose length stands in the order that the machine stamp tells.
std::uint64_t mrcHeaderBytes(const std::string& begin) {
  constexpr std::size_t kHeader = 1024, kExtensionAt = 92, kStampAt = 212;
  if (begin.size() < kHeader) return kHeader;
  return kHeader + loadNumber<std::uint32_t>(&begin[kExtensionAt], begin[kStampAt] == 0x11);
}

// Lines of text, the last of which names the table of colours; 0 where the voxels are text too.
std::uint64_t vtkHeaderBytes(const std::string& begin) {
  if (begin.find("\nBINARY") == std::string::npos) return 0;
  std::size_t at = begin.find("\nLOOKUP_TABLE");
  if (at == std::string::npos) at = begin.find("\nSCALARS");
  const std::size_t end = at == std::string::npos ? at : begin.find('\n', at + 1);
  return end == std::string::npos ? 1 : end + 1;
}

}  // namespace

void checkImageBytes(const std::string& path, const std::string& format,
                     std::uint64_t voxel_bytes) {
  const InputFile file(path);
  std::uint64_t header_bytes = 0;
  if (format == "MRC") header_bytes = mrcHeaderBytes(beginOf(file));
  if (format == "Gipl" && lowerExtension(path) != ".gz") header_bytes = 256;
  if (format == "VTK legacy") header_bytes = vtkHeaderBytes(beginOf(file));
  if (header_bytes == 0) return;
  if (file.size() < header_bytes || file.size() - header_bytes < voxel_bytes)
    throw Error("cannot read '" + path + "': it has " + std::to_string(file.size()) +
                    " bytes, and its header takes " + std::to_string(header_bytes) +
                    " and its voxels " + std::to_string(voxel_bytes) + "; get the whole file again",
                {.path = path});
}

}  // namespace isobrick
