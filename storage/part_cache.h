// Parts of pyramids behind URLs, kept on disk.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string>

namespace isobrick {

// The parts lie below "<folder>/parts", a folder for each edition of a file behind a URL, and are
// called by their checksum and size:
//
//   parts/3f…9a/0123456789abcdef-182044
//
// Any number of processes share them. A part is written under another name and gets its own when it
// is whole; one that is read is believed only if it has the checksum that the pyramid says, and
// removed otherwise. So nothing that happens to these files makes a wrong surface.
//
// After every sixteenth of the bound that this process has written it looks at all parts, and those
// go that were used least recently, until a sixteenth is free. So each process that writes at the
// same time may exceed the bound by a sixteenth for a while; longer parts are not kept.
//
// All members are thread-safe. A disk that fails or is full costs the parts and nothing else.
class PartCache {
 public:
  // `identity` says of which edition of which file the parts are. Throws Error if the folder cannot
  // be made.
  PartCache(const std::string& folder, std::uint64_t most_bytes, const std::string& identity);

  // Whether there is such a part; what is in it is not looked at.
  bool has(std::uint64_t checksum, std::uint64_t bytes) const;
  // Copies the part to `out`. False if it is not there, or not whole: then `out` holds anything.
  [[nodiscard]] bool read(std::uint64_t checksum, std::uint64_t bytes, std::byte* out) const;
  // Keeps a part, whose bytes have the checksum.
  void write(std::uint64_t checksum, std::uint64_t bytes, const std::byte* data) noexcept;

 private:
  std::string nameOf(std::uint64_t checksum, std::uint64_t bytes) const;

  const std::string root_, folder_;
  const std::uint64_t most_bytes_;
  std::mutex mutex_;                    // guards the next one
  std::uint64_t written_;               // since all parts were looked at
  std::atomic<std::uint64_t> next_{0};  // of temporary names
};

// All parts below a folder.
struct KeptParts {
  std::uint64_t count = 0;
  std::uint64_t bytes = 0;
};
KeptParts keptParts(const std::string& folder);
// Removes those that were used least recently until they have at most `most_bytes` together; says
// what was removed.
KeptParts trimParts(const std::string& folder, std::uint64_t most_bytes);

}  // namespace isobrick
