// The main job on real scans: build, extract around a focus, check the mesh.
#include <gtest/gtest.h>

#include <map>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_paths.h"

namespace isobrick::test {
namespace {

struct Scan {
  const char* path;  // below the folder of real volumes
  std::vector<double> isovalues;
};

std::string scanPath(const std::string& name) { return test::sharedData() + "/" + name; }

IndexedMesh extractMesh(const Pyramid& pyramid, const Query& query) {
  IndexedMeshSink sink;
  extractIsosurface(pyramid, query, sink);
  return sink.takeMesh();
}

// Around the middle of the volume, with a sixth of its longest side for a radius.
FocusSphere middleOf(const Index3& voxels) {
  const auto longest = static_cast<double>(std::max({voxels.x, voxels.y, voxels.z}));
  return {0.5 * glm::dvec3(voxels), longest / 6};
}

void PrintTo(const Scan& scan, std::ostream* out) { *out << scan.path; }

class RealVolume : public testing::TestWithParam<Scan> {};

TEST_P(RealVolume, GivesClosedSurfacesWithAndWithoutCurvature) {
  const TemporaryFolder folder;
  const auto source = openVolume(scanPath(GetParam().path));
  buildPyramid(*source, folder.file("scan.isb"), BuildOptions{});
  const Pyramid pyramid(folder.file("scan.isb"));
  const MeshCheckOptions options = volumeOptions(pyramid.spec().geometry, pyramid.spec().voxels);
  bool some_are_coarser = false;
  for (const double isovalue : GetParam().isovalues) {
    Query query;
    query.isovalue = isovalue;
    query.focus = middleOf(pyramid.spec().voxels);
    std::size_t plain_triangles = 0;
    for (const bool with_curvature : {false, true}) {
      if (with_curvature) query.curvature_tolerance = 1 / (2 * 20.0 * 20.0);
      const IndexedMesh mesh = extractMesh(pyramid, query);
      const MeshReport report = checkMesh(mesh.positions, mesh.triangles, options);
      EXPECT_TRUE(report.ok()) << GetParam().path << " at " << isovalue << ": " << report.summary();
      ASSERT_GT(mesh.triangles.size(), 0u);
      if (!with_curvature) plain_triangles = mesh.triangles.size();
    }
    query.curvature_tolerance = 10.0;  // nearly everything is flat enough
    const IndexedMesh coarse = extractMesh(pyramid, query);
    EXPECT_TRUE(checkMesh(coarse.positions, coarse.triangles, options).ok());
    EXPECT_LE(coarse.triangles.size(), plain_triangles);
    some_are_coarser = some_are_coarser || coarse.triangles.size() < plain_triangles;
  }
  EXPECT_TRUE(some_are_coarser);
}

INSTANTIATE_TEST_SUITE_P(Scans, RealVolume,
                         testing::Values(Scan{"vhf_head_ct/vhf_head.nrrd", {500, 1250}},
                                         Scan{"headsq_quarter/headsq_quarter.mhd", {500, 1150}},
                                         Scan{"tooth_u16be/tooth.nhdr", {200, 520, 1000}},
                                         Scan{"mr_nifti/MR.nii.gz", {40 * 2.00784, 130 * 2.00784}}),
                         [](const testing::TestParamInfo<Scan>& scan) {
                           const std::string path = scan.param.path;
                           return path.substr(0, path.find('/'));
                         });

// The DICOM folder is the NRRD in Hounsfield units, 1024 lower.
TEST(RealVolumes, DicomFolderGivesTheMeshOfTheNrrd) {
  const TemporaryFolder folder;
  BuildOptions options;
  options.with_curvature = false;
  std::vector<IndexedMesh> meshes;
  std::vector<GridGeometry> geometries;
  for (const auto& [name, isovalue] : std::map<std::string, double>{
           {"vhf_head_ct/vhf_head.nrrd", 1250}, {"vhf_head_ct/dicom", 226}}) {
    const auto source = openVolume(scanPath(name));
    buildPyramid(*source, folder.file("scan.isb"), options);
    const Pyramid pyramid(folder.file("scan.isb"));
    Query query;
    query.isovalue = isovalue;
    query.focus = FocusSphere{{256, 256, 117}, 60};
    meshes.push_back(extractMesh(pyramid, query));
    geometries.push_back(pyramid.spec().geometry);
  }
  ASSERT_EQ(meshes[0].positions.size(), meshes[1].positions.size());
  ASSERT_TRUE(meshes[0].triangles == meshes[1].triangles);
  for (std::size_t v = 0; v < meshes[0].positions.size(); ++v) {
    const glm::dvec3 a = geometries[0].worldToIndex(meshes[0].positions[v]);
    const glm::dvec3 b = geometries[1].worldToIndex(meshes[1].positions[v]);
    ASSERT_LT(glm::length(a - b), 1e-9);
  }
}

}  // namespace
}  // namespace isobrick::test
