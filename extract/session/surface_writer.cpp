#include "isobrick/extract/session/surface_writer.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <thread>
#include <unordered_map>

#include "isobrick/extract/kernels/brick_crossings.h"
#include "isobrick/extract/kernels/brick_rows.h"
#include "isobrick/extract/kernels/brick_triangles.h"
#include "isobrick/extract/meshing/crossed_tiles.h"
#include "isobrick/extract/paging/read_ahead.h"
#include "isobrick/extract/session/surface_memory.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isolated_loop.h"
#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {
namespace {

// Stands for the first crossing of a row in a damaged brick that should have it and lacks it.
constexpr std::uint32_t kNoCrossing = SurfaceMesh::kMostVertices + 1;

// Numbers of the crossings on a brick's high sides, as vertex numbers of the mesh, in one array
// that reuses the memory of another brick: a number that is not set reads as kNoCrossing.
class SideNumbers {
 public:
  SideNumbers(const Index3& cells, RawVector<std::uint32_t>& array)
      : rows_((cells.y + 1) * (cells.z + 1)), ny_(cells.y + 1), nz_(cells.z + 1), array_(array) {}

  void forgetAll() {
    const std::size_t first_bits = bits(0), end = bits(lastPlaces() - 1) + 1;
    if (array_.size() < end) array_.resize(end);
    std::fill(&array_[lastPlaces()], &array_[first_bits], kNoCrossing);
    std::fill(&array_[first_bits], &array_[first_bits] + (end - first_bits), 0u);
  }
  // At the last corner of row r, along y (axis 1) or z (2).
  void setLast(int axis, std::int64_t r, std::uint32_t number) {
    array_[last(axis, r)] = number;
    array_[bits(last(axis, r))] |= 1u << last(axis, r) % 32;
  }
  std::uint32_t ofLast(int axis, std::int64_t r) const {
    const std::size_t at = last(axis, r);
    return (array_[bits(at)] >> at % 32 & 1) != 0 ? array_[at] : kNoCrossing;
  }
  // The number of the last row of slice k, along x (0) or z (2): BrickRows::numbers.
  std::uint32_t& inSideY(int axis, std::int64_t k) const {
    return array_[lastPlaces() + static_cast<std::size_t>((axis == 0 ? 0 : nz_) + k)];
  }
  // The number of row j of the last slice, along x (0) or y (1).
  std::uint32_t& inSideZ(int axis, std::int64_t j) const {
    return array_[lastPlaces() + static_cast<std::size_t>(2 * nz_ + (axis == 0 ? 0 : ny_) + j)];
  }

 private:
  std::size_t lastPlaces() const { return static_cast<std::size_t>(2 * rows_); }
  std::size_t last(int axis, std::int64_t r) const {
    return static_cast<std::size_t>((axis - 1) * rows_ + r);
  }
  // The word that says whether ofLast() at place `at` is set.
  std::size_t bits(std::size_t at) const {
    return lastPlaces() + static_cast<std::size_t>(2 * (nz_ + ny_)) + at / 32;
  }

  std::int64_t rows_, ny_, nz_;
  RawVector<std::uint32_t>& array_;
};

// Whether the row has a number. Bits of rows that touch no wanted cell may be those of an older
// brick.
bool hasCrossings(const BrickRows& rows, int axis, std::int64_t r) {
  const std::int64_t words = rows.words_per_row, slice = rows.rowsPerSlice();
  const auto a = static_cast<std::size_t>(axis);
  std::uint64_t near = 0,
                any = axis == 0 ? 0 : rows.crossed_first[a - 1][static_cast<std::size_t>(r)];
  for (std::int64_t w = 0; w < words; ++w) {
    near |= rows.wanted(r)[w] | rows.wanted(r - 1)[w] | rows.wanted(r - slice)[w] |
            rows.wanted(r - slice - 1)[w];
    any |= rows.crossed[a][static_cast<std::size_t>(r * words + w)];
  }
  return near != 0 && any != 0;
}

// Of a row that has crossings: how many, that at corner 0 aside.
std::uint32_t crossingsBeyondFirst(const BrickRows& rows, int axis, std::int64_t r) {
  const std::uint64_t* words =
      rows.crossed[static_cast<std::size_t>(axis)].data() + r * rows.words_per_row;
  std::uint32_t count = 0;
  for (std::int64_t w = 0; w < rows.words_per_row; ++w)
    count += static_cast<std::uint32_t>(std::popcount(words[w]));
  return count;
}

// Set once, by one thread, and waited for by others.
class OnceFlag {
 public:
  void set() { change(kSet); }
  // It will never be set: ends all waiting.
  void giveUp() { change(kNever); }
  // False if it was given up.
  bool wait() const {
    // Most are set within moments; a thread that waits for a read leaves its core to others.
    for (int looks = 0; state_.load(std::memory_order_acquire) == kNotYet; ++looks) {
      if (looks > 200) state_.wait(kNotYet, std::memory_order_acquire);
      if (looks > 100) std::this_thread::yield();
    }
    return state_.load(std::memory_order_acquire) == kSet;
  }

