// Several surfaces in one file: objects with names and colours of their own.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>

#include "isobrick/extract/sinks/mesh_file_sink.h"

namespace isobrick {

// An object of such a file.
struct MeshObject {
  std::string name;                     // UTF-8
  std::optional<glm::vec3> color = {};  // sRGB, 0 .. 1
  std::uint64_t label = 0;              // of makeLabelCollection()
};

// A file of several surfaces. Used by one thread at a time, but its sinks as others.
class MeshCollection {
 public:
  virtual ~MeshCollection() = default;
  // The sink of one more object, which the file holds in the order of these calls. Sinks may be
  // filled one after the other or side by side; each does without the collection only after its
  // finish(). A surface without triangles is left out.
  virtual std::unique_ptr<MeshFileSink> add(const MeshObject& object) = 0;
  // After the last finish(): gives the file its name.
  virtual void finish() = 0;
};

// For `path`, a .glb (a node and a mesh for each surface) or a .3mf (an object for each, all at
// their place). Nothing is left of one that is destroyed before its finish(). Throws Error for
// other endings, options that the format has not, and a path that cannot be written.
std::unique_ptr<MeshCollection> makeMeshCollection(const std::string& path,
                                                   const MeshFileOptions& options = {});

// The same for the surfaces of labels, and for .ply, .vtp and .obj too. These hold one mesh, whose
// sinks are filled one after the other. In .ply and .vtp vertices have the label as their last
// attribute, `label`, a whole number of 32 bits; add() throws Error for a greater one. In .obj each
// label is a group of the object's name.
std::unique_ptr<MeshCollection> makeLabelCollection(const std::string& path,
                                                    const MeshFileOptions& options = {});

}  // namespace isobrick
