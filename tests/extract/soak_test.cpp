// Everything at once, for as long as one likes: random queries, progressive ones too, cancels,
// faults and evictions in several threads at the least budget. ISOBRICK_SOAK_SECONDS: how long (2).
#include <fcntl.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/storage/pyramid_parts.h"
#include "tests/extract/read_faults.h"
#include "tests/support/file_bytes.h"
#include "tests/support/hashing_sink.h"
#include "tests/support/random_numbers.h"
#include "tests/support/temporary_folder.h"

namespace isobrick::test {
namespace {

using Clock = std::chrono::steady_clock;

// Cancels the query, or does nothing, at one of its batches.
class CancellingSink : public HashingSink {
 public:
  CancellingSink(CancelFlag& flag, std::uint64_t at) : flag_(flag), at_(at) {}
  void accept(const MeshBatch& batch) override {
    if (batches_++ == at_) flag_.request();
    HashingSink::accept(batch);
  }

 private:
  CancelFlag& flag_;
  std::uint64_t at_, batches_ = 0;
};

class Soak : public testing::Test {
 protected:
  static constexpr std::uint64_t kQueries = 12;
  static constexpr int kThreads = 4;
  static constexpr int kMeshers = 2;

  struct Scene {
    std::string path;
    std::string bytes;
    std::unique_ptr<const Pyramid> pyramid;
    // Odd while a fault is in force or a query that may have met it goes on.
    std::atomic<std::uint64_t> faults{0};
  };

  void SetUp() override {
    open(0, format::Codec::kStored, FileAccess::kMap);
    open(1, format::Codec::kZstd, FileAccess::kMap);
    open(2, format::Codec::kStored, FileAccess::kRead);
    for (const Scene& scene : scenes_)
      for (std::uint64_t number = 0; number < kQueries; ++number) {
        HashingSink sink;
        extractIsosurface(Pyramid(scene.path), queryOf(number), sink);
        ASSERT_GT(sink.triangles(), 0u) << number;
        right_[number] = sink.value();
      }
  }
  // Stored parts in place get a budget of nothing: only what is in use stays. Buffers get a little,
  // so that a slab has them.
  void open(std::size_t number, format::Codec codec, FileAccess access) {
    Scene& scene = scenes_[number];
    scene.path = folder_.file("head" + std::to_string(number) + ".isb");
    BuildOptions options;
    options.brick_cells = 16;
    options.codec = codec;
    buildPyramid(*makePhantomSource(PhantomSpec{"head", 72, {}, 16}), scene.path, options);
    scene.bytes = readBytes(scene.path);
    scene.pyramid = std::make_unique<Pyramid>(scene.path, number == 0 ? 0 : 200000, access);
  }

  static Query queryOf(std::uint64_t number) {
    Random random(number);
    Query query;
    query.isovalue = randomReal(random, 300, 900);
    const auto point = [&] {
      return glm::dvec3(randomReal(random, 20, 50), randomReal(random, 20, 50),
                        randomReal(random, 20, 50));
    };
    if (number % 3 != 0) query.focus = FocusSphere{point(), randomReal(random, 2, 25)};
    if (number % 3 == 2) query.curvature_tolerance = 0.01;
    if (number % 6 == 0) query.box = QueryBox{glm::dvec3(0), point() + glm::dvec3(20)};
    return query;
  }

  // One thread: query after query, on any of the files, one in three cancelled.
  void explore(std::uint64_t thread) {
    Random random(thread);
    std::vector<Extractor> extractors;
    for (const Scene& scene : scenes_) extractors.emplace_back(*scene.pyramid);
    tbb::task_arena arena(kMeshers);
    arena.execute([&] {
      while (Clock::now() < end_) {
        const std::size_t which = randomBelow(random, std::size(scenes_));
        const std::uint64_t number = randomBelow(random, kQueries);
        Query query = queryOf(number);
        CancelFlag flag;
        query.cancel = &flag;
        query.is_progressive = random() % 4 == 0;
        const bool is_cancelled = random() % 3 == 0;
        CancellingSink sink(flag, is_cancelled ? randomBelow(random, 12) : ~std::uint64_t{0});
        ++steps_[thread];
        const std::uint64_t faults_before = scenes_[which].faults;
        try {
          const bool is_complete = extractors[which].extract(query, sink).is_complete;
          ++(is_complete ? whole_ : partial_);
          if (is_complete && sink.value() != right_[number]) fail("a mesh is wrong");
        } catch (const Cancelled&) {
          ++cancelled_;
          if (!is_cancelled) fail("cancelled by nobody");
        } catch (const Error& error) {
          ++failed_;
          if (faults_before % 2 == 0 && scenes_[which].faults == faults_before) fail(error.what());
          const std::string text = error.what();
          if (text.find("brick (") == std::string::npos &&
              text.find("was written to") == std::string::npos)
            fail(text);
        }
        ++steps_[thread];
      }
    });
  }
  void fail(const std::string& why) {
    const std::lock_guard lock(mutex_);
    ++faults_[why];
  }

