// The surfaces that are shown: of which request, and how fine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/viewer/session/shown_volume.h"
#include "isobrick/viewer/stream/surface_stream.h"

namespace isobrick {

class ShownSurfaces {
 public:
  // `pass` is shown from now on; `asked`: by its request.
  void take(const StreamMessage& pass, const AskedView& asked);
  // Nothing is shown any longer.
  void forget() { surfaces_.clear(); }

  // The pass that is shown; before the first one, one of request 0.
  const StreamMessage& pass() const { return pass_; }
  // Passes that were shown so far.
  std::uint64_t passes() const { return passes_; }
  // A surface is shown that is what `view` asks for, all of it as fine as with radius `least`, or
  // finer, but not finer than with `most`.
  bool has(std::size_t surface, const AskedView& view, double least, double most) const;

  std::uint64_t triangles() const;
  // Of all surfaces together, by the pyramid's levels.
  std::vector<LevelCounts> levels() const;
  // Pieces that users chose and that are not there.
  std::size_t lostPieces() const;
  // A surface that is shown, by its number; null: it is not.
  const StreamedSurface* surface(std::size_t number) const;

 private:
  // What the shown part of a surface was made of.
  struct Shown {
    AskedView asked;
    double radius = 0.0;
    bool is_complete = false;
    StreamedSurface counts;
  };
  std::map<int, Shown> surfaces_;  // by number
  StreamMessage pass_;
  std::uint64_t passes_ = 0;
};

}  // namespace isobrick
