#include "tools/bench/row_measurement.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "isobrick/storage/error.h"
#include "tests/support/temporary_folder.h"
#include "tools/bench/bench_report.h"

namespace isobrick {
namespace {

using test::TemporaryFolder;

void rest(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

// Notes what is asked of it, and takes 2 ms for everything.
class NotingEngine : public SurfaceEngine {
 public:
  void load() override { note('l'); }
  void prepare() override { note('p'); }
  void extract() override { note('e'); }
  SurfaceSize size() const override { return {7, 5, 99}; }
  PlainMesh mesh() const override { return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}}; }
  std::string note() const override { return "a note"; }

  std::string calls;

 private:
  void note(char call) {
    calls += call;
    rest(2);
  }
};

TEST(MeasureRow, WarmRepeatsAfterOneThatDoesNotCount) {
  NotingEngine engine;
  RowTask task;
  task.repeats = 4;
  const RowMeasurement m = measureRow(task, engine);
  EXPECT_EQ(engine.calls, "lpeeeee");
  EXPECT_EQ(m.seconds.size(), 4u);
  for (const double seconds : m.seconds) EXPECT_GE(seconds, 0.002);
  EXPECT_GE(m.load_seconds, 0.002);
  EXPECT_GE(m.prepare_seconds, 0.002);
  EXPECT_GE(m.first_seconds, 0.002);
  EXPECT_LT(m.processor_seconds, spreadOf(m.seconds).min) << "it sleeps most of the time";
  EXPECT_EQ(m.size.triangles, 7u);
  EXPECT_EQ(m.note, "a note");
  EXPECT_GT(m.loaded_rss_bytes, 0u);
  EXPECT_GT(m.peak_rss_bytes, 0u);
}

TEST(MeasureRow, ColdIsOneRunWithAllThatComesBefore) {
  NotingEngine engine;
  RowTask task;
  task.cold = true;
  const RowMeasurement m = measureRow(task, engine);
  EXPECT_EQ(engine.calls, "lpe");
  ASSERT_EQ(m.seconds.size(), 1u);
  EXPECT_EQ(m.seconds[0], m.load_seconds + m.prepare_seconds + m.first_seconds);
}

TEST(MeasureRow, WritesTheMeshWhereItIsWanted) {
  const TemporaryFolder folder;
  NotingEngine engine;
  RowTask task;
  task.mesh_path = folder.file("mesh");
  measureRow(task, engine);
  const PlainMesh mesh = readPlainMesh(folder.file("mesh"));
  EXPECT_EQ(mesh.positions, engine.mesh().positions);
  EXPECT_EQ(mesh.triangles, engine.mesh().triangles);
}

TEST(RowMeasurementText, ComesBackAsItWas) {
  RowMeasurement m;
  m.size = {1, 2, 3};
  m.load_seconds = 0.25;
  m.prepare_seconds = 0.5;
  m.first_seconds = 0.1;
  m.seconds = {1.0 / 3, 2};
  m.processor_seconds = 1.75;
  m.loaded_rss_bytes = 4;
  m.peak_rss_bytes = 5;
  m.huge_page_bytes = 6;
  m.note = "said \"so\"";
  const RowMeasurement back = rowMeasurementOf(textOf(m));
  EXPECT_EQ(textOf(back), textOf(m));
  EXPECT_EQ(back.seconds, m.seconds);
  EXPECT_EQ(back.note, m.note);
  EXPECT_EQ(back.size.bytes, 3u);
}

TEST(RowMeasurementText, EverythingElseIsRefused) {
  RowMeasurement m;
  m.seconds = {1};
  const std::string whole = textOf(m);
  for (std::size_t length = 0; length + 2 < whole.size(); ++length)
    EXPECT_THROW(rowMeasurementOf(whole.substr(0, length)), Error) << length;
  EXPECT_THROW(rowMeasurementOf(textOf(RowMeasurement{})), Error) << "no times";
  EXPECT_THROW(rowMeasurementOf("[]"), Error);
}

TEST(PeerRowsText, ComesBackAndIsChecked) {
  const std::vector<PeerRow> rows = peerRowsOf(textOf({{"one", false}, {"two", true}}));
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[1].name, "two");
  EXPECT_FALSE(rows[0].approximates);
  EXPECT_TRUE(rows[1].approximates);
  EXPECT_THROW(peerRowsOf("one exact\ntwo\n"), Error);
  EXPECT_THROW(peerRowsOf("one roughly\n"), Error);
}

}  // namespace
}  // namespace isobrick
