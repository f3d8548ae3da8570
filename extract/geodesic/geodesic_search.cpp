#include "isobrick/extract/geodesic/geodesic_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <numbers>
#include <queue>
#include <tuple>

namespace isobrick {
namespace {

constexpr std::uint32_t kNoNumber = ~std::uint32_t{0};
constexpr double kNeverReached = std::numeric_limits<double>::infinity();
// Two lengths that differ by less, of their own size, may be equal.
constexpr double kRounding = 1e-10;
constexpr unsigned kCancelEvery = 1024;

double crossOf(const glm::dvec2& a, const glm::dvec2& b) { return a.x * b.y - a.y * b.x; }

// Inside its triangle by a hair, so that no window begins on the line that it lies on.
glm::dvec3 pulledInside(const glm::dvec3& place, const std::array<glm::dvec3, 3>& corners) {
  const glm::dvec3 middle = (corners[0] + corners[1] + corners[2]) / 3.0;
  return place + 1e-6 * (middle - place);
}

}  // namespace

GeodesicSearch::GeodesicSearch(std::span<const glm::dvec3> positions,
                               std::span<const std::uint32_t> triangles)
    : positions_(positions), triangles_(triangles) {
  corners_.set(triangles, positions.size());
  std::vector<double> turns(positions.size(), 0.0);
  for (std::size_t i = 0; i < triangles.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec3& at = positions[triangles[i + k]];
      const glm::dvec3 a = positions[triangles[i + (k + 1) % 3]] - at;
      const glm::dvec3 b = positions[triangles[i + (k + 2) % 3]] - at;
      turns[triangles[i + k]] += std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
    }
  may_bend_.resize(positions.size());
  for (std::uint32_t v = 0; v < may_bend_.size(); ++v)
    may_bend_[v] =
        turns[v] > 2.0 * std::numbers::pi + 1e-9 || corners_.ring(v) != CornerTable::Ring::kClosed;
}

double GeodesicSearch::lengthAlongEdges(const TrianglePoint& from, const TrianglePoint& to,
                                        const GeodesicBounds& bounds) const {
  if (from.triangle == to.triangle) return glm::distance(from.place, to.place);
  struct Reached {
    double least = 0.0, length = 0.0;
    std::uint32_t vertex = 0;
    bool operator<(const Reached& other) const { return least > other.least; }
  };
  std::vector<double> lengths(positions_.size(), kNeverReached);
  std::priority_queue<Reached> queue;
  const auto reach = [&](std::uint32_t vertex, double length) {
    if (!(length < lengths[vertex])) return;
    lengths[vertex] = length;
    queue.push({length + glm::distance(positions_[vertex], to.place), length, vertex});
  };
  for (std::size_t k = 0; k < 3; ++k) {
    const std::uint32_t vertex = triangles_[3 * std::size_t{from.triangle} + k];
    reach(vertex, glm::distance(from.place, positions_[vertex]));
  }
  const std::span goal = triangles_.subspan(3 * std::size_t{to.triangle}, 3);
  double best = kNeverReached;
  for (unsigned count = 0; !queue.empty() && queue.top().least < best; ++count) {
    if (count % kCancelEvery == 0 && bounds.cancel != nullptr) bounds.cancel->check();
    const Reached at = queue.top();
    queue.pop();
    if (at.length > lengths[at.vertex]) continue;
    if (std::ranges::find(goal, at.vertex) != goal.end()) best = std::min(best, at.least);
    for (const std::uint32_t corner : corners_.cornersOf(at.vertex))
      for (const std::uint32_t other : {CornerTable::next(corner), CornerTable::previous(corner)}) {
        const std::uint32_t vertex = corners_.vertex(other);
        reach(vertex, at.length + glm::distance(positions_[at.vertex], positions_[vertex]));
      }
  }
  return best;
}

// One search.
class WindowSearch {
 public:
  WindowSearch(const GeodesicSearch& mesh, const TrianglePoint& from, const TrianglePoint& to,
               const GeodesicBounds& bounds)
      : mesh_(mesh),
        bounds_(bounds),
        from_triangle_(from.triangle),
        to_triangle_(to.triangle),
        vertices_(mesh.positions_.size()),
        splits_(mesh.triangles_.size()) {
    from_ = pulledInside(from.place, cornersOf(from_triangle_));
    to_ = pulledInside(to.place, cornersOf(to_triangle_));
    best_ = bounds.longest * (1.0 + kRounding);
  }