 private:
  enum State : std::uint32_t { kNotYet, kSet, kNever };
  void change(State to) {
    state_.store(to, std::memory_order_release);
    state_.notify_all();
  }
  std::atomic<std::uint32_t> state_{kNotYet};
};

struct BrickJob {
  std::uint64_t first_vertex = 0, first_triangle = 0;
  std::uint32_t vertices = 0, triangles = 0, crossed_cell_count = 0;
  Index3 origin{0};
  OnceFlag placed;    // first_vertex and first_triangle are known
  OnceFlag numbered;  // so are its side numbers, if it has triangles
};

}  // namespace

template <typename T>
class SurfaceWriter::Run {
 public:
  Run(SurfaceMesh& mesh, SurfaceWriterMemory& memory, const MeshContext& context,
      std::span<const BrickWork> work)
      : mesh_(mesh),
        workers_(memory.workers),
        context_(context),
        work_(work),
        layout_(context.pyramid.layout()),
        threshold_(insideThreshold<T>(context.isovalue)),
        jobs_(work.size() + 1) {
    job_of_brick_.reserve(work.size());
    for (std::size_t job = 0; job < work.size(); ++job)
      job_of_brick_.emplace(context.pyramid.parts().brickRow(work[job].level, work[job].brick),
                            job);
    if (mesh.memory_->side_numbers.size() < work.size())
      mesh.memory_->side_numbers.resize(work.size());
    jobs_[0].placed.set();
  }

  LevelCounts run() {
    const int threads = tbb::this_task_arena::max_concurrency();
    {
      ReadAhead ahead(context_, work_);
      isolatedForEach(0, threads, [&](int) { writeBricks(ahead); });
    }  // its threads log the parts that they read
    context_.checkCancel();
    context_.throwIfWrittenOver();

    LevelCounts counts;
    for (std::size_t job = 0; job < work_.size(); ++job) {
      const BrickJob& done = jobs_[job];
      if (done.triangles == 0) continue;
      counts.level = work_[job].level;
      counts.cells += done.crossed_cell_count;
      counts.triangles += done.triangles;
      mesh_.parts_.push_back({done.first_vertex, done.vertices, done.first_triangle, done.triangles,
                              done.origin, work_[job].level, 0});
    }
    mesh_.vertices_ = jobs_.back().first_vertex;
    mesh_.triangles_ = jobs_.back().first_triangle;
    return counts;
  }

 private:
  using Worker = SurfaceWriterMemory::Worker;

  void writeBricks(ReadAhead& ahead) {
    Worker& worker = workers_.local();
    try {
      for (;;) {
        const std::size_t job = next_.fetch_add(1, std::memory_order_relaxed);
        if (job >= work_.size() || has_failed_) return;
        context_.checkCancel();
        ahead.reached(job);
        writeBrick(job, worker);
        context_.noteDone(static_cast<double>(++written_) / static_cast<double>(work_.size()));
      }
    } catch (...) {
      has_failed_ = true;
      for (BrickJob& job : jobs_) {
        job.placed.giveUp();
        job.numbered.giveUp();
      }
      throw;
    }
  }

  void writeBrick(std::size_t number, Worker& worker) {
    const BrickWork& work = work_[number];
    BrickJob& job = jobs_[number];
    BrickRows& rows = worker.rows;
    const IndexBox cells = layout_.brickCellBox(work.level, work.brick);
    BrickSamples samples;
    BrickGrid<T> grid;
    if (threshold_ && worker.tiles.load(context_, work.level, work.brick)) {
      rows.resize(cells.count);
      findNeighbours(number, rows);
      wantCrossedRows(worker.tiles, layout_.tileCells(), rows);
      samples = context_.samples(work.level, work.brick);
      grid = {samples.template data<T>(), samples.box.count, cells.first - samples.box.first,
              cells.count};
      context_.checkCancel();
      compareRows(grid, *threshold_, rows);
      numberRows(rows);
      job.vertices = rows.ownCrossings();
      job.triangles = rows.triangles;
      job.crossed_cell_count = rows.crossed_cell_count;
    }
    if (!place(number)) return;
    if (job.triangles > 0) {
      const FirstVertices first = firstVertices(rows, static_cast<std::uint32_t>(job.first_vertex));
      if (!takeSideNumbers(number, first, rows)) return;
      giveSideNumbers(number, first, rows);
      job.numbered.set();
      worker.spacing.set(context_.lattice(), work.level, cells, samples.box);
      job.origin = worker.spacing.origin;
      // The first touch of memory takes longer than the writing itself.
      context_.checkCancel();
      makeCrossings(grid, rows, worker.spacing, context_.frame, context_.isovalue,
                    &mesh_.positionData()[job.first_vertex].x,
                    &mesh_.normalData()[job.first_vertex].x);
      context_.checkCancel();
      makeTriangles(rows, first, context_.frame.mirrored(),
                    mesh_.triangleData() + 3 * job.first_triangle);
      context_.read_log.note(context_.pyramid.parts().brickRow(work.level, work.brick),
                             ReadLog::kActive);
    } else {
      job.numbered.set();
    }
    context_.throwIfReadsFailed();
  }

