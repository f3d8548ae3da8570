#include "isobrick/storage/divided_ranges.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <utility>
#include <vector>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/remote_options.h"

namespace isobrick {
namespace {

void add(const RemoteCounters& some, RemoteCounters& sum) {
  sum.requests += some.requests;
  sum.repeated += some.repeated;
  sum.bytes += some.bytes;
}

}  // namespace

// The file of one super-brick, open or to be opened.
class DividedRanges::SuperBrickFile : public std::enable_shared_from_this<SuperBrickFile> {
 public:
  SuperBrickFile(const Files& files, std::size_t number, Openers& openers)
      : open_(files.open),
        openers_(openers),
        path_(files.path_of(files.division->superBricks().fileName(number))),
        shown_(files.are_remote ? withoutSecrets(path_) : path_),
        entry_(files.division->file(number)) {}
  SuperBrickFile(const SuperBrickFile&) = delete;

  std::uint64_t last_use = 0;  // guarded by the lock of DividedRanges

  std::uint64_t bytes() const { return entry_.file_bytes; }

  // Opens it, unless it is open. Throws Error: another try may succeed.
  RangeReader& reader() {
    const std::lock_guard lock(mutex_);
    if (reader_ == nullptr) open();
    return *reader_;
  }
  // The reader if it is open now.
  RangeReader* readerNow() const { return now_; }

  // announce() of the reader. If a server is to be asked for the file first, a thread waits for it,
  // and holds on to the file, which so counts as being in use.
  void announce(std::vector<ByteRange> ranges, bool is_remote) {
    if (!is_remote || readerNow() != nullptr) return announceNow(ranges);
    if (is_opening_.exchange(true)) return;
    const bool is_begun =
        openers_.threads.run([self = shared_from_this(), ranges = std::move(ranges)] {
          self->announceNow(ranges);
          self->is_opening_ = false;
        });
    if (!is_begun) is_opening_ = false;  // a reader will wait a little longer
  }

 private:
  void announceNow(const std::vector<ByteRange>& ranges) noexcept {
    try {
      reader().announce(ranges);
    } catch (const std::exception&) {  // a reader will meet it
    }
  }

  void open() {
    openers_.abandoned.check();
    std::unique_ptr<RangeReader> reader = open_(path_, openers_.abandoned);
    format::Header header{};
    const bool fits = reader->size() == entry_.file_bytes;
    try {
      if (fits) reader->read({0, sizeof header}, reinterpret_cast<std::byte*>(&header));
    } catch (const ReadFailure& failure) {
      throw Error("'" + shown_ + "' " + failure.what(), {.path = shown_});
    }
    if (!fits || header.header_checksum != entry_.header_checksum ||
        !isChecksum(checksum64(&header, offsetof(format::Header, header_checksum)),
                    header.header_checksum))
      throw Error("'" + shown_ + "' is not the file that was joined", {.path = shown_});
    reader_ = std::move(reader);
    now_ = reader_.get();
    if (openers_.abandoned.requested()) reader_->abandon();
  }