  std::optional<GeodesicPath> run() {
    if (from_triangle_ == to_triangle_) {
      const std::uint32_t vertex = vertexOf(CornerTable::firstCorner(to_triangle_));
      return GeodesicPath{
          {from_, to_}, {{vertex, vertex}, {vertex, vertex}}, glm::distance(from_, to_)};
    }
    leave(kNoNumber, 0.0, from_, CornerTable::firstCorner(from_triangle_));
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t vertex =
          mesh_.corners_.vertex(CornerTable::firstCorner(from_triangle_) + k);
      reach(vertex, glm::distance(from_, position(vertex)), kNoNumber, kNoNumber);
    }
    const double straight = glm::distance(from_, to_);
    for (unsigned count = 0; !queue_.empty() && queue_.top().least < best_; ++count) {
      const Event event = queue_.top();
      queue_.pop();
      if (count % kCancelEvery == 0) {
        if (bounds_.cancel != nullptr) bounds_.cancel->check();
        noteProgress(event.least - straight, straight);
      }
      if (event.is_vertex)
        bendAt(event.number, event.length);
      else
        cross(event.number);
    }
    if (!goal_window_ && !goal_vertex_) return std::nullopt;
    return path();
  }

 private:
  // A window of the edge that a corner faces. The edge runs from the next corner's vertex at (0, 0)
  // along x; the corner's triangle, into which the lines go, lies above it.
  struct Window {
    double begin = 0.0, end = 0.0;  // along the edge
    glm::dvec2 source{0.0};         // the lines' common point, below
    double before = 0.0;            // length of the path up to there
    std::uint32_t corner = 0;
    std::uint32_t parent = kNoNumber;  // the window that it was made of
    std::uint32_t vertex = kNoNumber;  // at the source; none: the path's first point
  };
  struct Event {
    double least = 0.0;  // length of a path to the goal through it
    double length = 0.0;
    std::uint32_t number = 0;  // of a window, or a vertex
    bool is_vertex = false;
    bool operator<(const Event& other) const {
      return std::tie(least, number) > std::tie(other.least, other.number);
    }
  };
  struct Vertex {
    double length = kNeverReached;  // of the shortest path so far
    std::uint32_t window = kNoNumber,
                  vertex = kNoNumber;  // that it came from; none: the first point
  };
  // The window facing a corner by which its vertex is reached first: how long the way is, and where
  // it crosses the edge.
  struct Split {
    double length = kNeverReached, along = 0.0;
  };
  // A triangle in the frame of a corner.
  struct Frame {
    double edge = 0.0;
    glm::dvec2 tip{0.0};  // the corner's vertex
  };

  const glm::dvec3& position(std::uint32_t vertex) const { return mesh_.positions_[vertex]; }
  std::uint32_t vertexOf(std::uint32_t corner) const { return mesh_.corners_.vertex(corner); }
  std::array<glm::dvec3, 3> cornersOf(std::uint32_t triangle) const {
    const std::uint32_t* const v = mesh_.triangles_.data() + 3 * std::size_t{triangle};
    return {position(v[0]), position(v[1]), position(v[2])};
  }
  // Where a point of the corner's triangle lies in the corner's frame.
  glm::dvec2 inFrame(std::uint32_t corner, const glm::dvec3& point) const {
    const glm::dvec3& origin = position(vertexOf(CornerTable::next(corner)));
    const glm::dvec3 along = position(vertexOf(CornerTable::previous(corner))) - origin;
    const glm::dvec3 to = point - origin;
    const double edge = glm::length(along);
    return {glm::dot(to, along) / edge, glm::length(glm::cross(along, to)) / edge};
  }
  Frame frameOf(std::uint32_t corner) const {
    return {glm::distance(position(vertexOf(CornerTable::next(corner))),
                          position(vertexOf(CornerTable::previous(corner)))),
            inFrame(corner, position(vertexOf(corner)))};
  }
  // The same edge's corner beyond it.
  std::uint32_t beyond(std::uint32_t corner) const { return mesh_.corners_.opposite(corner); }
  double lengthAt(std::uint32_t corner) const { return vertices_[vertexOf(corner)].length; }
  static double lengthTo(const Window& window, double along) {
    return window.before + glm::distance(window.source, {along, 0.0});
  }
  // Where the line from the window's source to a point above the edge crosses it.
  static double crossingOf(const Window& window, const glm::dvec2& point) {
    const glm::dvec2& s = window.source;
    const double height = point.y - s.y;
    return height > 0.0 ? s.x + (point.x - s.x) * -s.y / height : s.x;
  }

