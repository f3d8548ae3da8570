// Volumes without a header, and raw voxels that another file's header describes.
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/inflate_stream.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/raw_run.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/preprocess/sources/stored_file.h"
#include "isobrick/preprocess/volume_source.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// The types of a file without a header.
constexpr StoredType kRawTypes[] = {StoredType::kUint8, StoredType::kInt8,    StoredType::kUint16,
                                    StoredType::kInt16, StoredType::kFloat32, StoredType::kUint32,
                                    StoredType::kInt32, StoredType::kFloat64};

StoredType storedType(const std::string& path, const std::string& name) {
  for (const StoredType type : kRawTypes)
    if (name == infoOf(type).name || name == infoOf(type).short_name || name == infoOf(type).c_name)
      return type;
  std::string names;
  for (const std::string& known : rawTypeNames()) names += (names.empty() ? "" : ", ") + known;
  throw unreadable(path, "unknown voxel type '" + name + "'; choose one of " + names);
}

// Reads every row or box straight from the file.
class RawSource final : public VolumeSource {
 public:
  RawSource(VolumeInfo info, const RawRun& run, const StoredVoxels& stored)
      : info_(std::move(info)),
        stored_(stored),
        header_path_(run.header_path),
        offset_bytes_(run.offset_bytes),
        file_(run.path, run.header_path == run.path ? "" : run.header_path) {
    checkSize();
  }

  const VolumeInfo& info() const override { return info_; }

  bool readsBoxes() const override { return true; }
  void readBox(const IndexBox& box, void* out) const override {
    StoredBlock{file_, offset_bytes_, stored_, info_.voxels}.read(box, out);
  }
  std::vector<std::string> files() const override {
    return headerAndData(header_path_, file_.path());
  }
  std::uint64_t bufferBytes() const override {
    return stored_.keepsType() ? 0 : kDecodeBufferBytes;
  }

 private:
  // Compares the size of the file with the layout's.
  void checkSize() const {
    const auto voxel_bytes = stored_.bytesOf(elementCount(info_.voxels));
    const std::uint64_t have = file_.size();
    std::uint64_t need = 0;
    const bool overflow =
        !voxel_bytes || __builtin_add_overflow(*voxel_bytes, offset_bytes_, &need);
    const bool may_be_longer = !header_path_.empty();
    if (!overflow && (have == need || (may_be_longer && have > need))) return;
    const std::string needed = overflow ? "more than 2^64" : std::to_string(need);
    const std::string sizes = "cannot read '" + file_.path() + "': it has " + std::to_string(have) +
                              " bytes, but an offset of " + std::to_string(offset_bytes_) +
                              " and " + indexText(info_.voxels, " x ") + " voxels of " +
                              std::to_string(stored_.bytes()) +
                              (stored_.bytes() == 1 ? " byte make " : " bytes make ") + needed;
    if (!header_path_.empty())
      throw Error(sizes + " (from the header '" + header_path_ + "'); get the whole file again",
                  {.path = header_path_});
    throw Error(
        sizes + "; correct the layout" + (overflow || have < need ? ", or get the whole file" : ""),
        {.path = file_.path()}, {Remedy::kCorrectRawLayout});
  }

  VolumeInfo info_;
  StoredVoxels stored_;
  std::string header_path_;  // empty if the user described the file
  std::uint64_t offset_bytes_;
  InputFile file_;
};

}  // namespace

std::vector<std::string> rawTypeNames() {
  std::vector<std::string> names;
  for (const StoredType type : kRawTypes) names.emplace_back(infoOf(type).short_name);
  return names;
}

std::unique_ptr<VolumeSource> openRawSource(const std::string& path, const RawLayout& layout) {
  StoredVoxels stored;
  stored.type = storedType(path, layout.type);
  stored.big_endian = layout.big_endian;
  checkVoxelCounts(path, layout.voxels);
  VolumeInfo info;
  info.voxels = layout.voxels;
  info.voxel_type = stored.delivered();
  info.source = path;
  info.format = "raw";
  info.encoding = layout.type + (layout.big_endian ? " big-endian" : " little-endian") +
                  " at byte " + std::to_string(layout.offset_bytes);
  tidyGeometry(path, info.geometry, info.voxels, info.notes);
  RawRun run;
  run.path = path;
  run.offset_bytes = layout.offset_bytes;
  return std::make_unique<RawSource>(std::move(info), run, stored);
}

std::unique_ptr<VolumeSource> openRawRun(VolumeInfo info, const RawRun& run,
                                         const StoredVoxels& stored, const CancelFlag* cancel) {
  if (!run.is_deflated) return std::make_unique<RawSource>(std::move(info), run, stored);
  auto file = std::make_shared<const InputFile>(run.path,
                                                run.header_path == run.path ? "" : run.header_path);
  return openStream(std::move(info), stored,
                    makeInflateStream(run.path, makeFileStream(std::move(file), run.offset_bytes)),
                    run.content_offset_bytes, headerAndData(run.header_path, run.path), {}, cancel);
}

std::vector<std::string> headerAndData(const std::string& header_path,
                                       const std::string& data_path) {
  if (header_path.empty() || header_path == data_path) return {data_path};
  return {header_path, data_path};
}

}  // namespace isobrick
