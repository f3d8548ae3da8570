// Units of length, from what files say to what files say: millimetres inside wherever they are
// known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/mat4x4.hpp>
#include <nlohmann/json.hpp>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/storage/length_scale.h"
#include "isobrick/storage/pyramid.h"
#include "tests/support/array_source.h"
#include "tests/support/nifti_file.h"
#include "tests/support/plain_reader.h"
#include "tests/support/repetitions.h"
#include "tests/support/sealed_pyramid.h"
#include "tests/support/volume_files.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h
using namespace std::string_literals;

constexpr Index3 kUnitVoxels(9, 6, 7);

// In millimetres: of a microscope.
GridGeometry smallObliqueGeometry(LengthUnit unit) {
  GridGeometry geometry;
  geometry.direction =
      glm::dmat3(glm::rotate(glm::dmat4(1.0), 0.7, glm::normalize(glm::dvec3(1, -2, 3))));
  geometry.spacing = {0.00065, 0.0013, 0.002};
  geometry.origin = {-0.1013, 0.01777, 1.0 / 7};
  geometry.unit = unit;
  return geometry;
}

// The same in ångströms.
GridGeometry tinyGeometry() {
  GridGeometry geometry = smallObliqueGeometry(LengthUnit::kMillimetre);
  geometry.spacing *= 4e-4;
  geometry.origin *= 4e-4;
  return geometry;
}

bool areSame(const GridGeometry& a, const GridGeometry& b, const char* part) {
  constexpr double kRelative = 1e-6;  // single precision
  const std::string name = part;
  if (name == "unit") return a.unit == b.unit;
  for (int axis = 0; axis < 3; ++axis) {
    const glm::dvec3 turned = a.direction[axis] - b.direction[axis];
    if (name == "spacing" &&
        std::abs(a.spacing[axis] - b.spacing[axis]) > kRelative * b.spacing[axis])
      return false;
    if (name == "origin" &&
        std::abs(a.origin[axis] - b.origin[axis]) > kRelative * glm::length(b.origin))
      return false;
    if (name == "direction" && glm::dot(turned, turned) > kRelative * kRelative) return false;
  }
  return true;
}

// A volume that is written to `name` is read at `opened`.
struct UnitFormat {
  const char* name;
  const char* opened;
};
constexpr UnitFormat kUnitFormats[] = {
    {"a.nrrd", "a.nrrd"},    {"a.mhd", "a.mhd"},       {"a.mha", "a.mha"},
    {"a.nii", "a.nii"},      {"a.nii.gz", "a.nii.gz"}, {"a.vti", "a.vti"},
    {"a.vdb", "a.vdb"},      {"a.h5", "a.h5"},         {"a.ome.zarr", "a.ome.zarr"},
    {"exr/%03d.exr", "exr"}, {"tif/%03d.tif", "tif"},  {"pages.tif", "pages.tif"},
    {"a.raw", "a.raw"},
};

class LengthUnitTest : public VolumeFilesTest {
 protected:
  // A volume through a format into a pyramid of this name; what the format lost.
  std::vector<std::string> pass(std::unique_ptr<VolumeSource> source, const UnitFormat& format,
                                const std::string& pyramid) {
    VolumeLevels levels;
    levels.push_back(std::move(source));
    ExportOptions options;
    options.memory_bytes = std::uint64_t{64} << 20;
    OpenOptions open;
    if (std::string(format.name).ends_with(".raw"))
      open.raw = RawLayout{levels.front()->info().voxels,
                           std::string(voxelTypeName(levels.front()->info().voxel_type))};
    const VolumeWriteReport report = exportVolume(levels, pathOf(format.name), options);
    const auto back = openVolume(pathOf(format.opened), open);
    buildPyramid(*back, pathOf(pyramid), {});
    return report.lost;
  }

  void expectKeptOrSaid(const GridGeometry& found, const GridGeometry& before,
                        const std::vector<std::string>& lost, const char* format) {
    for (const char* part : {"spacing", "origin", "direction", "unit"}) {
      const bool is_said = std::any_of(lost.begin(), lost.end(), [&](const std::string& line) {
        // Of single precision the test knows.
        return line.find(part) != std::string::npos && line.find("rounded") == std::string::npos;
      });
      EXPECT_TRUE(areSame(found, before, part) || is_said) << format << " changes the " << part;
      // A number of an unknown unit never becomes millimetres.
      EXPECT_FALSE(found.unit == LengthUnit::kMillimetre && before.unit == LengthUnit::kUnknown)
          << format;
    }
  }