  // Which low sides are another brick's. A brick that is not in the work has no crossing.
  void findNeighbours(std::size_t number, BrickRows& rows) {
    rows.foreign_sides = 0;
    for (int axis = 0; axis < 3; ++axis)
      if (neighbourOf(number, axis) < number) rows.foreign_sides |= 1u << axis;
  }
  // The job of the brick before this one along `axis`; the number itself if there is none.
  std::size_t neighbourOf(std::size_t number, int axis) const {
    const BrickWork& work = work_[number];
    Index3 brick = work.brick;
    if (--brick[axis] < 0) return number;
    const auto found = job_of_brick_.find(context_.pyramid.parts().brickRow(work.level, brick));
    return found == job_of_brick_.end() ? number : found->second;
  }

  // Step 2.
  bool place(std::size_t number) {
    BrickJob& job = jobs_[number];
    if (!job.placed.wait()) return false;
    BrickJob& next = jobs_[number + 1];
    next.first_vertex = job.first_vertex + job.vertices;
    next.first_triangle = job.first_triangle + job.triangles;
    mesh_.openFor(next.first_vertex, next.first_triangle);
    next.placed.set();
    return true;
  }

  // Step 3: from the bricks on the low sides. Throws Error if these lack a vertex, as they do if
  // the ranges in a file are wrong.
  bool takeSideNumbers(std::size_t number, const FirstVertices& first, BrickRows& rows) {
    const std::int64_t ny = rows.cells.y, nz = rows.cells.z;
    const std::uint64_t vertices_before = jobs_[number].first_vertex;
    bool are_there = true;
    const auto take = [&](int axis, std::int64_t row, std::uint32_t given) {
      const auto a = static_cast<std::size_t>(axis), r = static_cast<std::size_t>(row);
      rows.numbers[a][r] = given - first[a];
      if (!hasCrossings(rows, axis, row)) return;
      const bool has_one_less =
          axis != 0 && (rows.foreign_sides & 1) == 0 && rows.crossed_first[a - 1][r] != 0;
      are_there = are_there && given >= (has_one_less ? 1 : 0) &&
                  given + std::uint64_t{crossingsBeyondFirst(rows, axis, row)} <= vertices_before;
    };
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t neighbour = neighbourOf(number, axis);
      if (neighbour == number) continue;
      if (!jobs_[neighbour].numbered.wait()) return false;
      // Without triangles it has set none, and contradicts the crossings that this brick has there.
      const bool has_any = jobs_[neighbour].triangles > 0;
      const IndexBox cells = layout_.brickCellBox(work_[neighbour].level, work_[neighbour].brick);
      const SideNumbers side(cells.count, mesh_.memory_->side_numbers[neighbour]);
      if (axis == 0) {
        for (const std::size_t across : {std::size_t{1}, std::size_t{2}})
          for (const std::uint32_t r : rows.crossed_rows[across].list())
            if (rows.crossed_first[across - 1][r] != 0) {
              const std::uint32_t given =
                  has_any ? side.ofLast(static_cast<int>(across), r) : kNoCrossing;
              rows.first_numbers[across - 1][r] = given - first[across];
              are_there = are_there && given < vertices_before;
            }
      } else if (axis == 1) {
        for (std::int64_t k = 0; k <= nz; ++k)
          for (const int a : {0, 2})
            take(a, rows.row(0, k), has_any ? side.inSideY(a, k) : kNoCrossing);
      } else {
        for (std::int64_t j = 0; j <= ny; ++j)
          for (const int a : {0, 1})
            take(a, rows.row(j, 0), has_any ? side.inSideZ(a, j) : kNoCrossing);
      }
    }
    if (!are_there) failMissingNumber(number);
    return true;
  }

  // A neighbour whose bytes could not be read gives other numbers, and its thread may not have said
  // so yet.
  [[noreturn]] void failMissingNumber(std::size_t number) const {
    if (context_.pyramid.parts().hasFailedReads())
      for (int axis = 0; axis < 3; ++axis) {
        const BrickWork& neighbour = work_[neighbourOf(number, axis)];
        context_.pyramid.throwIfReadsFailed(neighbour.level, neighbour.brick);
      }
    context_.failMissingVertex(work_[number]);
  }

  // Step 3: for the bricks on the high sides.
  void giveSideNumbers(std::size_t number, const FirstVertices& first, const BrickRows& rows) {
    const std::int64_t nx = rows.cells.x, ny = rows.cells.y, nz = rows.cells.z;
    const std::int64_t words = rows.words_per_row;
    SideNumbers side(rows.cells, mesh_.memory_->side_numbers[number]);
    side.forgetAll();
    const auto numberOf = [&](std::size_t axis, std::int64_t r) {
      return first[axis] + rows.numbers[axis][static_cast<std::size_t>(r)];
    };
    for (const std::size_t axis : {std::size_t{1}, std::size_t{2}})
      for (const std::uint32_t r : rows.crossed_rows[axis].list()) {
        const std::uint64_t* crossed = rows.crossed[axis].data() + r * words;
        if ((crossed[(nx - 1) / 64] >> (nx - 1) % 64 & 1) != 0)
          side.setLast(static_cast<int>(axis), r, numberOf(axis, r) + bitsBelow(crossed, nx - 1));
      }
    for (std::int64_t k = 0; k <= nz; ++k)
      for (const int axis : {0, 2})
        if (const std::int64_t r = rows.row(ny, k); hasCrossings(rows, axis, r))
          side.inSideY(axis, k) = numberOf(static_cast<std::size_t>(axis), r);
    for (std::int64_t j = 0; j <= ny; ++j)
      for (const int axis : {0, 1})
        if (const std::int64_t r = rows.row(j, nz); hasCrossings(rows, axis, r))
          side.inSideZ(axis, j) = numberOf(static_cast<std::size_t>(axis), r);
  }

  SurfaceMesh& mesh_;
  tbb::enumerable_thread_specific<Worker>& workers_;
  const MeshContext& context_;
  std::span<const BrickWork> work_;
  const BrickLayout& layout_;
  const std::optional<T> threshold_;
  std::unordered_map<std::size_t, std::size_t> job_of_brick_;  // by row of the brick table
  std::vector<BrickJob> jobs_;                                 // and one for the end
  std::atomic<std::size_t> next_{0}, written_{0};
  std::atomic<bool> has_failed_{false};
};

