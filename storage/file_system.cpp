#include "isobrick/storage/file_system.h"

#include <new>

#include "isobrick/storage/error.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

namespace fs = std::filesystem;

fs::file_status statusOf(const fs::path& path) {
  std::error_code ignored;
  return fs::status(path, ignored);
}

}  // namespace

bool isPresent(const fs::path& path) { return fs::exists(statusOf(path)); }

bool isRegularFile(const fs::path& path) { return fs::is_regular_file(statusOf(path)); }

bool isFolder(const fs::path& path) { return fs::is_directory(statusOf(path)); }

bool isSpecialFile(const fs::path& path) { return fs::is_other(statusOf(path)); }

bool isNameTaken(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(fs::symlink_status(path, ignored));
}

bool isLink(const fs::path& path) {
  std::error_code ignored;
  return fs::is_symlink(fs::symlink_status(path, ignored));
}

bool isSameFile(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  return fs::equivalent(a, b, ignored);
}

std::uint64_t fileBytes(const fs::path& path) {
  std::error_code failure;
  const std::uintmax_t bytes = fs::file_size(path, failure);
  if (failure)
    throw Error("cannot find out the size of '" + path.string() + "': " + failure.message() +
                    "; leave it in its place until the run ends",
                {.path = path.string()});
  return bytes;
}

std::optional<DiskSpace> diskSpaceAt(const fs::path& path) {
  std::error_code failure;
  const fs::space_info space = fs::space(path, failure);
  if (failure || space.capacity == 0) return std::nullopt;
  return DiskSpace{space.available, space.capacity};
}

fs::path absolutePath(const fs::path& path) {
  std::error_code failure;
  const fs::path whole = fs::absolute(path, failure);
  if (failure)
    throw Error("cannot find '" + path.string() + "': the current folder: " + failure.message() +
                    "; change to one that is there, or give the whole path",
                {.path = path.string()});
  return whole.lexically_normal();
}

fs::path canonicalPath(const fs::path& path) {
  std::error_code failure;
  fs::path whole = fs::weakly_canonical(path, failure);
  return failure ? path : whole;
}

fs::path linkTarget(const fs::path& path) {
  std::error_code ignored;
  return fs::read_symlink(path, ignored);
}

fs::path temporaryFolder() {
  std::error_code failure;
  fs::path folder = fs::temp_directory_path(failure);
  return failure ? fs::path("/tmp") : folder;
}

std::error_code makeFolders(const fs::path& folder) {
  std::error_code failure;
  fs::create_directories(folder, failure);
  return failure;
}

std::error_code linkOrCopyFile(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to, error);
  return error;
}

std::error_code removeName(const fs::path& path) {
  std::error_code failure;
  fs::remove(path, failure);
  return failure;
}

void removeTree(const fs::path& path) noexcept try {
  std::error_code ignored;
  fs::remove_all(path, ignored);
} catch (const std::bad_alloc&) {  // to look into a folder takes memory
}

bool FolderMember::isRegularFile() const {
  std::error_code ignored;
  return entry_.is_regular_file(ignored);
}

bool FolderMember::isFolder() const {
  std::error_code ignored;
  return entry_.is_directory(ignored);
}

bool FolderMember::isLink() const {
  std::error_code ignored;
  return entry_.is_symlink(ignored);
}

std::error_code visitFolder(const fs::path& folder,
                            const std::function<bool(const FolderMember& member)>& visit) {
  std::error_code failure;
  for (fs::directory_iterator entry(folder, failure), end; !failure && entry != end;
       entry.increment(failure))
    if (!visit(FolderMember(*entry))) break;
  return failure;
}

bool holdsNothingBut(const fs::path& folder,
                     const std::function<bool(const FolderMember& member)>& is_own) {
  bool holds_other = false;
  const std::error_code failure = visitFolder(folder, [&](const FolderMember& member) {
    holds_other = !is_own(member);
    return !holds_other;
  });
  return !failure && !holds_other;
}

namespace {

constexpr const char* kEndings[] = {".h5", ".hdf5", ".hdf", ".he5", ".nxs", ".nc", ".ims", ".mat"};

}  // namespace

std::pair<std::string, std::string> splitHdf5Name(const std::string& name) {
  for (const char* ending : kEndings) {
    if (lowercase(name).ends_with(ending)) return {name, ""};
    const std::size_t at = lowercase(name).rfind(std::string(ending) + ":/");
    if (at != std::string::npos) {
      const std::size_t colon = at + std::string(ending).size();
      return {name.substr(0, colon), name.substr(colon + 1)};
    }
  }
  return {name, ""};
}

bool isHdf5Name(const std::string& name) {
  const std::string file = lowercase(splitHdf5Name(name).first);
  for (const char* ending : kEndings)
    if (file.ends_with(ending)) return true;
  return false;
}

}  // namespace isobrick