  static std::unique_ptr<ArraySource<std::uint8_t>> smallVolume(const GridGeometry& geometry) {
    const auto values = arrayOfField<std::uint8_t>(
        kUnitVoxels, [](const Index3& at) { return 20 * at.x + 3 * at.y + at.z; });
    return std::make_unique<ArraySource<std::uint8_t>>(kUnitVoxels, values, geometry);
  }
  GridGeometry geometryOf(const std::string& name) const {
    return openVolume(pathOf(name))->info().geometry;
  }
  std::string notesOf(const std::string& name) const {
    const auto source = openVolume(pathOf(name));
    std::string all;
    for (const std::string& note : source->info().notes) all += note + "\n";
    return all;
  }
  void replace(const std::string& name, const std::string& from, const std::string& to) const {
    std::string bytes = readBytes(pathOf(name));
    const std::size_t at = bytes.find(from);
    ASSERT_NE(at, std::string::npos) << name;
    writeBytes(pathOf(name), bytes.replace(at, from.size(), to));
  }
  void writeSample(const std::string& name, LengthUnit unit) {
    VolumeLevels levels;
    GridGeometry geometry;
    geometry.spacing = {0.65, 1.3, 2};
    geometry.origin = {-1000, 17.5, 400};
    geometry.unit = unit;
    levels.push_back(smallVolume(geometry));
    exportVolume(levels, pathOf(name), {});
  }
  // 0.65, 1.3 and 2 micrometres.
  void expectMicrometres(const std::string& name, bool has_origin = true) {
    const GridGeometry found = geometryOf(name);
    GridGeometry expected;
    expected.spacing = {0.00065, 0.0013, 0.002};
    expected.origin = has_origin ? glm::dvec3(-1, 0.0175, 0.4) : glm::dvec3(0);
    expected.unit = LengthUnit::kMillimetre;
    for (const char* part : {"spacing", "origin", "direction", "unit"})
      EXPECT_TRUE(areSame(found, expected, part))
          << name << ", " << part << ": " << found.spacing.x << " " << found.spacing.y << " "
          << found.spacing.z << " at " << found.origin.x << " " << found.origin.y << " "
          << found.origin.z;
    EXPECT_CONTAINS(notesOf(name), "to millimetres");
  }
};

TEST_F(LengthUnitTest, EveryPairOfFormatsKeepsLengthsAndTheirUnitOrSaysWhatIsLost) {
  const GridGeometry geometries[] = {smallObliqueGeometry(LengthUnit::kUnknown),
                                     smallObliqueGeometry(LengthUnit::kMillimetre), tinyGeometry()};
  for (const GridGeometry& geometry : someOf(geometries))
    for (const UnitFormat& first : kUnitFormats) {
      SCOPED_TRACE(first.name + std::string(", ") + std::string(lengthUnitName(geometry.unit)) +
                   ", " + std::to_string(1e9 * geometry.spacing.x));
      const auto lost = pass(smallVolume(geometry), first, "first.isb");
      const auto pyramid = std::make_shared<const Pyramid>(pathOf("first.isb"));
      const GridGeometry between = pyramid->spec().geometry;
      expectKeptOrSaid(between, geometry, lost, first.name);
      for (const UnitFormat& second : kUnitFormats) {
        // Nothing says in which unit it would be larger.
        if (std::string(second.name) == "a.vdb" && between.unit == LengthUnit::kUnknown &&
            between.spacing.x < 1e-6) {
          EXPECT_CONTAINS(errorOf([&] {
                            pass(makePyramidSource(pyramid, 1 << 20, 0, nullptr), second, "x.isb");
                          }),
                          "too small for OpenVDB");
          continue;
        }
        const auto lost_again =
            pass(makePyramidSource(pyramid, 1 << 20, 0, nullptr), second, "second.isb");
        expectKeptOrSaid(Pyramid(pathOf("second.isb")).spec().geometry, between, lost_again,
                         second.name);
      }
    }
}