SurfaceWriter::SurfaceWriter(SurfaceMesh& mesh, const GridGeometry& geometry,
                             SurfaceWriterMemory& memory)
    : mesh_(mesh), memory_(memory) {
  mesh.clear(geometry);
}

bool SurfaceWriter::canWrite(std::span<const BrickWork> work) {
  for (const BrickWork& item : work)
    if (item.adaptive || item.level != work.front().level) return false;
  return true;
}

LevelCounts SurfaceWriter::run(const MeshContext& context, std::span<const BrickWork> work) {
  return visitVoxelType(context.pyramid.spec().voxel_type, [&](auto tag) {
    return Run<typename decltype(tag)::Type>(mesh_, memory_, context, work).run();
  });
}

SurfaceJoiner::SurfaceJoiner(SurfaceMesh& mesh, const GridGeometry& geometry,
                             VertexNumbering& numbering)
    : mesh_(mesh), numbering_(numbering) {
  mesh.clear(geometry);
  parts_.swap(mesh.parts_);
  numbering.clear();
}

void SurfaceJoiner::place(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  placed.first_triangle = triangles_;
  numbering_.place(placed);
  triangles_ += batch.triangles.size() / 3;
  mesh_.openFor(numbering_.count(), triangles_);
  parts_.push_back({placed.first_vertex, numbering_.count() - placed.first_vertex,
                    placed.first_triangle, batch.triangles.size() / 3, batch.origin, batch.level,
                    batch.cap_indices / 3});
}

void SurfaceJoiner::write(PlacedBatch& placed) {
  const MeshBatch& batch = placed.batch;
  forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t number) {
    std::copy(&batch.positions[begin], &batch.positions[begin] + (end - begin),
              mesh_.positionData() + number);
    std::copy(&batch.normals[begin], &batch.normals[begin] + (end - begin),
              mesh_.normalData() + number);
  });
  findNumbers(placed);
  std::uint32_t* out = mesh_.triangleData() + 3 * placed.first_triangle;
  for (const std::uint32_t vertex : batch.triangles) *out++ = placed.numbers[vertex];
}

void SurfaceJoiner::finish() {
  mesh_.parts_.swap(parts_);
  mesh_.vertices_ = numbering_.count();
  mesh_.triangles_ = triangles_;
}

}  // namespace isobrick
