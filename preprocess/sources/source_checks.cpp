#include "isobrick/preprocess/sources/source_checks.h"

#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"

namespace isobrick {

std::string quotedText(const std::string& text, std::size_t most_characters) {
  std::string result(1, '\'');
  result.append(text, 0, most_characters);
  for (char& c : result)
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  result += text.size() > most_characters ? "...'" : "'";
  return result;
}

std::string quotedList(const std::vector<std::string>& names) {
  ListText list;
  for (const std::string& name : names) list.add(quotedText(name, 100));
  return list.text();
}

std::int64_t takeOne(const std::string& path, const std::string& kind,
                     std::optional<std::int64_t> wanted, std::int64_t count, VolumeInfo& info) {
  const std::int64_t taken = wanted.value_or(0);
  if (taken < 0 || taken >= count)
    throw fileError(path, "'", path, "' has the ", kind, "s 0 to ", count - 1, ", and not ", taken,
                    "; choose one of these");
  if (count == 1) return 0;
  (kind == "channel" ? info.channel : info.time_step) = OneOfSeveral{taken, count};
  info.encoding += concat(info.encoding.empty() ? "" : "; ", kind, " ", taken);
  if (!wanted) info.notes.push_back(concat("of ", count, " ", kind, "s, the first was taken"));
  return taken;
}

void checkVoxelCounts(const std::string& path, const Index3& voxels) {
  const std::string counts = "it has " + indexText(voxels, " x ") + " voxels, and isobrick ";
  for (int axis = 0; axis < 3; ++axis) {
    if (voxels[axis] < 2)
      throw unusable(path, counts, "needs at least 2 voxels per axis; choose a 3-D volume");
    if (voxels[axis] > kMaxVoxelsPerAxis)
      throw unusable(path, counts, "takes at most ", kMaxVoxelsPerAxis,
                     " per axis; check the dimensions or cut the volume");
  }
}

}  // namespace isobrick
