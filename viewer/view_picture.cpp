#include "isobrick/viewer/view_picture.h"

#include <algorithm>
#include <cstddef>
#include <glm/geometric.hpp>
#include <string>
#include <utility>

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

std::size_t pixelsOf(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

// Samples of a pixel were averaged.
void normalizeAll(std::vector<float>& normals) {
  for (std::size_t i = 0; i + 2 < normals.size(); i += 3) {
    glm::vec3 normal(normals[i], normals[i + 1], normals[i + 2]);
    const float length = glm::length(normal);
    for (glm::length_t c = 0; c < 3; ++c)
      normals[i + static_cast<std::size_t>(c)] = length > 1e-3f ? normal[c] / length : 0.0f;
  }
}

Image emptyRows(const PictureShape& shape, int height) {
  const std::size_t pixels = pixelsOf(shape.width, height);
  Image image{shape.width, height, std::vector<float>(3 * pixels)};
  if (shape.alpha) image.alpha.resize(pixels);
  if (shape.depth) image.depth.resize(pixels);
  if (shape.normals) image.normals.resize(3 * pixels);
  return image;
}

void copyTile(const Image& tile, int left, Image& band) {
  const auto copy = [&](const std::vector<float>& from, std::vector<float>& to,
                        std::size_t values) {
    if (from.empty()) return;
    const std::size_t row = values * static_cast<std::size_t>(tile.width);
    for (int y = 0; y < tile.height; ++y)
      std::copy_n(
          from.begin() + static_cast<std::ptrdiff_t>(row) * y, row,
          to.begin() + static_cast<std::ptrdiff_t>(
                           values * (pixelsOf(band.width, y) + static_cast<std::size_t>(left))));
  };
  copy(tile.rgb, band.rgb, 3);
  copy(tile.alpha, band.alpha, 1);
  copy(tile.depth, band.depth, 1);
  copy(tile.normals, band.normals, 3);
}

// `size` in equal parts of at most `most`.
int partOf(int size, int most) {
  const int parts = (size + most - 1) / most;
  return (size + parts - 1) / parts;
}

}  // namespace

double lineScaleOf(int width, int height) {
  constexpr double kWindow = 1024.0;
  return std::max(1.0, std::min(width, height) / kWindow);
}

void checkPictureSize(int width, int height) {
  if (width >= 1 && height >= 1 && width <= kMostPictureSide && height <= kMostPictureSide) return;
  throw Error("cannot render a picture of " + std::to_string(width) + " x " +
              std::to_string(height) + " pixels: width and height are 1 to " +
              std::to_string(kMostPictureSide));
}

PictureTiles::PictureTiles(SceneRenderer& renderer, SceneWithNotes scene, const TileLimits& limits)
    : renderer_(renderer), scene_(std::move(scene)) {
  const SceneFrame& frame = scene_.frame;
  checkPictureSize(frame.width, frame.height);
  const int around = renderer.neighbourhoodOf(frame);
  constexpr int kRounding = 4;  // that a renderer adds to it
  const int most = renderer.greatestSize() - 2 * around - kRounding;
  const int side = std::clamp(limits.most_side, 1, std::max(1, most));
  tile_width_ = partOf(frame.width, side);
  // Bands that are lower than what is drawn around them would cost more than they save.
  const int rows = std::max({1, around, limits.most_pixels / frame.width});
  band_height_ = partOf(frame.height, std::min(side, rows));
  next_ = {0, 0, tile_width_, band_height_};
}

PictureTiles::~PictureTiles() { renderer_.endTiles(); }

PictureShape PictureTiles::shape() const {
  const SceneFrame& frame = scene_.frame;
  return {frame.width, frame.height, frame.transparent, scene_.layers, scene_.layers, 0.0};
}

double PictureTiles::share() const {
  const double of_band = static_cast<double>(next_.left) / scene_.frame.width;
  return std::min(1.0, (next_.top + of_band * next_.height) / scene_.frame.height);
}

std::optional<Image> PictureTiles::drawNext() {
  const SceneFrame& frame = scene_.frame;
  if (!inks_) decideInks();
  if (next_.left == 0) band_ = emptyRows(shape(), next_.height);
  copyTile(layersOf(frame, next_), next_.left, band_);
  next_.left = next_.right();
  if (next_.left < frame.width) {
    next_.width = std::min(tile_width_, frame.width - next_.left);
    return std::nullopt;
  }
  drawNotes(scene_.notes, frame.camera, scene_.target_distance, *inks_,
            {band_, next_.top, frame.height});
  next_ = {0, next_.bottom(), tile_width_, 0};
  next_.height = std::min(band_height_, frame.height - next_.top);
  return std::move(band_);
}

// A text is black or white as its ground is light or dark, all of it: also the rows that are drawn
// later. So the ground is that of a small picture of the scene.
void PictureTiles::decideInks() {
  inks_.emplace();
  if (!scene_.notes.any()) return;
  SceneFrame small = scene_.frame;
  constexpr double kMostSide = 1024.0;
  const double scale = std::min(1.0, kMostSide / std::max(small.width, small.height));
  small.width = std::max(1, static_cast<int>(scale * small.width));
  small.height = std::max(1, static_cast<int>(scale * small.height));
  small.pixel_scale = std::max(1.0, scale * small.pixel_scale);
  Image ground = renderer_.drawTile(small, {0, 0, small.width, small.height}, false);
  *inks_ = drawNotes(scene_.notes, small.camera, scene_.target_distance, ground);
}

Image PictureTiles::layersOf(const SceneFrame& frame, const PixelBox& tile) const {
  Image image = renderer_.drawTile(frame, tile, false);
  if (!scene_.layers) return image;
  SceneFrame normals = frame;
  normals.normals = true;
  normals.transparent = false;
  Image second = renderer_.drawTile(normals, tile, true);
  image.normals = std::move(second.rgb);
  image.depth = std::move(second.depth);
  normalizeAll(image.normals);
  return image;
}

void appendRows(const Image& rows, Image& picture) {
  if (picture.height == 0) {
    picture = rows;
    return;
  }
  const auto append = [](const std::vector<float>& from, std::vector<float>& to) {
    to.insert(to.end(), from.begin(), from.end());
  };
  append(rows.rgb, picture.rgb);
  append(rows.alpha, picture.alpha);
  append(rows.depth, picture.depth);
  append(rows.normals, picture.normals);
  picture.height += rows.height;
}

Image drawWhole(SceneRenderer& renderer, SceneWithNotes scene, const TileLimits& limits) {
  PictureTiles tiles(renderer, std::move(scene), limits);
  Image image;
  while (!tiles.done())
    if (const std::optional<Image> rows = tiles.drawNext()) appendRows(*rows, image);
  return image;
}

SceneWithNotes pictureSceneOf(const ViewSession& session, int width, int height, bool layers) {
  SceneWithNotes scene;
  scene.frame = session.pictureFrame(width, height);
  scene.frame.pixel_scale = lineScaleOf(width, height);
  scene.layers = layers;
  scene.notes = session.notes();
  scene.target_distance = session.state().camera.distance;
  return scene;
}

}  // namespace isobrick
