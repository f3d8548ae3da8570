#include "isobrick/preprocess/export/gzip_file.h"

#include <zlib.h>

#include <algorithm>
#include <new>
#include <stdexcept>
#include <vector>

namespace isobrick {

struct GzipFile::State {
  explicit State(AtomicFile& f) : file(f), packed(std::size_t{256} << 10) {
    constexpr int kGzip = 15 + 16;  // the largest window, and gzip's header in place of zlib's
    constexpr int kLevel = 3;  // scans shrink little more above it, and take three times as long
    if (deflateInit2(&stream, kLevel, Z_DEFLATED, kGzip, 8, Z_DEFAULT_STRATEGY) != Z_OK)
      throw std::bad_alloc();
  }
  ~State() { deflateEnd(&stream); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  // Packs the stream's input, and with Z_FINISH all that zlib still holds.
  void run(int flush) {
    int result;
    do {
      stream.next_out = packed.data();
      stream.avail_out = static_cast<uInt>(packed.size());
      result = deflate(&stream, flush);
      if (result == Z_STREAM_ERROR) throw std::logic_error("zlib was used wrongly");
      file.write(packed.data(), packed.size() - stream.avail_out);
    } while (flush == Z_FINISH ? result != Z_STREAM_END : stream.avail_out == 0);
  }

  AtomicFile& file;
  std::vector<unsigned char> packed;
  z_stream stream = {};
};

GzipFile::GzipFile(AtomicFile& file) : state_(std::make_unique<State>(file)) {}
GzipFile::~GzipFile() = default;

void GzipFile::write(std::span<const std::byte> bytes, const CancelFlag* cancel) {
  constexpr std::size_t kMostPerCall = std::size_t{1} << 20;  // some milliseconds
  while (!bytes.empty()) {
    if (cancel != nullptr) cancel->check();
    const std::size_t part = std::min(bytes.size(), kMostPerCall);
    // zlib does not change its input, but its pointer is not const.
    state_->stream.next_in =
        const_cast<unsigned char*>(reinterpret_cast<const unsigned char*>(bytes.data()));
    state_->stream.avail_in = static_cast<uInt>(part);
    state_->run(Z_NO_FLUSH);
    bytes = bytes.subspan(part);
  }
}

void GzipFile::finish() {
  state_->stream.next_in = nullptr;
  state_->stream.avail_in = 0;
  state_->run(Z_FINISH);
}

}  // namespace isobrick
