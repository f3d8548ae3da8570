// Writes notes into a picture.
#pragma once

#include <string>
#include <vector>

#include "isobrick/viewer/image.h"
#include "isobrick/viewer/notes/picture_canvas.h"
#include "isobrick/viewer/picture_notes.h"
#include "isobrick/viewer/placed_camera.h"

namespace isobrick {

// A round length, 1, 2 or 5 times a power of ten, and its size in a picture.
struct ScaleBar {
  double length = 0.0;  // world units
  double pixels = 0.0;
};
// At most `most_pixels` long, if a pixel is `per_pixel` world units; 0 without a scale.
ScaleBar scaleBarOf(double per_pixel, double most_pixels);
// "50 mm", "20 µm"; without a unit if the world's is not known.
std::string lengthText(double length, LengthUnit unit);

// For each text and mark in the order in which they are drawn, if it is white: on a dark ground.
using NoteInks = std::vector<bool>;

// `camera` drew the picture; `target_distance` is from its eye to what the scale bar measures, in
// world units. Throws Error if there is something to draw, and isobrick was built without a font.
NoteInks drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
                   Image& image);
// The same into some rows of a picture, whose other rows may not be there, with the inks of the
// same picture, whatever its size.
void drawNotes(const PictureNotes& notes, const PlacedCamera& camera, double target_distance,
               const NoteInks& inks, const PictureRows& rows);

}  // namespace isobrick