TEST_F(LengthUnitTest, AllWritersButVtiAndRawKeepTheUnit) {
  for (const UnitFormat& format : kUnitFormats) {
    const std::string name = format.name;
    const bool has_unit = !name.ends_with(".vti") && !name.ends_with(".raw");
    for (const LengthUnit unit : {LengthUnit::kUnknown, LengthUnit::kMillimetre}) {
      const auto lost = pass(smallVolume(smallObliqueGeometry(unit)), format, "a.isb");
      const bool is_kept = has_unit || unit == LengthUnit::kUnknown;
      EXPECT_EQ(Pyramid(pathOf("a.isb")).spec().geometry.unit == unit, is_kept) << name;
      EXPECT_EQ(readPlainPyramid(pathOf("a.isb")).length_unit == 1,
                has_unit && unit == LengthUnit::kMillimetre);
    }
  }
}

TEST_F(LengthUnitTest, APyramidOfAnotherUnitIsRefused) {
  const GridGeometry geometry = smallObliqueGeometry(LengthUnit::kMillimetre);
  buildPyramid(*smallVolume(geometry), pathOf("good.isb"), {});
  PyramidDraft draft(readWholeFile(pathOf("good.isb")));
  EXPECT_EQ(draft.header.length_unit, 1u);
  for (const std::uint32_t unit : {2u, 0xffffffffu}) {
    draft.header.length_unit = unit;
    const Bytes lying = draft.seal();
    writeBytes(pathOf("bad.isb"), std::string(lying.begin(), lying.end()));
    EXPECT_CONTAINS(errorOf([&] { Pyramid(pathOf("bad.isb")); }), "impossible numbers");
    EXPECT_THROW(readPlainPyramid(pathOf("bad.isb")), std::runtime_error);
  }
}

TEST_F(LengthUnitTest, NiftiScalesTheOriginToo) {
  struct Unit {
    char code;
    double millimetres;  // 0: unknown
  };
  for (const Unit unit : {Unit{1, 1e3}, {2, 1}, {3, 1e-3}, {0, 0}, {8 + 3, 1e-3}}) {
    NiftiFields fields;
    fields.spacing = {0.5f, 0.25f, 2.0f};
    std::string header = test::niftiHeader(kUnitVoxels, fields, false);
    header[123] = unit.code;
    const std::int16_t scanner = 1;
    std::memcpy(header.data() + 252, &scanner, sizeof scanner);  // a qform without rotation
    header[254] = 0;                                             // and no sform
    const float origin[] = {-1000, 2000, 3000.5f};               // RAS
    std::memcpy(header.data() + 268, origin, sizeof origin);
    write("a.nii",
          header + std::string(static_cast<std::size_t>(2 * elementCount(kUnitVoxels)), '\0'));
    const GridGeometry found = geometryOf("a.nii");
    const double scale = unit.millimetres == 0 ? 1 : unit.millimetres;
    EXPECT_EQ(found.unit == LengthUnit::kMillimetre, unit.millimetres != 0);
    const glm::dvec3 at = found.indexToWorld({0, 0, 0}) / scale;
    EXPECT_NEAR(at.x, 1000, 1e-9) << int{unit.code};
    EXPECT_NEAR(at.y, -2000, 1e-9) << int{unit.code};
    EXPECT_NEAR(at.z, 3000.5, 1e-9) << int{unit.code};
    EXPECT_NEAR(found.spacing.x / scale, 0.5, 1e-12);
    EXPECT_NEAR(found.spacing.y / scale, 0.25, 1e-12);
    EXPECT_NEAR(found.spacing.z / scale, 2, 1e-12);
    EXPECT_EQ(notesOf("a.nii").find("to millimetres") != std::string::npos, scale != 1);
  }
}

