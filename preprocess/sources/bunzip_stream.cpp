#include <bzlib.h>

#include <algorithm>
#include <new>
#include <utility>
#include <vector>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/inflate_stream.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

class BunzipStream final : public ByteStream {
 public:
  BunzipStream(const std::string& path, std::unique_ptr<ByteStream> packed)
      : path_(path), packed_(std::move(packed)), input_(std::size_t{256} << 10) {
    if (BZ2_bzDecompressInit(&bzip_, 0, 0) != BZ_OK) throw std::bad_alloc();
  }
  ~BunzipStream() override { BZ2_bzDecompressEnd(&bzip_); }
  BunzipStream(const BunzipStream&) = delete;

  std::size_t read(void* out, std::size_t bytes) override {
    std::size_t got = 0;
    while (got < bytes && !has_ended_) {
      if (bzip_.avail_in == 0) {
        bzip_.next_in = input_.data();
        bzip_.avail_in = static_cast<unsigned>(packed_->read(input_.data(), input_.size()));
      }
      const bool is_cut = bzip_.avail_in == 0;
      const auto most = static_cast<unsigned>(std::min(bytes - got, std::size_t{1} << 30));
      bzip_.next_out = static_cast<char*>(out) + got;
      bzip_.avail_out = most;
      const int result = BZ2_bzDecompress(&bzip_);
      got += most - bzip_.avail_out;
      has_ended_ = result == BZ_STREAM_END;
      if (!has_ended_ && (result != BZ_OK || (is_cut && bzip_.avail_out == most)))
        throw unreadable(path_, std::string("its compressed data are ") +
                                    (is_cut ? "cut short" : "damaged") +
                                    "; get the whole file again");
    }
    return got;
  }
  void finish() override {  // reads the checksum, if it is near
    char rest[4096];
    read(rest, sizeof rest);
  }

 private:
  std::string path_;
  std::unique_ptr<ByteStream> packed_;
  std::vector<char> input_;
  bz_stream bzip_ = {};
  bool has_ended_ = false;
};

}  // namespace

std::unique_ptr<ByteStream> makeBunzipStream(const std::string& path,
                                             std::unique_ptr<ByteStream> packed) {
  return std::make_unique<BunzipStream>(path, std::move(packed));
}

}  // namespace isobrick