  void noteProgress(double certain, double straight) {
    if (bounds_.fraction_done == nullptr || !std::isfinite(best_)) return;
    const double share = best_ > straight ? certain / (best_ - straight) : 1.0;
    const auto now = static_cast<float>(std::clamp(share, 0.0, 1.0));
    if (now > *bounds_.fraction_done) *bounds_.fraction_done = now;
  }

  // Straight lines from a point of a triangle, or from one of its vertices, to the side that a
  // corner faces, and beyond.
  void leaveBy(std::uint32_t facing, std::uint32_t vertex, double before, const glm::dvec3& point) {
    const std::uint32_t corner = beyond(facing);
    if (corner == CornerTable::kNone) return;
    const glm::dvec2 there = inFrame(facing, point);
    Window window;
    window.end = frameOf(corner).edge;
    // The frame beyond has the same edge the other way round, and the point below.
    window.source = {window.end - there.x, -there.y};
    window.before = before;
    window.corner = corner;
    window.vertex = vertex;
    add(window, kNoNumber);
  }
  void leave(std::uint32_t vertex, double before, const glm::dvec3& point, std::uint32_t first) {
    for (std::uint32_t k = 0; k < 3; ++k) leaveBy(first + k, vertex, before, point);
  }

  // The path to a vertex is so long, by a window or along an edge.
  void reach(std::uint32_t vertex, double length, std::uint32_t window, std::uint32_t before) {
    Vertex& at = vertices_[vertex];
    if (!(length < at.length)) return;
    at = {length, window, before};
    const double least = length + glm::distance(position(vertex), to_);
    if (!(least < best_)) return;
    for (std::uint32_t k = 0; k < 3; ++k)
      if (vertexOf(CornerTable::firstCorner(to_triangle_) + k) == vertex) {
        best_ = least;
        goal_vertex_ = vertex;
        goal_window_.reset();
      }
    if (mesh_.may_bend_[vertex] != 0) push({least, length, vertex, true});
  }

  // From a vertex on, in all directions: those in which no shortest path goes cost little.
  void bendAt(std::uint32_t vertex, double length) {
    if (length > vertices_[vertex].length) return;
    for (const std::uint32_t corner : mesh_.corners_.cornersOf(vertex)) {
      for (const std::uint32_t end : {CornerTable::next(corner), CornerTable::previous(corner)}) {
        const std::uint32_t other = vertexOf(end);
        reach(other, length + glm::distance(position(vertex), position(other)), kNoNumber, vertex);
      }
      leaveBy(corner, vertex, length, position(vertex));
    }
  }

  // True if another path is shorter at all of its points. The path to a vertex of the edge, and
  // along it, meets all of the window's lines; so does that over the triangle before the edge, from
  // its third vertex to the window's end on the side where the lines came in.
  bool isBeaten(const Window& window, double edge) const {
    const double to_begin = lengthTo(window, window.begin), to_end = lengthTo(window, window.end);
    const auto isLess = [](double other, double own) { return other < own * (1.0 - kRounding); };
    if (isLess(lengthAt(CornerTable::next(window.corner)) + window.end, to_end)) return true;
    if (isLess(lengthAt(CornerTable::previous(window.corner)) + edge - window.begin, to_begin))
      return true;
    if (window.parent == kNoNumber) return false;
    const std::uint32_t third = beyond(window.corner);
    const bool from_begin = windows_[window.parent].corner == CornerTable::next(third);
    const double length = lengthAt(third), own = from_begin ? to_begin : to_end;
    if (!isLess(length, own)) return false;
    const glm::dvec2 above = inFrame(third, position(vertexOf(third)));
    const double along = edge - above.x - (from_begin ? window.begin : window.end);
    return isLess(length + std::hypot(along, above.y), own);
  }

