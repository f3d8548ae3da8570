#include "isobrick/storage/write_journal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {
namespace {

// Followed by the identity's bytes, then the checksum of both.
struct JournalHeader {
  char magic[sizeof kJournalMagic];
  std::uint64_t identity_bytes;
};
// No writer makes longer identities.
constexpr std::uint64_t kMostIdentityBytes = std::uint64_t{1} << 20;

std::uint64_t checksumOf(const JournalEntry& entry) {
  return checksum64(&entry, offsetof(JournalEntry, checksum));
}

// What has the name is removed, and not written to: it may be a second name of another file.
int openNew(const std::string& path) {
  unlink(path.c_str());
  return open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0666);
}

std::string headerOf(const std::string& identity) {
  JournalHeader header = {};
  std::memcpy(header.magic, kJournalMagic, sizeof kJournalMagic);
  header.identity_bytes = identity.size();
  std::string text(reinterpret_cast<const char*>(&header), sizeof header);
  text += identity;
  const std::uint64_t checksum = checksum64(text.data(), text.size());
  text.append(reinterpret_cast<const char*>(&checksum), sizeof checksum);
  return text;
}

}  // namespace

std::optional<WriteJournal::Content> WriteJournal::read(const std::string& path) {
  // Without waiting (a pipe of that name would wait for ever) and without following links.
  const OpenDescriptor file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC));
  struct stat status = {};
  if (file.get() < 0 || fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode))
    return std::nullopt;
  const auto readAt = [&](std::uint64_t offset, void* to, std::size_t bytes) {
    return readBytesAt(file.get(), offset, to, bytes).bytes == bytes;
  };
  JournalHeader header = {};
  if (!readAt(0, &header, sizeof header) ||
      std::memcmp(header.magic, kJournalMagic, sizeof header.magic) != 0 ||
      header.identity_bytes > kMostIdentityBytes)
    return std::nullopt;
  Content content;
  content.identity.resize(header.identity_bytes);
  std::uint64_t at = sizeof header, checksum = 0;
  if (!readAt(at, content.identity.data(), header.identity_bytes) ||
      !readAt(at + header.identity_bytes, &checksum, sizeof checksum))
    return std::nullopt;
  const std::string expected = headerOf(content.identity);
  if (!isChecksum(checksum64(expected.data(), expected.size() - sizeof checksum), checksum))
    return std::nullopt;
  JournalEntry entry;
  for (at = expected.size();
       readAt(at, &entry, sizeof entry) && isChecksum(checksumOf(entry), entry.checksum);
       at += sizeof entry)
    content.entries.push_back(entry);
  return content;
}

WriteJournal::WriteJournal(const std::string& path, const std::string& identity,
                           const std::vector<JournalEntry>& entries)
    : path_(path), file_(openNew(path + ".new")) {
  // A new file takes the place of the old one in one step: a kill, or a loss of power, between
  // leaves one of them.
  const std::string fresh = path + ".new";
  if (file_.get() < 0)
    throw ResumableError("cannot write '" + fresh + "': " + std::strerror(errno) +
                             "; choose a folder that you may write to",
                         {.path = fresh});
  try {
    const std::string header = headerOf(identity);
    writeAll(header.data(), header.size());
    writeAll(entries.data(), entries.size() * sizeof(JournalEntry));
    int error = 0;
    if (fsync(file_.get()) != 0 || std::rename(fresh.c_str(), path.c_str()) != 0) error = errno;
    if (error == 0) error = syncFolderOf(path);
    if (error != 0)
      throw ResumableError(
          "cannot write '" + path + "': " + std::strerror(error) + "; check the folder",
          {.path = path});
  } catch (...) {
    unlink(fresh.c_str());
    throw;
  }
}

void WriteJournal::add(const BrickRow& row, std::uint64_t end) {
  JournalEntry entry;
  entry.row = row;
  entry.end = end;
  entry.checksum = checksumOf(entry);
  pending_.push_back(entry);
}

void WriteJournal::flush() {
  writeAll(pending_.data(), pending_.size() * sizeof(JournalEntry));
  pending_.clear();
}

void WriteJournal::remove() noexcept {
  struct stat named = {}, opened = {};
  if (stat(path_.c_str(), &named) == 0 && fstat(file_.get(), &opened) == 0 &&
      named.st_dev == opened.st_dev && named.st_ino == opened.st_ino)
    unlink(path_.c_str());
}

void WriteJournal::writeAll(const void* data, std::size_t bytes) {
  const IoResult result = writeNextBytes(file_.get(), data, bytes);
  if (result.error != 0)
    throw ResumableError("cannot write '" + path_ + "': " + std::strerror(result.error) +
                             "; free some space or choose another folder",
                         {.path = path_});
}

}  // namespace isobrick
