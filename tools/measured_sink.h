// A sink around a sink that measures it.
#pragma once

#include <atomic>

#include "isobrick/extract/sinks/triangle_sink.h"
#include "tools/progress_bar.h"

namespace isobrick {

// Adds up the time that another sink takes, and shows the progress. Both sink and bar outlive it.
class MeasuredSink : public TriangleSink {
 public:
  MeasuredSink(TriangleSink& sink, ProgressBar& bar) : sink_(sink), bar_(bar) {}

  bool takesRemains() const override { return sink_.takesRemains(); }
  void prepare(PlacedBatch& placed) override { sink_.prepare(placed); }
  void begin(const MeshFrame& frame) override {
    measure([&] { sink_.begin(frame); });
  }
  void place(PlacedBatch& placed) override {
    measure([&] { sink_.place(placed); });
    triangles_ += placed.batch.triangles.size() / 3;
    bar_.show("extract", placed.batch.fraction_done, static_cast<double>(triangles_) / 1e6);
  }
  void write(PlacedBatch& placed) override {
    const Stopwatch watch;
    sink_.write(placed);
    write_nanoseconds_ += static_cast<std::int64_t>(1e9 * watch.seconds());
  }
  void finish() override {
    measure([&] { sink_.finish(); });
  }

  // The share of the extraction's time on so many threads: the sink's serial part, and its share of
  // the rest.
  double seconds(int threads) const {
    return serial_seconds_ + 1e-9 * static_cast<double>(write_nanoseconds_) / threads;
  }

 private:
  template <typename Call>
  void measure(Call call) {
    const Stopwatch watch;
    call();
    serial_seconds_ += watch.seconds();
  }

  TriangleSink& sink_;
  ProgressBar& bar_;
  std::uint64_t triangles_ = 0;
  double serial_seconds_ = 0;
  std::atomic<std::int64_t> write_nanoseconds_{0};
};

}  // namespace isobrick
