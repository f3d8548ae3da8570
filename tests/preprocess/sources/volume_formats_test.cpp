// The main job on a file of every format, written here from one phantom: build, extract around a
// focus, check the mesh, and find the mesh of the plain NRRD file with the same values.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <type_traits>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/export/source_views.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "tests/support/array_source.h"
#include "tests/support/build_message.h"
#include "tests/support/dicom_file.h"
#include "tests/support/mesh_checker.h"
#include "tests/support/nifti_file.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/tiff_file.h"
#include "tests/support/vdb_file.h"
#include "tests/support/volume_files.h"
#include "tests/support/vti_file.h"

namespace isobrick::test {
namespace {

// Odd dimensions cut from the head phantom, its outermost voxels 0: an OpenVDB grid reads as one
// voxel of background around what is active.
constexpr Index3 kHeadVoxels(45, 40, 37);
constexpr std::int64_t kHeadSize = 48;
constexpr double kBone = 1324;

const std::vector<std::int16_t>& headVoxels() {
  static const std::vector<std::int16_t> voxels = [] {
    PhantomSpec spec;
    spec.name = "head";
    spec.size = kHeadSize;
    spec.voxel_type = VoxelType::kInt16;
    const auto source = makePhantomSource(spec);
    const auto whole = readVoxels<std::int16_t>(*source);
    std::vector<std::int16_t> result;
    for (std::int64_t z = 0; z < kHeadVoxels.z; ++z)
      for (std::int64_t y = 0; y < kHeadVoxels.y; ++y)
        for (std::int64_t x = 0; x < kHeadVoxels.x; ++x) {
          const Index3 at(x, y, z);
          const bool is_border = glm::any(glm::equal(at, Index3(0))) ||
                                 glm::any(glm::equal(at, kHeadVoxels - Index3(1)));
          result.push_back(
              is_border ? std::int16_t{0}
                        : whole[static_cast<std::size_t>(linearIndex(at, Index3(kHeadSize)))]);
        }
    return result;
  }();
  return voxels;
}

template <typename T>
std::vector<T> headAs(double slope = 1, double intercept = 0) {
  std::vector<T> values;
  for (const std::int16_t v : headVoxels()) values.push_back(static_cast<T>(v * slope + intercept));
  return values;
}

// The surface in voxel indices, and what it was made from.
struct Surface {
  std::vector<glm::dvec3> positions;
  std::vector<std::uint32_t> triangles;
  VoxelType voxel_type{};
  GridGeometry geometry;
};

class VolumeFormats : public VolumeFilesTest {
 protected:
  // Builds, extracts twice, checks both meshes; the one without curvature.
  Surface surfaceOf(VolumeSource& source, double isovalue = kBone) const {
    BuildOptions options;
    options.brick_cells = 16;
    buildPyramid(source, pathOf("volume.isb"), options);
    const Pyramid pyramid(pathOf("volume.isb"));
    const GridGeometry& geometry = pyramid.spec().geometry;
    const MeshCheckOptions check = volumeOptions(geometry, pyramid.spec().voxels);
    Surface surface;
    surface.voxel_type = pyramid.spec().voxel_type;
    surface.geometry = geometry;
    for (const bool with_curvature : {false, true}) {
      Query query;
      query.isovalue = isovalue;
      query.focus = FocusSphere{{22, 15, 18}, 6};
      if (with_curvature) query.curvature_tolerance = 1 / (2 * 20.0 * 20.0);
      IndexedMeshSink sink;
      extractIsosurface(pyramid, query, sink);
      const IndexedMesh mesh = sink.takeMesh();
      const MeshReport report = checkMesh(mesh.positions, mesh.triangles, check);
      EXPECT_TRUE(report.ok()) << source.info().format << ": " << report.summary();
      EXPECT_GT(mesh.triangles.size(), 300u);
      if (with_curvature) continue;
      surface.triangles.assign(mesh.triangles.begin(), mesh.triangles.end());
      for (const auto& position : mesh.positions)
        surface.positions.push_back(geometry.worldToIndex(glm::dvec3(position)));
    }
    return surface;
  }

