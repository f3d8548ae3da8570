// Surfaces for a program that draws them itself: a stream extracts beside it and says when
// something waits. Each finished pass is a mesh, from coarse to fine; the last one goes to
// streamed.ply.
#include <isobrick/isobrick.h>

#include <cstdio>
#include <fstream>
#include <semaphore>

using namespace isobrick;

// For a little-endian machine.
static void writePly(const char* path, const MergedSurface& mesh) {
  std::ofstream file(path, std::ios::binary);
  file << "ply\nformat binary_little_endian 1.0\nelement vertex " << mesh.vertices.size()
       << "\nproperty double x\nproperty double y\nproperty double z\nelement face "
       << mesh.levels.size() << "\nproperty list uchar uint vertex_indices\nend_header\n";
  const auto write = [&](const void* bytes, std::size_t count) {
    file.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(count));
  };
  write(mesh.vertices.data(), mesh.vertices.size() * sizeof(glm::dvec3));
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 3) {
    file.put(3);
    write(&mesh.triangles[i], 3 * sizeof(std::uint32_t));
  }
}

int main() try {
  buildPyramid(*makePhantomSource({.name = "head", .size = 128}), "streamed.isb", {});
  const auto pyramid = std::make_shared<const Pyramid>("streamed.isb");

  std::counting_semaphore<> news(0);  // an interface posts an event to itself instead
  SurfaceStream stream(pyramid, 2, [&] { news.release(); });
  SurfaceMerger merger(pyramid->spec().geometry);

  StreamRequest request;  // a newer one would end it
  for (const double radius : {8.0, 24.0, 200.0}) {
    Query query;
    query.isovalue = 1324;
    query.focus = FocusSphere{{75, 30, 75}, radius};
    request.passes.push_back(passOf(query));
  }
  stream.request(std::move(request));

  for (;; news.acquire()) {
    while (const auto end = merger.next(stream)) {
      if (end->kind == StreamMessage::Kind::kFailed) throw Error(end->error);
      std::printf("radius %.0f: %llu triangles, %llu of them new%s\n", end->radius,
                  static_cast<unsigned long long>(end->triangles),
                  static_cast<unsigned long long>(end->triangles_made),
                  end->is_complete ? "" : "; more to come");
      if (!end->last_pass) continue;
      writePly("streamed.ply", merger.merged());
      return 0;
    }
  }
} catch (const Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
