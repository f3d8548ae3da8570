// What a name in the file system leads to, and changes of names: the one place that calls
// std::filesystem for that, whose exceptions are no Error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <system_error>
#include <utility>

namespace isobrick {

// Of what the path leads to, through links. False also if that cannot be found out: opening it
// then says why.
bool isPresent(const std::filesystem::path& path);
bool isRegularFile(const std::filesystem::path& path);
bool isFolder(const std::filesystem::path& path);
// A pipe or a device: opening it may wait for ever.
bool isSpecialFile(const std::filesystem::path& path);

// Of the name itself: a link that leads nowhere is there, too.
bool isNameTaken(const std::filesystem::path& path);
bool isLink(const std::filesystem::path& path);

// Both are there, and are one.
bool isSameFile(const std::filesystem::path& a, const std::filesystem::path& b);

// Throws Error if it cannot be found out.
std::uint64_t fileBytes(const std::filesystem::path& path);
// Bytes of the file system of `path`; nothing if it cannot tell.
struct DiskSpace {
  std::uint64_t free = 0;  // for any user
  std::uint64_t capacity = 0;
};
std::optional<DiskSpace> diskSpaceAt(const std::filesystem::path& path);

// From the root on, without "." and "..". Throws Error if the current folder is gone.
std::filesystem::path absolutePath(const std::filesystem::path& path);
// The same without links, as far as it can be followed; else the path as it stands.
std::filesystem::path canonicalPath(const std::filesystem::path& path);
// Empty for what is no link.
std::filesystem::path linkTarget(const std::filesystem::path& path);
// $TMPDIR, or /tmp.
std::filesystem::path temporaryFolder();

// Makes the folder and those above it, unless they are there. The caller says in its own words
// what failed.
[[nodiscard]] std::error_code makeFolders(const std::filesystem::path& folder);
// A second name of the file, or a copy where the file system has no such names; `to` is not there.
[[nodiscard]] std::error_code linkOrCopyFile(const std::filesystem::path& from,
                                             const std::filesystem::path& to);
// Removes a file or an empty folder, if it is there.
std::error_code removeName(const std::filesystem::path& path);
// Removes it with all that is in it, as far as that can be done.
void removeTree(const std::filesystem::path& path) noexcept;

// A file, a folder or a link in a folder.
class FolderMember {
 public:
  explicit FolderMember(const std::filesystem::directory_entry& entry) : entry_(entry) {}
  const std::filesystem::path& path() const { return entry_.path(); }
  std::string name() const { return entry_.path().filename().string(); }
  // Through links, as of a path; costs no call for most file systems.
  bool isRegularFile() const;
  bool isFolder() const;
  bool isLink() const;

 private:
  const std::filesystem::directory_entry& entry_;
};

// Calls `visit` for each member in any order, until it returns false. Members may come and go
// meanwhile. The error is why the folder could not be read to its end.
std::error_code visitFolder(const std::filesystem::path& folder,
                            const std::function<bool(const FolderMember& member)>& visit);

// True if every member of the folder is of these; false if it cannot be read to its end.
bool holdsNothingBut(const std::filesystem::path& folder,
                     const std::function<bool(const FolderMember& member)>& is_own);

// Splits "scan.h5:/entry/data" into its file and its dataset, which is empty if none is named; the
// whole word is the file if it has no such form (.h5, .hdf5, .hdf, .he5, .nxs, .nc, .ims, .mat).
std::pair<std::string, std::string> splitHdf5Name(const std::string& name);
// Whether the file has one of these endings.
bool isHdf5Name(const std::string& name);

}  // namespace isobrick