  // The least length of a path to the goal through the window.
  double leastBy(const Window& window, double edge) const {
    const double along = std::clamp(window.source.x, window.begin, window.end);
    const glm::dvec3& a = position(vertexOf(CornerTable::next(window.corner)));
    const glm::dvec3 direction =
        (position(vertexOf(CornerTable::previous(window.corner))) - a) / edge;
    const double nearest = std::clamp(glm::dot(to_ - a, direction), window.begin, window.end);
    return lengthTo(window, along) + glm::distance(a + nearest * direction, to_);
  }

  void add(Window window, std::uint32_t parent) {
    window.parent = parent;
    const double edge = frameOf(window.corner).edge;
    window.begin = std::max(window.begin, 0.0);
    window.end = std::min(window.end, edge);
    if (!(window.end - window.begin > 1e-12 * edge)) return;
    const double least = leastBy(window, edge);
    if (!(least < best_) || isBeaten(window, edge)) return;
    std::uint32_t number = kNoNumber;
    if (free_.empty()) {
      number = static_cast<std::uint32_t>(windows_.size());
      windows_.push_back(window);
    } else {
      number = free_.back();
      free_.pop_back();
      windows_[number] = window;
    }
    has_child_ = true;
    push({least, 0.0, number, false});
  }

  void push(const Event& event) {
    queue_.push(event);
    const std::uint64_t bytes =
        windows_.size() * sizeof(Window) + (queue_.size() + free_.size()) * sizeof(Event);
    if (bytes > bounds_.most_bytes || windows_.size() >= kNoNumber) throw SearchTooLarge{};
  }

  // Takes a window over its triangle.
  void cross(std::uint32_t number) {
    const Window window = windows_[number];
    const Frame frame = frameOf(window.corner);
    has_child_ = false;
    if (!isBeaten(window, frame.edge)) {
      if (CornerTable::triangleOf(window.corner) == to_triangle_)
        arrive(number, window);
      else
        split(number, window, frame);
    }
    if (!has_child_) free_.push_back(number);
  }

  void arrive(std::uint32_t number, const Window& window) {
    const glm::dvec2 goal = inFrame(window.corner, to_);
    const double along = crossingOf(window, goal);
    const double slack = 1e-9 * (window.end - window.begin);
    if (along < window.begin - slack || along > window.end + slack) return;
    const double length = window.before + glm::distance(window.source, goal);
    if (!(length < best_)) return;
    best_ = length;
    goal_window_ = number;
    goal_vertex_.reset();
    has_child_ = true;
  }

  void split(std::uint32_t number, const Window& window, const Frame& frame) {
    const double along = crossingOf(window, frame.tip);
    const double slack = 1e-9 * (window.end - window.begin);
    const bool sees_tip = along > window.begin - slack && along < window.end + slack;
    bool to_left = along > window.begin, to_right = along < window.end;
    if (sees_tip) {
      const double length = window.before + glm::distance(window.source, frame.tip);
      // If several windows see the vertex, only the nearest one needs both sides: the lines of
      // another one to one of the sides cross its path to the vertex, or come out beside it.
      Split& nearest =
          splits_[3 * std::size_t{CornerTable::triangleOf(window.corner)} + (window.corner & 3)];
      if (length < nearest.length) {
        nearest = {length, along};
      } else if (length > nearest.length * (1.0 + kRounding)) {
        to_right = to_right && along > nearest.along;
        to_left = to_left && along < nearest.along;
      }
      if (length < vertices_[vertexOf(window.corner)].length) {
        reach(vertexOf(window.corner), length, number, kNoNumber);
        has_child_ = true;
      }
    }
    // The sides, seen from beyond them: from the edge's beginning to the tip, and on to its end.
    if (to_left) {
      const Side side{CornerTable::previous(window.corner), {0.0, 0.0}, frame.tip};
      const double edge = glm::length(frame.tip);
      addOver(side, number, window, meeting(window, window.begin, side, 0.0),
              along < window.end ? edge : meeting(window, window.end, side, edge));
    }
    if (to_right) {
      const Side side{CornerTable::next(window.corner), frame.tip, {frame.edge, 0.0}};
      addOver(side, number, window,
              along > window.begin ? 0.0 : meeting(window, window.begin, side, 0.0),
              meeting(window, window.end, side, glm::distance(side.from, side.to)));
    }
  }

