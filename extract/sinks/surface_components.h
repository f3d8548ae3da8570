// The connected components of a surface, of any size, in two passes: list them, then extract the
// chosen ones again.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/extract/query.h"
#include "isobrick/extract/sinks/triangle_sink.h"

namespace isobrick {

// A component of a surface.
struct SurfaceComponent {
  std::uint64_t triangles = 0;  // of the mesh
  double area = 0;              // world units^2
  // Enclosed, world units^3: below 0 for the wall of a hollow. None if the component has a border,
  // as it reaches the border of the volume or of the query's box and Query::cap is not set, or if
  // there are voxels without data.
  std::optional<double> volume;
  // The same with the border of the volume as a wall where it is open there: of its two sides the
  // lesser. None if a box cuts the surface.
  std::optional<double> enclosed;
  glm::dvec3 lower{0.0};  // of the least box around it, world units
  glm::dvec3 upper{0.0};  // likewise
  // The centre of gravity of the surface, as a thin shell; world units.
  glm::dvec3 center{0.0};
  // A vertex of it, the first one that the extraction meets; world units.
  glm::dvec3 point{0.0};
};

// Points whose components are wanted.
struct ComponentPoints {
  std::vector<glm::dvec3> points;  // world units
  // A surface further away from a point is not meant: in longest edges of the cells that it is
  // made of there.
  double reach = std::numeric_limits<double>::infinity();
};

// The components of the surface of one query.
class SurfaceComponents {
 public:
  // The largest area first; equal ones in the order in which the extraction meets them.
  const std::vector<SurfaceComponent>& list() const { return list_; }
  // How many of the list have at least this area.
  std::size_t countFrom(double area) const;
  // An entry for each of the list, 1 for the largest `count` bodies of at least an area, with their
  // cavities: walls of hollows that lie in the box of no smaller body. The largest are those that
  // enclose the most, cavities left out; if a box cuts the surface, those of the largest area.
  std::vector<std::uint8_t> largest(std::size_t count, double least_area = 0) const;
  // The same for all of at least an area if there is no count: then nothing is ranked.
  std::vector<std::uint8_t> kept(std::optional<std::size_t> count, double least_area) const;
  // For every point that the finder was given, the component that is nearest to it, as its place in
  // the list; none: there is none within reach.
  const std::vector<std::optional<std::size_t>>& atPoints() const { return at_points_; }
  // The places in the list of a batch's components, in the order of their first vertices. Of the
  // same query, as a whole; empty: there was none in that brick.
  std::span<const std::uint32_t> ofBatch(const MeshBatch& batch) const;
  // Bytes that it takes in memory, about.
  std::uint64_t bytes() const;

 private:
  friend class ComponentFinder;
  friend class ComponentFilter;
  // Components of batches, before they are joined: those of a batch follow each other.
  struct Batch {
    std::uint64_t key = 0;    // of its brick
    std::uint64_t first = 0;  // the number of its first component
    std::uint32_t count = 0;  // of components
  };
  std::vector<SurfaceComponent> list_;
  std::vector<Batch> batches_;          // ascending in `key`
  std::vector<std::uint32_t> of_part_;  // of a component of a batch: the place in the list
  std::vector<std::optional<std::size_t>> at_points_;
};

// First pass: a sink that finds the components of the surface that it receives. Its memory grows
// with the number of components in bricks, 100 bytes each. The result depends on the query alone.
class ComponentFinder : public TriangleSink {
 public:
  // `query`: the one that is extracted; `points`: whose components are looked for.
  explicit ComponentFinder(const Query& query, ComponentPoints points = {});
  ~ComponentFinder() override;

  void begin(const MeshFrame& frame) override;
  void prepare(PlacedBatch& placed) override;
  void place(PlacedBatch& placed) override;
  void write(PlacedBatch& placed) override;
  void finish() override;

  // After the extraction. Moves them out.
  SurfaceComponents take() { return std::move(components_); }

 private:
  struct Joined;
  bool is_capped_;  // in the border of the volume, of a box or of a region
  bool is_cut_;     // by a box or a region, or open beside voxels without data
  ComponentPoints points_;
  MeshFrame frame_;
  WorldPlacement placement_;
  std::unique_ptr<Joined> joined_;
  SurfaceComponents components_;
};

// Gives vertices the numbers of their components in a list. Thread-safe.
class ComponentNumbers {
 public:
  virtual ~ComponentNumbers() = default;
  // Of every vertex of a whole batch, or kNoComponent. One component of the batch has one number.
  virtual void find(const MeshBatch& batch, std::vector<std::uint32_t>& numbers) const = 0;
};

// A stage before a sink that fills PlacedBatch::components. `numbers` and `sink` outlive it.
class ComponentNumbering : public TriangleSink {
 public:
  // `numbers`: of the surface that comes.
  ComponentNumbering(const ComponentNumbers& numbers, TriangleSink& sink)
      : numbers_(numbers), sink_(sink) {}

  void begin(const MeshFrame& frame) override { sink_.begin(frame); }
  void prepare(PlacedBatch& placed) override {
    numbers_.find(placed.batch, placed.components);
    sink_.prepare(placed);
  }
  void place(PlacedBatch& placed) override { sink_.place(placed); }
  void write(PlacedBatch& placed) override { sink_.write(placed); }
  void finish() override { sink_.finish(); }

 private:
  const ComponentNumbers& numbers_;
  TriangleSink& sink_;
};

// Second pass: a sink that passes on some components of the list, of the same query. The mesh is
// closed where the whole surface is. `components` and `sink` outlive it. Vertices get their
// components' places in the list (PlacedBatch::components).
class ComponentFilter : public TriangleSink {
 public:
  // Reads `components` during the extraction, and gives batches of its first `count` to `sink`.
  ComponentFilter(const SurfaceComponents& components, std::size_t count, TriangleSink& sink);
  // The same for those for which `is_kept` is not 0, an entry for each of the list.
  // `numbers`, which outlive it: those that vertices get in place of the places in the list; null:
  // these.
  ComponentFilter(const SurfaceComponents& components, std::vector<std::uint8_t> is_kept,
                  TriangleSink& sink, const ComponentNumbers* numbers = nullptr);

  void begin(const MeshFrame& frame) override { sink_.begin(frame); }
  void prepare(PlacedBatch& placed) override;
  void place(PlacedBatch& placed) override { sink_.place(placed); }
  void write(PlacedBatch& placed) override { sink_.write(placed); }
  void finish() override { sink_.finish(); }

 private:
  const SurfaceComponents& components_;
  const std::vector<std::uint8_t> is_kept_;
  TriangleSink& sink_;
  const ComponentNumbers* numbers_;
};

}  // namespace isobrick