TEST_F(LengthUnitTest, OmeZarrScalesEveryAxisByItsOwnUnit) {
  writeSample("a.ome.zarr", LengthUnit::kMillimetre);
  const auto setUnits = [&](const std::array<const char*, 3>& zyx) {
    const std::string path = pathOf("a.ome.zarr/zarr.json");
    auto json = nlohmann::json::parse(readBytes(path));
    for (std::size_t i = 0; i < 3; ++i) {
      auto& axis = json["attributes"]["ome"]["multiscales"][0]["axes"][i];
      axis.erase("unit");
      if (*zyx[i] != '\0') axis["unit"] = zyx[i];
    }
    writeBytes(path, json.dump());
  };
  setUnits({"micrometer", "micrometer", "micrometer"});
  expectMicrometres("a.ome.zarr");

  setUnits({"micrometer", "nanometer", "millimeter"});
  const GridGeometry mixed = geometryOf("a.ome.zarr");
  EXPECT_EQ(mixed.spacing, glm::dvec3(0.65, 1.3e-6, 0.002));
  EXPECT_EQ(mixed.origin, glm::dvec3(-1000, 17.5e-6, 0.4));
  EXPECT_EQ(mixed.unit, LengthUnit::kMillimetre);
  EXPECT_CONTAINS(notesOf("a.ome.zarr"), "'millimeter', 'nanometer', 'micrometer'");

  for (const auto& [units, said] : {std::pair<std::array<const char*, 3>, const char*>{
                                        {"micrometer", "", "micrometer"}, "of y nothing"},
                                    {{"micrometer", "micrometer", "pixel"}, "'pixel'"},
                                    {{"", "", ""}, ""}}) {
    setUnits(units);
    const GridGeometry found = geometryOf("a.ome.zarr");
    EXPECT_EQ(found.unit, LengthUnit::kUnknown);
    EXPECT_EQ(found.spacing, glm::dvec3(0.65, 1.3, 2)) << "as in the file";
    EXPECT_CONTAINS(notesOf("a.ome.zarr"), said);
  }
}

TEST_F(LengthUnitTest, MetaImageAndNrrdSayTheirUnits) {
  writeSample("a.mha", LengthUnit::kMillimetre);
  replace("a.mha", "DistanceUnits = mm", "DistanceUnits = um");
  expectMicrometres("a.mha");
  replace("a.mha", "DistanceUnits = um\n", "");
  EXPECT_EQ(geometryOf("a.mha").unit, LengthUnit::kMillimetre) << "by convention";
  EXPECT_EQ(geometryOf("a.mha").spacing, glm::dvec3(0.65, 1.3, 2));

  writeSample("a.nrrd", LengthUnit::kMillimetre);
  replace("a.nrrd", R"("mm" "mm" "mm")", "\"\xC2\xB5m\" \"um\" \"microns\"");
  expectMicrometres("a.nrrd");
  replace("a.nrrd", "space units: \"\xC2\xB5m\" \"um\" \"microns\"\n", "");
  EXPECT_EQ(geometryOf("a.nrrd").unit, LengthUnit::kMillimetre) << "patients' space";
  replace("a.nrrd", "space: left-posterior-superior\n", "space dimension: 3\n");
  EXPECT_EQ(geometryOf("a.nrrd").unit, LengthUnit::kUnknown);
}

// A grey TIFF with a description and a resolution, in pixels a unit as a quotient.
std::string tiffWithLengths(const std::string& description, std::uint32_t pixels,
                            std::uint32_t units, std::uint32_t resolution_unit) {
  std::string bytes = "II*";
  const auto put = [&](std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes += static_cast<char>(value >> (8 * i) & 255);
  };
  bytes += '\0';
  put(8, 4);
  const std::string text = description + '\0';
  constexpr std::uint32_t kEntries = 13, kWidth = 5, kHeight = 4;
  const std::uint32_t behind = 8 + 2 + kEntries * 12 + 4;
  const std::uint32_t text_at = behind + 8;
  const std::uint32_t pixels_at = text_at + static_cast<std::uint32_t>(text.size());
  put(kEntries, 2);
  const auto entry = [&](std::uint32_t tag, std::uint32_t type, std::uint32_t count,
                         std::uint32_t value) {
    put(tag, 2);
    put(type, 2);
    put(count, 4);
    put(value, 4);
  };
  constexpr std::uint32_t kText = 2, kShort = 3, kLong = 4, kRational = 5;
  entry(256, kLong, 1, kWidth);
  entry(257, kLong, 1, kHeight);
  entry(258, kShort, 1, 8);
  entry(259, kShort, 1, 1);
  entry(262, kShort, 1, 1);
  entry(270, kText, static_cast<std::uint32_t>(text.size()), text_at);
  entry(273, kLong, 1, pixels_at);
  entry(277, kShort, 1, 1);
  entry(278, kLong, 1, kHeight);
  entry(279, kLong, 1, kWidth * kHeight);
  entry(282, kRational, 1, behind);
  entry(283, kRational, 1, behind);
  entry(296, kShort, 1, resolution_unit);
  put(0, 4);
  put(pixels, 4);
  put(units, 4);
  return bytes + text + std::string(kWidth * kHeight, '\7');
}