  // The surface of values in a raw NRRD file, which every other file has to give.
  template <typename T>
  Surface expected(const std::vector<T>& values, double isovalue = kBone) const {
    return surfaceOf(*openVolume(write("expected.nrrd", nrrdHeader<T>("raw", "little") + "\n" +
                                                            bytesOfValues(values))),
                     isovalue);
  }

  // The header of an NRRD file, without the empty line that ends it.
  template <typename T>
  static std::string nrrdHeader(const std::string& encoding, const std::string& order) {
    const std::string type = std::is_same_v<T, float>          ? "float"
                             : std::is_same_v<T, std::int16_t> ? "short"
                                                               : "ushort";
    return "NRRD0004\ntype: " + type + "\ndimension: 3\nsizes: 45 40 37\nencoding: " + encoding +
           "\nendian: " + order + "\n";
  }

  static void expectSame(const Surface& surface, const Surface& expected, const std::string& what) {
    EXPECT_EQ(surface.voxel_type, expected.voxel_type) << what;
    ASSERT_EQ(surface.triangles, expected.triangles) << what;
    ASSERT_EQ(surface.positions.size(), expected.positions.size()) << what;
    for (std::size_t v = 0; v < expected.positions.size(); ++v)
      ASSERT_LT(glm::length(surface.positions[v] - expected.positions[v]), 1e-4) << what;
  }
};

TEST_F(VolumeFormats, NrrdAndMetaImageOfEveryKindGiveTheSameSurface) {
  const auto values = headAs<std::int16_t>();
  const Surface surface = expected(values);
  const std::string meta =
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 45 40 37\nElementType = "
      "MET_SHORT\n";
  for (const bool big : {false, true}) {
    const std::string order = big ? "big" : "little", bytes = bytesOfValues(values, big);
    const std::string msb = std::string("BinaryDataByteOrderMSB = ") + (big ? "True\n" : "False\n");
    const std::string packed_meta = meta + msb + "CompressedData = True\n";
    const auto check = [&](const std::string& name, const std::string& content) {
      expectSame(surfaceOf(*openVolume(write(order + name, content))), surface, order + name);
    };
    write(order + ".raw", bytes);
    write(order + ".gz", deflated(bytes, true));
    write(order + ".zraw", deflated(bytes, false));
    const auto header = [&](const char* encoding) {
      return nrrdHeader<std::int16_t>(encoding, order);
    };
    check(".nrrd", header("raw") + "\n" + bytes);
    check("packed.nrrd", header("gzip") + "\n" + deflated(bytes, true));
    check(".nhdr", header("raw") + "data file: " + order + ".raw\n");
    check("packed.nhdr", header("gzip") + "data file: " + order + ".gz\n");
    check(".mha", meta + msb + "ElementDataFile = LOCAL\n" + bytes);
    check(".mhd", meta + msb + "ElementDataFile = " + order + ".raw\n");
    check("packed.mha", packed_meta + "ElementDataFile = LOCAL\n" + deflated(bytes, false));
    check("packed.mhd", packed_meta + "ElementDataFile = " + order + ".zraw\n");
    const auto raw = openRawSource(pathOf(order + ".raw"), {kHeadVoxels, "i16", big});
    expectSame(surfaceOf(*raw), surface, order + " raw");
  }
}

TEST_F(VolumeFormats, NiftiGivesTheSameSurfaceItsSlopeApplied) {
  for (const float slope : {0.0f, 2.00784f}) {
    const double intercept = slope == 0 ? 0 : -3.5;
    NiftiFields fields{4, 16, slope, static_cast<float>(intercept)};
    const double factor = slope == 0 ? 1 : static_cast<double>(slope);
    const double isovalue = kBone * factor + intercept;
    const Surface surface = slope == 0 ? expected(headAs<std::int16_t>(), isovalue)
                                       : expected(headAs<float>(factor, intercept), isovalue);
    const std::string bytes = bytesOfValues(headVoxels());
    const std::string whole = niftiHeader(kHeadVoxels, fields, false) + bytes;
    NiftiFields pair = fields;
    pair.magic = "ni1";
    pair.offset = 0;
    write("pair.img", bytes);
    for (const std::string& path :
         {write("one.nii", whole), write("one.nii.gz", deflated(whole, true)),
          write("pair.hdr", niftiHeader(kHeadVoxels, pair, false).substr(0, 348))})
      expectSame(surfaceOf(*openVolume(path), isovalue), surface, path);
  }
}

TEST_F(VolumeFormats, VtiOfEveryKindGivesTheSameSurface) {
  const Surface surface = expected(headAs<std::int16_t>());
  VtiFrame frame;
  frame.image = R"(WholeExtent="0 44 0 39 0 36" Origin="0 0 0" Spacing="1 1 1")";
  frame.piece = R"(Extent="0 44 0 39 0 36")";
  for (const std::string format : {"raw", "base64", "binary"})
    for (const bool zlib : {false, true}) {
      VtiVariant variant{format, zlib};
      variant.block_bytes = 4096;
      variant.big_endian = zlib;
      const std::string text =
          vtiText(vtiEncoded(bytesOfValues(headVoxels(), variant.big_endian), variant), variant);
      const auto source = openVtiSource(write("head.vti", vtiBytes("Int16", text, variant, frame)));
      expectSame(surfaceOf(*source), surface, format + (zlib ? " zlib" : ""));
    }
}

TEST_F(VolumeFormats, TiffSlicesGiveTheSameSurface) {
  const auto values = headAs<std::uint16_t>();
  const auto slice = static_cast<std::ptrdiff_t>(kHeadVoxels.x * kHeadVoxels.y);
  const Surface surface = expected(values);
  fs::create_directory(pathOf("slices"));
  for (std::int64_t k = 0; k < kHeadVoxels.z; ++k)
    write("slices/s" + std::to_string(k) + ".tif",
          tiffBytes(45, 40, 16,
                    bytesOfValues(std::vector<std::uint16_t>(values.begin() + k * slice,
                                                             values.begin() + (k + 1) * slice))));
  expectSame(surfaceOf(*openVolume(pathOf("slices"))), surface, "TIFF");
}

// In Hounsfield units, 1024 lower.
TEST_F(VolumeFormats, DicomSeriesGivesTheSurfaceOfTheNrrd) {
  const auto values = headAs<std::int16_t>(1, -1024);
  const Surface surface = expected(headAs<std::int16_t>());
  fs::create_directory(pathOf("series"));
  const glm::dvec3 spacing(0.5, 0.75, 2), origin(-10, 20, 1500);
  writeDicomSeries(pathOf("series"), kHeadVoxels, values, spacing, origin);
  const auto source = openVolume(pathOf("series"));
  EXPECT_EQ(source->info().format, "DICOM series");
  EXPECT_EQ(source->info().geometry.spacing, spacing);
  EXPECT_EQ(source->info().geometry.origin, origin);
  EXPECT_EQ(readVoxels<std::int16_t>(*source), values);
  const auto again = openVolume(pathOf("series"));
  Surface found = surfaceOf(*again, kBone - 1024);
  // A focus is a ball of voxels, so that the spacing does not change what is refined.
  expectSame(found, surface, "DICOM");
}

TEST_F(VolumeFormats, VdbFogGivesTheSameSurface) {
  const Index3 inner = kHeadVoxels - Index3(2);
  std::vector<float> active;
  for (std::int64_t z = 1; z <= inner.z; ++z)
    for (std::int64_t y = 1; y <= inner.y; ++y)
      for (std::int64_t x = 1; x <= inner.x; ++x)
        active.push_back(
            headVoxels()[static_cast<std::size_t>(linearIndex({x, y, z}, kHeadVoxels))]);
  writeVdbFog(pathOf("head.vdb"), inner, active, 1, glm::dvec3(1));
  expectSame(surfaceOf(*openVdbSource(pathOf("head.vdb"))), expected(headAs<float>()), "VDB");
}

TEST_F(VolumeFormats, VdbLevelSetIsABallOfItsRadius) {
  constexpr double kRadius = 9, kSpacing = 0.5;
  const glm::dvec3 center(3, -4, 5);
  writeVdbBall(pathOf("ball.vdb"), kRadius, center, kSpacing);
  const auto source = openVdbSource(pathOf("ball.vdb"));
  BuildOptions options;
  buildPyramid(*source, pathOf("ball.isb"), options);
  const Pyramid pyramid(pathOf("ball.isb"));
  EXPECT_EQ(pyramid.spec().geometry.spacing, glm::dvec3(kSpacing));
  IndexedMeshSink sink;
  extractIsosurface(pyramid, Query{}, sink);  // the isovalue is 0
  const IndexedMesh mesh = sink.takeMesh();
  const MeshReport report =
      checkMesh(mesh.positions, mesh.triangles,
                volumeOptions(pyramid.spec().geometry, pyramid.spec().voxels));
  ASSERT_TRUE(report.ok()) << report.summary();
  EXPECT_EQ(report.components, 1);
  EXPECT_EQ(report.genus, 0);
  EXPECT_EQ(report.border_loops, 0);
  for (const auto& position : mesh.positions)
    ASSERT_NEAR(glm::length(glm::dvec3(position) - center), kRadius, 0.02 * kSpacing);
  const double volume = 4.0 / 3 * std::numbers::pi * std::pow(kRadius, 3);
  EXPECT_NEAR(std::abs(report.volume) / volume, 1, 0.005);
}

// A turned scan as DICOM, and what convert makes of it: the same places in the world.
TEST_F(VolumeFormats, AnObliqueScanHasItsSurfaceAtTheSamePlacesInEightFormats) {
  GridGeometry geometry;
  geometry.spacing = {0.5, 0.75, 2};
  geometry.origin = {-101.25, 17.5, 1402.75};
  const glm::dvec3 row = glm::normalize(glm::dvec3(3, 1, -1));
  const glm::dvec3 column = glm::normalize(glm::cross(glm::dvec3(1, -2, 5), row));
  geometry.direction = glm::dmat3(row, column, glm::cross(row, column));
  fs::create_directory(pathOf("series"));
  const auto slice = static_cast<std::ptrdiff_t>(kHeadVoxels.x * kHeadVoxels.y);
  for (std::int64_t k = 0; k < kHeadVoxels.z; ++k) {
    DicomSliceFile file;
    file.columns = kHeadVoxels.x;
    file.rows = kHeadVoxels.y;
    file.pixels.assign(headVoxels().begin() + k * slice, headVoxels().begin() + (k + 1) * slice);
    file.position = geometry.indexToWorld(glm::dvec3(0, 0, static_cast<double>(k)));
    file.row_axis = row;
    file.column_axis = column;
    file.pixel_spacing = {0.5, 0.75};
    file.thickness = 2;
    file.instance = static_cast<int>(k) + 1;
    writeDicomSlice(pathOf("series/" + std::to_string(100 + k) + ".dcm"), file);
  }
  const Surface as_stored = surfaceOf(*openVolume(pathOf("series")));
  EXPECT_LT(glm::length(as_stored.geometry.origin - geometry.origin), 1e-6);
  // The voxels of a VDB are floats, so that coarser levels are not rounded.
  const Surface as_floats = surfaceOf(*makeFloatSource(openVolume(pathOf("series"))));
  for (const char* name : {"a.nrrd", "a.nii.gz", "a.mha", "a.vti", "a.vdb", "a.ome.zarr", "a.h5"}) {
    VolumeLevels levels;
    levels.push_back(openVolume(pathOf("series")));
    ExportOptions options;
    options.memory_bytes = std::uint64_t{64} << 20;
    exportVolume(levels, pathOf(name), options);
    const Surface found = surfaceOf(*openVolume(pathOf(name)));
    const Surface& scan = found.voxel_type == VoxelType::kFloat32 ? as_floats : as_stored;
    ASSERT_EQ(found.triangles, scan.triangles) << name;
    for (std::size_t v = 0; v < scan.positions.size(); ++v)
      ASSERT_LT(glm::length(found.geometry.indexToWorld(found.positions[v]) -
                            scan.geometry.indexToWorld(scan.positions[v])),
                1e-3 * 0.5)
          << name;
  }
}

// One rule for all formats that have times or channels: what is not there has the number 0.
TEST_F(VolumeFormats, TheOnlyTimeAndChannelHaveTheNumberZero) {
  for (const char* name :
       {"a.nrrd", "a.nii", "a.mha", "a.ome.zarr", "a.h5", "a.tif", "slices/%04d.tif"}) {
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<std::int16_t>>(kHeadVoxels, headVoxels()));
    ExportOptions export_options;
    export_options.memory_bytes = std::uint64_t{64} << 20;
    exportVolume(levels, pathOf(name), export_options);
    const std::string path = pathOf(std::string(name).starts_with("slices") ? "slices" : name);
    const std::string encoding = openVolume(path)->info().encoding;
    for (auto member : {&OpenOptions::time, &OpenOptions::channel}) {
      OpenOptions options;
      options.*member = 0;
      const auto source = openVolume(path, options);
      EXPECT_EQ(readVoxels<std::int16_t>(*source), headVoxels()) << name;
      EXPECT_EQ(source->info().encoding, encoding) << name;
      options.*member = 1;
      EXPECT_THROW(openVolume(path, options), Error) << name;
    }
  }
}

// NaN is the same in every format that can hold it: refused, replaced, or a voxel without data.
TEST_F(VolumeFormats, VoxelsWithoutDataAreThoseOfEveryFormat) {
  std::vector<float> voxels = headAs<float>();
  std::uint64_t missing = 0;
  for (std::size_t i = 0; i < voxels.size(); ++i)
    if (i % static_cast<std::size_t>(kHeadVoxels.x) > 30) {
      voxels[i] = std::numeric_limits<float>::quiet_NaN();
      ++missing;
    }
  std::vector<std::uint32_t> expected;
  for (const char* name : {"a.nrrd", "a.nii", "a.nii.gz", "a.mha", "a.vti", "a.ome.zarr", "a.h5",
                           "a.tif", "slices/%04d.exr"}) {
    VolumeLevels levels;
    levels.push_back(std::make_unique<ArraySource<float>>(kHeadVoxels, voxels));
    ExportOptions export_options;
    export_options.memory_bytes = std::uint64_t{64} << 20;
    exportVolume(levels, pathOf(name), export_options);
    const std::string path = pathOf(std::string(name).starts_with("slices") ? "slices" : name);
    BuildOptions options;
    EXPECT_CONTAINS(messageOfBuild(*openVolume(path), pathOf("a.isb"), options), "not a number");
    options.mask_nan = true;
    const BuildReport report = buildPyramid(*openVolume(path), pathOf("a.isb"), options);
    EXPECT_EQ(report.missing_voxels, missing) << name;
    Query query;
    query.isovalue = kBone;
    IndexedMeshSink sink;
    extractIsosurface(Pyramid(pathOf("a.isb")), query, sink);
    const auto& triangles = sink.mesh().triangles;
    if (expected.empty()) expected.assign(triangles.begin(), triangles.end());
    EXPECT_TRUE(std::equal(triangles.begin(), triangles.end(), expected.begin(), expected.end()))
        << name;
    options.mask_nan = false;
    options.nan_as = 0;
    EXPECT_EQ(buildPyramid(*openVolume(path), pathOf("a.isb"), options).replaced_voxels, missing);
  }
  EXPECT_GT(expected.size(), 300u);
}

// ---- what the files say besides their voxels, and what the readers hold of them -----------------

TEST_F(VolumeFormats, HeadersGiveTheirGeometry) {
  const glm::dvec3 spacing(3.25, 3.25, 1.5), origin(1, -2, 30);
  const std::string bytes = bytesOfValues(headVoxels());
  const auto expectGeometry = [&](const VolumeSource& source) {
    EXPECT_EQ(source.info().voxels, kHeadVoxels);
    EXPECT_EQ(source.info().geometry.spacing, spacing) << source.info().format;
    EXPECT_EQ(source.info().geometry.origin, origin) << source.info().format;
  };
  expectGeometry(*openVolume(
      write("head.mha",
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nElementSpacing = 3.25 3.25 1.5\n"
            "Offset = 1 -2 30\nDimSize = 45 40 37\nElementType = MET_SHORT\n"
            "ElementDataFile = LOCAL\n" +
                bytes)));
  expectGeometry(*openVolume(
      write("head.nrrd", nrrdHeader<std::int16_t>("raw", "little") +
                             "space: left-posterior-superior\nspace directions: (3.25,0,0) "
                             "(0,3.25,0) (0,0,1.5)\nspace origin: (1,-2,30)\n\n" +
                             bytes)));
  VtiFrame frame;
  frame.image = R"(WholeExtent="0 44 0 39 0 36" Origin="1 -2 30" Spacing="3.25 3.25 1.5")";
  frame.piece = R"(Extent="0 44 0 39 0 36")";
  const VtiVariant variant;
  expectGeometry(*openVtiSource(
      write("head.vti",
            vtiBytes("Int16", vtiText(vtiEncoded(bytes, variant), variant), variant, frame))));
  NiftiFields fields;
  fields.spacing = spacing;
  const auto nifti = openVolume(write("head.nii", niftiHeader(kHeadVoxels, fields, false) + bytes));
  EXPECT_EQ(nifti->info().geometry.spacing, spacing);
}

TEST_F(VolumeFormats, PackedNrrdIsStreamedAndEqualsTheDicomSeriesInOddPieces) {
  writeDicomSeries(pathOf("."), kHeadVoxels, headAs<std::int16_t>(1, -1024));
  const auto dicom = openVolume(folder_.string());
  const TemporaryFolder elsewhere;
  std::ofstream(elsewhere.file("head.nrrd"), std::ios::binary)
      << nrrdHeader<std::int16_t>("gzip", "little") << "\n"
      << deflated(bytesOfValues(headVoxels()), true);
  const auto nrrd = openVolume(elsewhere.file("head.nrrd"));
  EXPECT_LE(nrrd->bufferBytes(), 400u << 10);
  const std::int64_t rows = kHeadVoxels.y * kHeadVoxels.z, x = kHeadVoxels.x;
  std::vector<std::int16_t> a(static_cast<std::size_t>(77 * x)), b(a.size());
  for (std::int64_t row = 0; row < rows; row += 150) {
    const std::int64_t count = std::min<std::int64_t>(77, rows - row);
    nrrd->readRows(row, count, a.data());
    dicom->readRows(row, count, b.data());
    for (std::size_t i = 0; i < static_cast<std::size_t>(count * x); ++i)
      ASSERT_EQ(a[i], b[i] + 1024) << row;
  }
}

TEST_F(VolumeFormats, PackedNiftiThatIsCutOrDamagedIsAnError) {
  const NiftiFields fields{4, 16, 2.00784f, 0};
  const std::string whole = niftiHeader(kHeadVoxels, fields, false) + bytesOfValues(headVoxels());
  const std::string packed = deflated(whole, true);
  const auto plain = openVolume(write("head.nii", whole));
  const auto source = openVolume(write("head.nii.gz", packed));
  EXPECT_EQ(source->info().notes, plain->info().notes);
  EXPECT_FALSE(source->info().notes.empty());
  EXPECT_EQ(source->info().geometry.origin, plain->info().geometry.origin);
  EXPECT_EQ(readVoxels<float>(*source, 7), readVoxels<float>(*plain, 3));
  // ITK would fill the rest with zeros.
  EXPECT_CONTAINS(
      errorOf([&] { openAndRead(write("cut.nii.gz", packed.substr(0, packed.size() / 2))); }),
      "cut short");
  std::string flipped = packed;
  flipped[packed.size() / 2] = static_cast<char>(flipped[packed.size() / 2] ^ 0x10);
  EXPECT_CONTAINS(errorOf([&] { openAndRead(write("flipped.nii.gz", flipped)); }), "damaged");
}

}  // namespace
}  // namespace isobrick::test
