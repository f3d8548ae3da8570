// The components of a surface, listed once for all uses: lists, picks, choices and colours.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/component_choice.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/storage/pyramid.h"

namespace isobrick {

// A surface of one level, all of it, to be listed.
struct ListingQuery {
  double isovalue = 0.0;
  int level = 0;
  const CancelFlag* cancel = nullptr;           // may be null
  std::atomic<float>* fraction_done = nullptr;  // Query::fraction_done
  std::uint64_t most_triangles = 0;             // more: TooManyTriangles; 0: any number
};

// The level of a query whose surface is all of that level, as lists are; none: of several, or not
// all of it.
std::optional<int> onlyLevelOf(const Query& query);

// Its components, by area. Does not change, so any number of threads may ask it.
class ListedComponents {
 public:
  // Extracts the surface. Throws as Extractor::execute() does, and TooManyTriangles.
  ListedComponents(Extractor& extractor, const Pyramid& pyramid, const ListingQuery& query);

  // No other list of this process has it; above 0.
  std::uint64_t number() const { return number_; }
  double isovalue() const { return isovalue_; }
  int level() const { return level_; }
  const SurfaceComponents& components() const { return components_; }
  // The largest area first.
  const std::vector<SurfaceComponent>& list() const { return components_.list(); }
  std::uint64_t bytes() const { return components_.bytes(); }

  // For every point the component that is nearest to it, as ComponentFinder finds it; only bricks
  // around the points are meshed. `extractor`: of the same pyramid. Throws as execute() does.
  std::vector<std::optional<std::size_t>> nearest(Extractor& extractor,
                                                  const ComponentPoints& points,
                                                  const CancelFlag* cancel) const;
  // The components that the choice leaves. A piece of this very list is found by its point alone.
  ChosenComponents chosen(Extractor& extractor, const PieceChoice& choice,
                          const CancelFlag* cancel) const;

 private:
  friend class ListedNumbers;
  std::optional<std::size_t> nearestTo(Extractor& extractor, const ExtractionPlan& plan,
                                       const glm::dvec3& point, double reach) const;

  const std::uint64_t number_;
  const double isovalue_;
  const int level_;
  const GridGeometry geometry_;
  const BrickLayout layout_;
  SurfaceComponents components_;
};

// The numbers of a list for the vertices of other meshes of its isovalue. A brick whose leaves, and
// all that touch them, are of the list's level has the same components; others have no numbers.
class ListedNumbers : public ComponentNumbers {
 public:
  // The list outlives it.
  explicit ListedNumbers(const ListedComponents& listed) : listed_(listed) {}
  void find(const MeshBatch& batch, std::vector<std::uint32_t>& numbers) const override;

 private:
  const ListedComponents& listed_;
};

// The lists of a pyramid that were used last, shared by all that use them. Thread-safe.
class KnownComponents {
 public:
  static constexpr std::uint64_t kMostBytes = std::uint64_t{64} << 20;

  // The newest one stays, whatever it takes.
  explicit KnownComponents(std::uint64_t most_bytes = kMostBytes) : most_bytes_(most_bytes) {}

  // Null: that surface was not listed, or the list had to go.
  std::shared_ptr<const ListedComponents> find(double isovalue, int level);
  // The list of `query`: the one that is known, or a new one, which is known then. Waits for one
  // that another thread makes of the same surface. Throws as ListedComponents().
  std::shared_ptr<const ListedComponents> findOrList(Extractor& extractor, const Pyramid& pyramid,
                                                     const ListingQuery& query);
  std::uint64_t listings() const { return listings_; }

 private:
  using Surface = std::pair<double, int>;  // isovalue and level

  std::shared_ptr<const ListedComponents> known(const Surface& surface);
  std::shared_ptr<const ListedComponents> begin(const ListingQuery& query);
  void end(const Surface& surface, const std::shared_ptr<const ListedComponents>& listed);

  const std::uint64_t most_bytes_;
  std::atomic<std::uint64_t> listings_{0};
  std::mutex mutex_;  // guards the rest
  std::condition_variable ended_;
  std::set<Surface> under_way_;
  std::list<std::shared_ptr<const ListedComponents>> lists_;  // the one used last comes first
};

}  // namespace isobrick