TEST_F(LengthUnitTest, TiffsSayTheirUnitsInFourWays) {
  fs::create_directory(pathOf("tif"));
  const auto lengthsOf = [&](const std::string& description, std::uint32_t pixels,
                             std::uint32_t units, std::uint32_t resolution_unit) {
    for (const char* name : {"tif/0.tif", "tif/1.tif"})
      write(name, tiffWithLengths(description, pixels, units, resolution_unit));
    return geometryOf("tif");
  };
  const auto expectLengths = [](const GridGeometry& found, const glm::dvec3& spacing,
                                LengthUnit unit) {
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(found.spacing[axis], spacing[axis], 1e-12 * spacing[axis]);
    EXPECT_EQ(found.unit, unit);
  };
  constexpr LengthUnit kMm = LengthUnit::kMillimetre, kNone = LengthUnit::kUnknown;
  expectLengths(lengthsOf("", 300, 1, 2), glm::dvec3(25.4 / 300), kMm);
  expectLengths(lengthsOf("", 200, 3, 3), glm::dvec3(0.15), kMm);
  expectLengths(lengthsOf("", 4, 1, 1), glm::dvec3(0.25), kNone);
  EXPECT_CONTAINS(notesOf("tif"), "slices have no distance");
  expectLengths(
      lengthsOf("ImageJ=1.53t\nimages=2\nslices=2\nunit=\\u00B5m\nspacing=0.65\n", 4, 1, 1),
      {0.00025, 0.00025, 0.00065}, kMm);
  EXPECT_CONTAINS(notesOf("tif"), "to millimetres");
  EXPECT_EQ(notesOf("tif").find("distance"), std::string::npos);
  expectLengths(lengthsOf("ImageJ=1.53t\nunit=pixel\nspacing=3\n", 1, 1, 1), {1, 1, 3}, kNone);
  expectLengths(
      lengthsOf(
          "<?xml version=\"1.0\"?><OME><Image><Pixels PhysicalSizeX=\"0.65\" "
          "PhysicalSizeY=\"1300\" PhysicalSizeYUnit=\"nm\" PhysicalSizeZ=\"2\"/></Image></OME>",
          72, 1, 2),
      {0.00065, 0.0013, 0.002}, kMm);
}

TEST_F(LengthUnitTest, AGivenUnitReplacesTheInputsOwn) {
  for (const char* name : {"unknown.mha", "mm.mha", "um.mha"})
    writeSample(name,
                name[0] == 'u' && name[1] == 'n' ? LengthUnit::kUnknown : LengthUnit::kMillimetre);
  replace("um.mha", "DistanceUnits = mm", "DistanceUnits = um");
  const auto infoOf = [&](const std::string& name, const auto& change) {
    OpenOptions options;
    change(options);
    return openVolume(pathOf(name), options)->info();
  };
  const auto expectPlace = [](const VolumeInfo& info, const glm::dvec3& spacing,
                              const glm::dvec3& origin) {
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(info.geometry.spacing[axis], spacing[axis], 1e-12 * spacing[axis]);
      EXPECT_NEAR(info.geometry.origin[axis], origin[axis], 1e-12 * std::abs(origin[axis]));
    }
    EXPECT_EQ(info.geometry.unit, LengthUnit::kMillimetre);
  };
  const glm::dvec3 spacing(0.65, 1.3, 2), origin(-1000, 17.5, 400);
  for (const char* name : {"unknown.mha", "mm.mha", "um.mha"}) {
    SCOPED_TRACE(name);
    for (const auto& [unit, scale] : {std::pair("um", 1e-3), {"nm", 1e-6}, {"inch", 25.4}}) {
      const VolumeInfo info =
          infoOf(name, [&, unit = unit](OpenOptions& options) { options.unit = unit; });
      expectPlace(info, scale * spacing, scale * origin);
      EXPECT_CONTAINS(info.encoding, unit);
      const bool is_same = name == "um.mha"s && unit == "um"s;
      EXPECT_EQ(info.notes.back().find("the unit "s + unit + " was given") != std::string::npos,
                !is_same);
    }
    // A spacing with a unit of its own leaves the origin as the input says it, if it says its unit.
    const auto inNanometres = [](OpenOptions& options) {
      options.spacing = {650, 1300, 2000};
      options.spacing_unit = "nm";
    };
    expectPlace(infoOf(name, inNanometres), 1e-3 * spacing,
                (name == "unknown.mha"s ? 1e-6
                 : name == "um.mha"s    ? 1e-3
                                        : 1.0) *
                    origin);
    EXPECT_CONTAINS(
        errorOf([&] { infoOf(name, [](OpenOptions& options) { options.unit = "parsec"; }); }),
        "no unit of length");
  }
  // In units of its own, and without one in the world's.
  const auto given = [](OpenOptions& options) {
    options.spacing = {1, 1, 1};
    options.origin = {1, 2, 3};
    options.origin_unit = "cm";
    options.unit = "um";
  };
  expectPlace(infoOf("mm.mha", given), glm::dvec3(0.001), {10, 20, 30});
  writeSample("a.vti", LengthUnit::kUnknown);
  expectPlace(infoOf("a.vti", [](OpenOptions& options) { options.unit = "um"; }), 1e-3 * spacing,
              1e-3 * origin);
  writeSample("a.ome.zarr", LengthUnit::kMillimetre);
  replace("a.ome.zarr/zarr.json", "\"millimeter\"", "\"micrometer\"");
  EXPECT_CONTAINS(
      errorOf([&] { infoOf("a.ome.zarr", [](OpenOptions& options) { options.unit = "um"; }); }),
      "several units");
}

