// The only file of the viewer that uses OpenEXR.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cassert>
#include <deque>
#include <exception>
#include <memory>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"
#include "isobrick/viewer/picture_writer.h"

namespace isobrick {
namespace {

// OpenEXR seeks back to fill in its table of line offsets.
class StreamAt : public Imf::OStream {
 public:
  explicit StreamAt(WriteAt write) : Imf::OStream("picture"), write_(std::move(write)) {}

  void write(const char data[], int count) override {
    try {
      write_(data, static_cast<std::size_t>(count), position_);
    } catch (...) {
      failure_ = std::current_exception();
      throw;
    }
    position_ += static_cast<std::uint64_t>(count);
  }
  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = position; }

  // Throws what a write() threw.
  void check() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  const WriteAt write_;
  std::exception_ptr failure_;
  std::uint64_t position_ = 0;
};

half toHalf(float value) {
  constexpr float kGreatestHalf = 65504.0f;  // HALF_MAX is a double in Imath 3
  return half(std::clamp(value, -kGreatestHalf, kGreatestHalf));
}

class ExrEncoder : public BandEncoder {
 public:
  ExrEncoder(const PictureShape& shape, WriteAt write) : shape_(shape) {
    assert(shape.width > 0 && shape.height > 0);
    attempt([&] {
      Imf::Header header(shape.width, shape.height);
      header.compression() = Imf::ZIP_COMPRESSION;
      Imf::addChromaticities(header, Imf::Chromaticities());  // the default is Rec. 709
      if (shape.pixels_per_inch > 0.0)
        Imf::addXDensity(header, static_cast<float>(shape.pixels_per_inch));
      const auto addHalf = [&](const char* name) {
        header.channels().insert(name, Imf::Channel(Imf::HALF));
      };
      for (const char* const name : {"R", "G", "B"}) addHalf(name);
      if (shape.alpha) addHalf("A");
      if (shape.normals)
        for (const char* const name : {"N.X", "N.Y", "N.Z"}) addHalf(name);
      if (shape.depth) header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
      stream_ = std::make_unique<StreamAt>(std::move(write));
      file_ = std::make_unique<Imf::OutputFile>(*stream_, header);
    });
  }

  void add(const Image& rows) override {
    assert(rows.width == shape_.width && rows.alpha.empty() != shape_.alpha);
    assert(rows.depth.empty() != shape_.depth && rows.normals.empty() != shape_.normals);
    attempt([&] {
      Imf::FrameBuffer frame;
      std::deque<std::vector<half>> halves;
      const auto addHalf = [&](const char* name, const std::vector<float>& values,
                               std::size_t first, std::size_t step) {
        std::vector<half>& channel = halves.emplace_back();
        channel.reserve(values.size() / step);
        for (std::size_t i = first; i < values.size(); i += step)
          channel.push_back(toHalf(values[i]));
        frame.insert(name, rowsOf(Imf::HALF, channel.data(), sizeof(half)));
      };
      addHalf("R", rows.rgb, 0, 3);
      addHalf("G", rows.rgb, 1, 3);
      addHalf("B", rows.rgb, 2, 3);
      if (shape_.alpha) addHalf("A", rows.alpha, 0, 1);
      if (shape_.normals) {
        addHalf("N.X", rows.normals, 0, 3);
        addHalf("N.Y", rows.normals, 1, 3);
        addHalf("N.Z", rows.normals, 2, 3);
      }
      // Only reads, although the library's signature is not const.
      if (shape_.depth)
        frame.insert("Z", rowsOf(Imf::FLOAT, const_cast<float*>(rows.depth.data()), sizeof(float)));
      file_->setFrameBuffer(frame);
      file_->writePixels(rows.height);
      rows_ += rows.height;
    });
  }

  // The destructor completes the table of line offsets, and is silent about what fails there.
  void finish() override {
    assert(rows_ == shape_.height);
    file_.reset();
    attempt([&] { stream_->check(); });
  }

 private:
  // `values`: of the next row on.
  Imf::Slice rowsOf(Imf::PixelType type, void* values, std::size_t bytes) const {
    const std::size_t row = bytes * static_cast<std::size_t>(shape_.width);
    // The library counts rows from the first one of the picture.
    return {type, static_cast<char*>(values) - static_cast<std::ptrdiff_t>(row) * rows_, bytes,
            row};
  }

  template <typename Work>
  void attempt(Work&& work) const {
    try {
      work();
    } catch (const Error&) {
      throw;
    } catch (const std::exception& error) {
      throw Error("cannot encode an EXR picture of " + std::to_string(shape_.width) + " x " +
                  std::to_string(shape_.height) + " pixels: " + error.what() +
                  "; try a smaller picture or a .png");
    }
  }

  const PictureShape shape_;
  int rows_ = 0;
  std::unique_ptr<StreamAt> stream_;
  std::unique_ptr<Imf::OutputFile> file_;  // goes before its stream
};

}  // namespace

std::unique_ptr<BandEncoder> makeExrEncoder(const PictureShape& shape, WriteAt write) {
  return std::make_unique<ExrEncoder>(shape, std::move(write));
}

}  // namespace isobrick
