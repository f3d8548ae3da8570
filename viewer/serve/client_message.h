// Messages of clients of a stream, which may be hostile: docs/SERVE.md, "The stream".
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <variant>

#include "isobrick/viewer/serve/asked.h"
#include "isobrick/viewer/state/view_state.h"

namespace isobrick {

inline constexpr std::size_t kMostMessageBytes = std::size_t{64} << 10;
inline constexpr std::size_t kMostWishedSurfaces = 8;

// The surfaces that a client wishes to see, every number within its bounds.
struct ClientWish {
  std::int64_t number = 0;  // the client's
  SurfaceWish surfaces;
  // Of all that the client keeps; none: no bound.
  std::optional<std::uint64_t> most_triangles = {}, most_bytes = {};
};

// The words of a wish, and of a surface's file, that say what of the volume counts: 'inside', and
// 'clip' and 'sphere', in voxel indices.
InsideOf askedInside(const Asked& asked);
ViewRegion askedRegion(const Asked& asked);

// A pass is on the client's screen.
struct ClientShown {
  std::uint64_t pass = 0;
  double seconds = 0.0;  // since its first chunk had arrived, 0 .. 10
};

// Nothing: a type that this server does not know.
using ClientMessage = std::variant<std::monostate, ClientWish, ClientShown>;

// `volume`: that the message is about. Throws Error, one line, if it is no such message.
ClientMessage parseClientMessage(const Asked& asked, const ViewVolume& volume);

}  // namespace isobrick
