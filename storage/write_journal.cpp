#include "isobrick/storage/write_journal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>

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

// Opened without waiting (a pipe of that name would wait for ever) and without following links.
class RegularFile {
 public:
  explicit RegularFile(const std::string& path)
      : fd_(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC)) {
    struct stat status = {};
    is_regular_ = fd_ >= 0 && fstat(fd_, &status) == 0 && S_ISREG(status.st_mode);
  }
  ~RegularFile() {
    if (fd_ >= 0) close(fd_);
  }
  RegularFile(const RegularFile&) = delete;
  RegularFile& operator=(const RegularFile&) = delete;

  bool isOpen() const { return is_regular_; }
  // False if the file has fewer bytes, or cannot be read.
  bool read(void* to, std::size_t bytes, std::uint64_t offset) const {
    return readBytesAt(fd_, offset, to, bytes).bytes == bytes;
  }

 private:
  int fd_;
  bool is_regular_ = false;
};

}  // namespace

std::optional<WriteJournal::Content> WriteJournal::read(const std::string& path) {
  const RegularFile file(path);
  JournalHeader header = {};
  char magic[sizeof header.magic];
  if (!file.isOpen() || !file.read(magic, sizeof magic, 0) ||
      std::memcmp(magic, kJournalMagic, sizeof magic) != 0 ||
      !file.read(&header.identity_bytes, sizeof header.identity_bytes, sizeof magic) ||
      header.identity_bytes > kMostIdentityBytes)
    return std::nullopt;
  Content content;
  content.identity.resize(header.identity_bytes);
  std::uint64_t at = sizeof header, checksum = 0;
  if (!file.read(content.identity.data(), header.identity_bytes, at) ||
      !file.read(&checksum, sizeof checksum, at + header.identity_bytes))
    return std::nullopt;
  const std::string expected = headerOf(content.identity);
  if (std::memcmp(expected.data() + expected.size() - sizeof checksum, &checksum,
                  sizeof checksum) != 0)
    return std::nullopt;
  JournalEntry entry;
  for (at = expected.size();
       file.read(&entry, sizeof entry, at) && entry.checksum == checksumOf(entry);
       at += sizeof entry)
    content.entries.push_back(entry);
  return content;
}

WriteJournal::WriteJournal(const std::string& path, const std::string& identity,
                           const std::vector<JournalEntry>& entries)
    : path_(path) {
  // A new file takes the place of the old one in one step: a kill between leaves one of them.
  const std::string fresh = path + ".new";
  fd_ = open(fresh.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (fd_ < 0)
    throw ResumableError("cannot write '" + fresh + "': " + std::strerror(errno) +
                             "; choose a folder that you may write to",
                         {.path = fresh});
  try {
    const std::string header = headerOf(identity);
    writeAll(header.data(), header.size());
    writeAll(entries.data(), entries.size() * sizeof(JournalEntry));
    if (std::rename(fresh.c_str(), path.c_str()) != 0)
      throw ResumableError(
          "cannot write '" + path + "': " + std::strerror(errno) + "; check the folder",
          {.path = path});
  } catch (...) {
    unlink(fresh.c_str());
    close(fd_);
    throw;
  }
}

WriteJournal::~WriteJournal() { close(fd_); }

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
  if (stat(path_.c_str(), &named) == 0 && fstat(fd_, &opened) == 0 &&
      named.st_dev == opened.st_dev && named.st_ino == opened.st_ino)
    unlink(path_.c_str());
}

void WriteJournal::writeAll(const void* data, std::size_t bytes) {
  const IoResult result = writeNextBytes(fd_, data, bytes);
  if (result.error != 0)
    throw ResumableError("cannot write '" + path_ + "': " + std::strerror(result.error) +
                             "; free some space or choose another folder",
                         {.path = path_});
}

}  // namespace isobrick