  // A side of the triangle in the frame of one of its corners.
  struct Side {
    std::uint32_t facing = 0;  // the corner
    glm::dvec2 from{0.0}, to{0.0};
  };

  // Where on a side the line through a point of the window's edge meets it; `else_at`: they are
  // parallel.
  static double meeting(const Window& window, double at, const Side& side, double else_at) {
    const glm::dvec2 line = glm::dvec2(at, 0.0) - window.source;
    const glm::dvec2 along = glm::normalize(side.to - side.from);
    const double place = crossOf(line, window.source - side.from) / crossOf(line, along);
    return std::isfinite(place) ? place : else_at;
  }

  // The window's lines over a part of a side.
  void addOver(const Side& side, std::uint32_t number, const Window& window, double begin,
               double end) {
    Window child = window;
    child.corner = beyond(side.facing);
    if (child.corner == CornerTable::kNone) return;
    const glm::dvec2 along = glm::normalize(side.to - side.from);
    const glm::dvec2 source = window.source - side.from;
    child.source = {glm::dot(source, along), crossOf(along, source)};
    child.begin = begin;
    child.end = end;
    add(child, number);
  }

  // ------------------------------------------------------------------------------------- the path

  // From a point above the window's edge back to the window's source, which is not added.
  void traceBack(std::uint32_t number, glm::dvec2 point, GeodesicPath& path) const {
    while (true) {
      const Window& window = windows_[number];
      const double along = std::clamp(crossingOf(window, point), window.begin, window.end);
      const std::uint32_t begin = vertexOf(CornerTable::next(window.corner));
      const std::uint32_t end = vertexOf(CornerTable::previous(window.corner));
      const glm::dvec3 &a = position(begin), &b = position(end);
      const glm::dvec3 place = a + along / glm::distance(a, b) * (b - a);
      path.points.push_back(place);
      path.beside.push_back({begin, end});
      if (window.parent == kNoNumber) return;
      number = window.parent;
      point = inFrame(windows_[number].corner, place);
    }
  }

  GeodesicPath path() const {
    GeodesicPath path;
    path.points.push_back(to_);
    path.beside.emplace_back();
    std::uint32_t vertex = kNoNumber;  // that the path goes back to
    if (goal_window_) {
      traceBack(*goal_window_, inFrame(windows_[*goal_window_].corner, to_), path);
      vertex = windows_[*goal_window_].vertex;
    } else {
      vertex = *goal_vertex_;
    }
    while (vertex != kNoNumber) {
      path.points.push_back(position(vertex));
      path.beside.push_back({vertex, vertex});
      const Vertex& at = vertices_[vertex];
      if (at.window != kNoNumber) {
        const Window& window = windows_[at.window];
        traceBack(at.window, inFrame(window.corner, position(vertex)), path);
        vertex = window.vertex;
      } else {
        vertex = at.vertex;
      }
    }
    path.points.push_back(from_);
    path.beside.push_back(path.beside.back());
    path.beside[0] = path.beside[1];
    std::ranges::reverse(path.points);
    std::ranges::reverse(path.beside);
    for (std::size_t i = 1; i < path.points.size(); ++i)
      path.length += glm::distance(path.points[i - 1], path.points[i]);
    return path;
  }

  const GeodesicSearch& mesh_;
  const GeodesicBounds& bounds_;
  const std::uint32_t from_triangle_, to_triangle_;
  glm::dvec3 from_{0.0}, to_{0.0};
  std::vector<Vertex> vertices_;
  std::vector<Split> splits_;  // of corners
  std::vector<Window> windows_;
  std::vector<std::uint32_t> free_;  // windows that nothing came of
  std::priority_queue<Event> queue_;
  bool has_child_ = false;                                  // of the window that is crossed
  double best_ = kNeverReached;                             // length of a path
  std::optional<std::uint32_t> goal_window_, goal_vertex_;  // the last part of it
};

std::optional<GeodesicPath> GeodesicSearch::shortestPath(const TrianglePoint& from,
                                                         const TrianglePoint& to,
                                                         const GeodesicBounds& bounds) const {
  return WindowSearch(*this, from, to, bounds).run();
}

}  // namespace isobrick
