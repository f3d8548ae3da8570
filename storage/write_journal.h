// A journal of a file that is being written, so that a killed run can be continued.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/file_io.h"

namespace isobrick {

// The first bytes of a journal.
inline constexpr char kJournalMagic[8] = {'I', 'S', 'B', 'J', 'R', 'N', 'L', '2'};

// One brick whose parts are in the temporary file, and the offset of the next one.
struct JournalEntry {
  BrickRow row;
  std::uint64_t end = 0;
  std::uint64_t checksum = 0;  // XXH3-64 of the bytes before it: a torn entry is no entry
};
static_assert(sizeof(JournalEntry) == 104);

// A file beside the temporary file: an identity text, then entries in the order of the brick table.
// It is only ever appended to, and stays when this object goes. Used by one thread at a time.
// Failures throw ResumableError.
class WriteJournal {
 public:
  struct Content {
    std::string identity;
    std::vector<JournalEntry> entries;  // up to the first that is damaged
  };
  // Nothing if there is no journal, or none that can be read. Never throws for its content.
  static std::optional<Content> read(const std::string& path);

  // Begins a journal with `entries`, replacing an older one. It is on the disk when this returns:
  // after a loss of power there is one beside all that is written from here on, and its identity is
  // whole. What is added later may be lost or torn.
  WriteJournal(const std::string& path, const std::string& identity,
               const std::vector<JournalEntry>& entries);

  // Adds the entry of a brick; flush() writes the entries. Call it after the brick's bytes were
  // written, so that no entry names bytes that are not there.
  void add(const BrickRow& row, std::uint64_t end);
  void flush();
  // Removes the file, unless its name now belongs to another one: that of the next writer, which
  // may begin as soon as the finished file has its name.
  void remove() noexcept;

 private:
  void writeAll(const void* data, std::size_t bytes);

  std::string path_;
  OpenDescriptor file_;
  std::vector<JournalEntry> pending_;
};

}  // namespace isobrick
