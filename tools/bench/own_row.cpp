#include "tools/bench/own_row.h"

#include <sys/resource.h>

#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/surface_mesh.h"
#include "tools/bench/surface_distance.h"
#include "tools/progress_bar.h"

namespace isobrick {
namespace {

// Of this process until now.
struct ProcessUse {
  double processor_seconds;
  std::uint64_t peak_bytes;
};

ProcessUse processUse() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {seconds(usage.ru_utime) + seconds(usage.ru_stime),
          1024 * static_cast<std::uint64_t>(usage.ru_maxrss)};
}

PlainMesh plainMeshOf(const SurfaceMesh& mesh) {
  PlainMesh plain;
  for (const SurfaceMesh::Part& part : mesh.parts()) {
    const glm::vec3 origin(part.origin);
    for (const glm::vec3& local : mesh.positions().subspan(part.first_vertex, part.vertices)) {
      const glm::vec3 index = origin + local;
      plain.positions.push_back({index.x, index.y, index.z});
    }
  }
  const auto triangles = mesh.triangles();
  for (std::size_t i = 0; i + 2 < triangles.size(); i += 3)
    plain.triangles.push_back({triangles[i], triangles[i + 1], triangles[i + 2]});
  return plain;
}

}  // namespace

Json measureOwnRow(const OwnRowTask& task, const Query& query) {
  ProcessUse before = processUse();
  const Stopwatch whole;
  const Pyramid pyramid(task.path, task.budget_bytes, task.access);
  Extractor extractor(pyramid);
  SurfaceMesh mesh;
  const double load_seconds = whole.seconds();
  const std::uint64_t loaded_rss_bytes = processUse().peak_bytes;
  const auto extract = [&] {
    const Stopwatch watch;
    extractor.extract(query, mesh);
    return watch.seconds();
  };
  const double first_seconds = extract();
  std::vector<double> seconds = {load_seconds + first_seconds};
  if (!task.cold) {
    before = processUse();
    seconds.clear();
    for (int i = 0; i < task.repeats; ++i) seconds.push_back(extract());
  }
  const ProcessUse after = processUse();
  const double processor_seconds =
      (after.processor_seconds - before.processor_seconds) / static_cast<double>(seconds.size());
  const std::size_t bytes = mesh.positions().size_bytes() + mesh.normals().size_bytes() +
                            mesh.triangles().size_bytes() +
                            mesh.parts().size() * sizeof(SurfaceMesh::Part);
  Json row = {{"triangles", mesh.triangles().size() / 3},
              {"vertices", mesh.positions().size()},
              {"output_bytes", bytes},
              {"load_seconds", load_seconds},
              {"prepare_seconds", 0},
              {"first_seconds", first_seconds},
              {"seconds", seconds},
              {"processor_seconds", processor_seconds},
              {"loaded_rss_bytes", loaded_rss_bytes},
              {"peak_rss_bytes", after.peak_bytes},
              {"note", "one session, into the memory of the surface before"}};
  if (!task.mesh_path.empty()) writePlainMesh(plainMeshOf(mesh), task.mesh_path);
  return row;
}

}  // namespace isobrick
