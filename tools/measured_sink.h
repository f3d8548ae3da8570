// A sink around a sink that measures it.
#pragma once

#include "isobrick/extract/sinks/triangle_sink.h"
#include "tools/progress_bar.h"
#include "tools/stopwatch.h"

namespace isobrick {

// Adds up the time that another sink takes, and shows how much went through. Both sink
// and bar outlive it.
class MeasuredSink : public TriangleSink {
 public:
  MeasuredSink(TriangleSink& sink, ProgressBar& bar) : sink_(sink), bar_(bar) {}

  void begin(const MeshFrame& frame) override {
    measure([&] { sink_.begin(frame); });
  }
  void accept(const MeshBatch& batch) override {
    measure([&] { sink_.accept(batch); });
    triangles_ += batch.triangles.size() / 3;
    bar_.show("extract", batch.fraction_done, static_cast<double>(triangles_) / 1e6);
  }
  void finish() override {
    measure([&] { sink_.finish(); });
  }

  double seconds() const { return seconds_; }

 private:
  template <typename Call>
  void measure(Call call) {
    const Stopwatch watch;
    call();
    seconds_ += watch.seconds();
  }

  TriangleSink& sink_;
  ProgressBar& bar_;
  std::uint64_t triangles_ = 0;
  double seconds_ = 0;
};

}  // namespace isobrick