TEST_F(LengthUnitTest, TheNamesOfLengthsAreKnownHoweverTheyAreSpelt) {
  const auto scaleOf = [](const std::string& unit) {
    const auto scale = lengthScale(unit);
    return scale ? scale->of(1) : 0.0;
  };
  for (const char* name : {"micrometer", "micrometre", "Micrometers", "micrometres", "micron",
                           "microns", "um", "\xC2\xB5m", "\xCE\xBCm", "\xB5m", "\\u00B5m", " um "})
    EXPECT_EQ(scaleOf(name), 1e-3) << name;
  for (const char* name :
       {"angstrom", "Angstroms", "\xC3\x85", "\xE2\x84\xAB", "\\u00C5", "\xC3\x85ngstr\xC3\xB6m"})
    EXPECT_EQ(scaleOf(name), 1e-7) << name;
  EXPECT_EQ(scaleOf("mm"), 1);
  EXPECT_EQ(scaleOf("mm\0"s), 1);
  EXPECT_EQ(scaleOf("Millimeters"), 1);
  EXPECT_EQ(scaleOf("m"), 1e3);
  EXPECT_EQ(scaleOf("metres"), 1e3);
  EXPECT_EQ(scaleOf("cm"), 10);
  EXPECT_EQ(scaleOf("nm"), 1e-6);
  EXPECT_EQ(scaleOf("nanometer"), 1e-6);
  for (const char* name : {"in", "inch", "Inches"}) EXPECT_EQ(scaleOf(name), 25.4) << name;
  for (const char* name : {"ft", "foot", "feet"}) EXPECT_EQ(scaleOf(name), 304.8) << name;
  for (const char* name : {"", " ", "pixel", "s", "second", "Mm", "mmm", "meterx", "code 7", "?"})
    EXPECT_EQ(scaleOf(name), 0) << name;
}

TEST_F(LengthUnitTest, MeshesSayTheUnitOfTheirVolume) {
  for (const LengthUnit unit : {LengthUnit::kUnknown, LengthUnit::kMillimetre}) {
    buildPyramid(*smallVolume(smallObliqueGeometry(unit)), pathOf("a.isb"), {});
    const Pyramid pyramid(pathOf("a.isb"));
    Query query;
    query.isovalue = 100;
    for (const char* name : {"a.ply", "a.stl", "a.obj", "a.glb", "packed.glb", "a.vtp"}) {
      MeshFileOptions options;
      options.meshopt = std::string(name) == "packed.glb";
      const auto sink = makeMeshFileSink(pathOf(name), options);
      extractIsosurface(pyramid, query, *sink);
      const std::string head = readBytes(pathOf(name)).substr(0, 4000);
      const bool is_metric = unit == LengthUnit::kMillimetre;
      EXPECT_EQ(head.find("millimetres") != std::string::npos, is_metric) << name;
      EXPECT_EQ(head.find("unknown") != std::string::npos, !is_metric) << name;
      EXPECT_CONTAINS(head, "LPS");
    }
  }
}

}  // namespace
}  // namespace isobrick