  // Makes faults and takes them back.
  void makeFaults() {
    Random random(99);
    while (Clock::now() < end_) {
      Scene& scene = scenes_[randomBelow(random, std::size(scenes_))];
      const std::uint64_t begin = randomBelow(random, scene.bytes.size() * 3 / 4);
      const std::uint64_t bytes = 1 + randomBelow(random, 100000);
      const auto wait = [&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(randomBelow(random, 20)));
      };
      ++scene.faults;
      if (random() % 2 == 0) {
        const FaultyReads fault(scene.path, static_cast<ReadFault>(random() % 4), begin,
                                begin + bytes);
        wait();
      } else {
        const std::string good = scene.bytes.substr(begin, bytes);
        write(scene.path, begin, std::string(good.size(), '\x5a'));
        wait();
        write(scene.path, begin, good);
      }
      waitForQueries();
      ++scene.faults;
      wait();
    }
  }
  // Until those end that go on now.
  void waitForQueries() {
    for (std::atomic<std::uint64_t>& steps : steps_)
      for (const std::uint64_t now = steps; now % 2 == 1 && steps == now;)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  static void write(const std::string& path, std::uint64_t at, const std::string& bytes) {
    const int fd = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
    if (pwrite(fd, bytes.data(), bytes.size(), static_cast<off_t>(at)) !=
        static_cast<ssize_t>(bytes.size()))
      ADD_FAILURE() << "cannot write " << path;
    close(fd);
  }

  // Descriptors ("fd") or threads ("task") of this process.
  static std::ptrdiff_t held(const char* what) {
    const std::filesystem::directory_iterator all(std::string("/proc/self/") + what);
    return std::distance(begin(all), end(all));
  }
  static std::uint64_t residentBytes() {
    std::uint64_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages >> pages;
    return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  }

  const tbb::global_control most_threads_{tbb::global_control::max_allowed_parallelism, kThreads};
  const TemporaryFolder folder_;
  Scene scenes_[3];
  std::uint64_t right_[kQueries] = {};
  Clock::time_point end_;
  std::atomic<std::uint64_t> whole_{0}, partial_{0}, cancelled_{0}, failed_{0};
  std::atomic<std::uint64_t> steps_[kThreads] = {};  // of each thread; odd in a query
  std::mutex mutex_;                                 // guards the one below
  std::map<std::string, int> faults_;
};

TEST_F(Soak, QueriesCancelsAndFaultsGoOnWithoutGrowth) {
  const char* const text = std::getenv("ISOBRICK_SOAK_SECONDS");
  const auto all = std::chrono::duration<double>(text != nullptr ? std::atof(text) : 2);
  const auto begin = Clock::now();
  end_ = begin + std::chrono::duration_cast<Clock::duration>(all);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < kThreads; ++t) threads.emplace_back([this, t] { explore(t); });
  threads.emplace_back([this] { makeFaults(); });
  // Once what stays from query to query has come.
  std::this_thread::sleep_until(begin + (end_ - begin) / 2);
  const std::uint64_t half_way = residentBytes();
  const std::ptrdiff_t files_half_way = held("fd"), threads_half_way = held("task");
  std::this_thread::sleep_until(end_);
  const std::uint64_t at_end = residentBytes();
  const std::ptrdiff_t files_at_end = held("fd"), threads_at_end = held("task");
  for (std::thread& thread : threads) thread.join();

  for (const auto& [why, count] : faults_) ADD_FAILURE() << count << " times: " << why;
  std::printf(
      "%lu meshes, %lu coarser progressive ones, %lu cancelled, %lu failed; %.1f MiB, %td "
      "descriptors and %td threads half way, %.1f MiB, %td and %td at the end\n",
      whole_.load(), partial_.load(), cancelled_.load(), failed_.load(),
      static_cast<double>(half_way) / 0x1p20, files_half_way, threads_half_way,
      static_cast<double>(at_end) / 0x1p20, files_at_end, threads_at_end);
  // One or the other is opened just then, and some threads come with their first work.
  EXPECT_LE(files_at_end, files_half_way + 8);
  EXPECT_LE(threads_at_end, threads_half_way + 16);
  EXPECT_EQ(folder_.names().size(), std::size(scenes_)) << "temporary files are left";
  EXPECT_GT(whole_, 0u);
  EXPECT_GT(partial_, 0u);
  EXPECT_GT(cancelled_, 0u);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they keep what was freed
  EXPECT_LT(at_end, half_way + (std::uint64_t{32} << 20));
#endif
  // Nobody holds a part any more, and all is well again.
  for (std::size_t which = 0; which < std::size(scenes_); ++which) {
    const Scene& scene = scenes_[which];
    EXPECT_LE(scene.pyramid->parts().heldBytes(), scene.pyramid->budgetBytes());
    for (std::uint64_t number = 0; number < kQueries; ++number) {
      HashingSink sink;
      extractIsosurface(*scene.pyramid, queryOf(number), sink);
      EXPECT_EQ(sink.value(), right_[number]);
    }
  }
}

}  // namespace
}  // namespace isobrick::test