  const Open& open_;
  Openers& openers_;
  const std::string path_, shown_;  // the latter for people
  const format::FileEntry entry_;
  std::mutex mutex_;  // guards the reader's coming
  std::unique_ptr<RangeReader> reader_;
  std::atomic<RangeReader*> now_ = nullptr;  // the same, for calls that do not wait
  std::atomic<bool> is_opening_ = false;     // a thread does it
};

DividedRanges::DividedRanges(std::unique_ptr<RangeReader> index, Files files)
    : index_(std::move(index)), files_(std::move(files)) {}
DividedRanges::~DividedRanges() { openers_.abandoned.request(); }

std::shared_ptr<DividedRanges::SuperBrickFile> DividedRanges::fileOf(std::size_t number) {
  std::shared_ptr<SuperBrickFile> closed;  // outside of the lock
  const std::lock_guard lock(mutex_);
  std::shared_ptr<SuperBrickFile>& file = open_[number];
  if (file == nullptr) file = std::make_shared<SuperBrickFile>(files_, number, openers_);
  file->last_use = ++uses_;
  std::shared_ptr<SuperBrickFile> result = file;
  closed = takeLeastUsed();
  return result;
}

// Out of those that are open, if they are too many. Those in use stay.
std::shared_ptr<DividedRanges::SuperBrickFile> DividedRanges::takeLeastUsed() {
  if (open_.size() <= (files_.are_remote ? kMostOpenRemote : kMostOpen)) return nullptr;
  auto oldest = open_.end();
  for (auto at = open_.begin(); at != open_.end(); ++at)
    if (at->second.use_count() == 1 &&
        (oldest == open_.end() || at->second->last_use < oldest->second->last_use))
      oldest = at;
  if (oldest == open_.end()) return nullptr;
  if (const RangeReader* const reader = oldest->second->readerNow())
    add(reader->counters(), of_closed_);
  std::shared_ptr<SuperBrickFile> taken = std::move(oldest->second);
  open_.erase(oldest);
  return taken;
}

void DividedRanges::read(const ByteRange& range, std::byte* out) {
  const PyramidDivision& division = *files_.division;
  const std::optional<std::size_t> number = division.fileAt(range.offset);
  const std::uint64_t base = number ? division.base(*number) : 0;
  const std::uint64_t bytes = number ? division.file(*number).file_bytes : division.indexBytes();
  const std::uint64_t begin = range.offset - base;
  const std::uint64_t stored = begin < bytes ? std::min(range.bytes, bytes - begin) : 0;
  std::fill(out + stored, out + range.bytes, std::byte{0});
  if (stored == 0) return;
  if (!number) return index_->read({begin, stored}, out);
  const std::shared_ptr<SuperBrickFile> file = fileOf(*number);
  try {
    file->reader().read({begin, stored}, out);
  } catch (const Cancelled&) {
    throw ReadFailure("cannot be read: it is not wanted any more");
  } catch (const Error& error) {
    const std::string what = error.what();
    throw ReadFailure("cannot be read: " + what.substr(0, what.rfind("; ")) +
                      "; restore that file, or build its super-brick again and join");
  }
}

void DividedRanges::announce(std::span<const ByteRange> ranges) {
  const PyramidDivision& division = *files_.division;
  std::vector<ByteRange> of_index;
  std::map<std::size_t, std::vector<ByteRange>> of_files;
  for (const ByteRange& range : ranges) {
    const std::optional<std::size_t> number = division.fileAt(range.offset);
    if (!number)
      of_index.push_back(range);
    else
      of_files[*number].push_back({range.offset - division.base(*number), range.bytes});
  }
  if (!of_index.empty()) index_->announce(of_index);
  for (auto& [number, some] : of_files) {
    const std::uint64_t bytes = division.file(number).file_bytes;
    std::erase_if(some, [&](const ByteRange& range) {  // bytes between files
      return range.offset > bytes || range.bytes > bytes - range.offset;
    });
    fileOf(number)->announce(std::move(some), files_.are_remote);
  }
}

void DividedRanges::abandon() {
  openers_.abandoned.request();
  index_->abandon();
  const std::lock_guard lock(mutex_);
  for (const auto& [number, file] : open_)
    if (RangeReader* const reader = file->readerNow()) reader->abandon();
}

RemoteCounters DividedRanges::counters() const {
  RemoteCounters sum = index_->counters();
  const std::lock_guard lock(mutex_);
  add(of_closed_, sum);
  for (const auto& [number, file] : open_)
    if (const RangeReader* const reader = file->readerNow()) add(reader->counters(), sum);
  return sum;
}

std::optional<DividedRanges::Place> DividedRanges::place(std::uint64_t offset) const {
  const std::optional<std::size_t> number = files_.division->fileAt(offset);
  if (!number) return std::nullopt;
  const std::string path = files_.path_of(files_.division->superBricks().fileName(*number));
  return Place{files_.are_remote ? withoutSecrets(path) : path,
               offset - files_.division->base(*number)};
}

}  // namespace isobrick
