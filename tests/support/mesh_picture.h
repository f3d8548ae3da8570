// Meshes as surfaces to be drawn, in a world that is the lattice itself.
#pragma once

#include <glm/geometric.hpp>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "isobrick/viewer/offscreen_renderer.h"
#include "isobrick/viewer/view_picture.h"

namespace isobrick::test {

// A chunk for each level of the triangles (empty: all are of level 0). `normals`: one a position;
// empty: each triangle is a flat facet.
inline DrawableSurface surfaceOf(std::span<const glm::vec3> positions,
                                 std::span<const glm::vec3> normals,
                                 std::span<const std::uint32_t> triangles,
                                 std::span<const std::uint8_t> levels) {
  std::map<int, SurfaceChunk> chunks;
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    const int level = levels.empty() ? 0 : levels[i / 3];
    SurfaceChunk& chunk = chunks[level];
    chunk.level = level;
    const glm::vec3 &a = positions[triangles[i]], &b = positions[triangles[i + 1]],
                    &c = positions[triangles[i + 2]];
    const glm::vec3 facet = glm::cross(b - a, c - a);
    const float area = glm::length(facet);
    for (std::size_t k = i; k < i + 3; ++k) {
      const glm::vec3 normal = !normals.empty() ? normals[triangles[k]]
                               : area > 0.0f    ? facet / area
                                                : glm::vec3(0.0f);
      chunk.triangles.push_back(static_cast<std::uint32_t>(chunk.vertices.size()));
      chunk.vertices.push_back({positions[triangles[k]], packNormal(normal)});
    }
  }
  DrawableSurface surface;
  for (auto& [level, chunk] : chunks) {
    boundChunk(chunk);
    surface.chunks.push_back(std::move(chunk));
  }
  surface.triangles = triangles.size() / 3;
  return surface;
}

// A view that shows nothing but the surface, and the size of its picture.
struct MeshLook {
  MeshLook() {
    view.show_box = false;
    view.focus.show_sphere = false;
  }
  int width = 1024, height = 1024;
  ViewState view;
  bool is_placed = false;         // the view's camera; else all of the surface is framed
  std::optional<WorldBox> frame;  // or this
};

inline Image pictureOf(OffscreenRenderer& renderer, DrawableSurface surface, MeshLook look) {
  const double aspect = static_cast<double>(look.width) / look.height;
  CameraFit fit(look.view.camera, aspect);
  if (look.frame)
    for (const glm::dvec3& corner : cornersOf(*look.frame)) fit.include(corner);
  else
    surface.forEachVertex([&](const glm::dvec3& point) { fit.include(point); });
  if (!look.is_placed) look.view.camera = fit.fitted();
  Image picture;
  renderer.drawSurface(std::move(surface), {&look.view, 1}, {look.width, look.height}, CancelFlag(),
                       [&](ViewRows rows) { appendRows(rows.rows, picture); });
  return picture;
}

}  // namespace isobrick::test
