// VTK ImageData files, all variants written by hand, and files that must be refused.
#include <gtest/gtest.h>
#include <lz4.h>
#include <lzma.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <limits>

#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/volume_source.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/volume_files.h"
#include "tests/support/vti_file.h"

namespace isobrick {
namespace {

using namespace test;  // NOLINT: the helpers of volume_files.h

constexpr Index3 kVtiVoxels(7, 5, 6);

class VtiSourceTest : public VolumeFilesTest {};

template <typename T>
std::vector<T> sampleVoxels() {
  std::vector<T> values(static_cast<std::size_t>(elementCount(kVtiVoxels)));
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<T>(i * i % 251);
  values[0] = std::numeric_limits<T>::max();
  values[1] = std::numeric_limits<T>::lowest();
  return values;
}

template <typename T>
void checkVariants(const std::string& path, const std::string& type) {
  const auto values = sampleVoxels<T>();
  for (const std::string format : {"raw", "base64", "binary"})
    for (const bool zlib : {false, true})
      for (const bool wide : {false, true})
        for (const bool big : {false, true})
          for (const std::size_t block : {64u, 105u, 4096u}) {  // 105: the last block is whole
            VtiVariant v{format, zlib, wide, big, block, block == 64};
            std::ofstream(path, std::ios::binary)
                << vtiBytes(type, vtiText(vtiEncoded(bytesOfValues(values, big), v), v), v);
            for (const std::int64_t slab : {1, 4}) {
              const auto source = openVtiSource(path);
              const VolumeInfo& info = source->info();
              EXPECT_EQ(info.voxels, kVtiVoxels);
              EXPECT_EQ(info.geometry.origin, glm::dvec3(1, 2, 3));
              EXPECT_EQ(info.geometry.spacing, glm::dvec3(0.5, 0.25, 2));
              EXPECT_EQ(source->readsBoxes(), format == "raw" && !zlib);
              EXPECT_EQ(source->files(), std::vector<std::string>{path});
              visitNumberType(info.voxel_type, [&](auto tag) {
                using Out = typename decltype(tag)::Type;
                EXPECT_TRUE((std::is_same_v<Out, T>));
                EXPECT_EQ(info.notes.size(), 1u);
                const auto read = readVoxels<Out>(*source, slab);
                for (std::size_t i = 0; i < values.size(); ++i)
                  ASSERT_EQ(read[i], static_cast<Out>(values[i])) << format << zlib << wide << big;
              });
            }
          }
}

TEST_F(VtiSourceTest, ReadsAllVariantsOfAllTypes) {
  const std::string path = pathOf("volume.vti");
  checkVariants<std::uint8_t>(path, "UInt8");
  checkVariants<std::int8_t>(path, "Int8");
  checkVariants<std::uint16_t>(path, "UInt16");
  checkVariants<std::int16_t>(path, "Int16");
  checkVariants<float>(path, "Float32");
  checkVariants<std::uint32_t>(path, "UInt32");
  checkVariants<std::int32_t>(path, "Int32");
  checkVariants<std::int64_t>(path, "Int64");
  checkVariants<double>(path, "Float64");
}

// A whole file of UInt8 with a changed frame, in the variant.
std::string fileWith(const VtiFrame& frame, const VtiVariant& v = {},
                     const std::string& attributes = "") {
  const std::string bytes = bytesOfValues(sampleVoxels<std::uint8_t>());
  return vtiBytes("UInt8", vtiText(vtiEncoded(bytes, v), v), v, frame, attributes);
}

TEST_F(VtiSourceTest, AppliesExtentsAndDirection) {
  VtiFrame frame;
  // Columns are axes: x goes to world y, y to world -x.
  frame.image =
      "WholeExtent='10 16 -2 2 0 5' Origin='1 2 3' Spacing='0.5 0.25 2' "
      "Direction='0 -1 0 1 0 0 0 0 1'";
  frame.piece = "Extent='10 16 -2 2 0 5'";
  const auto source = openVtiSource(write("turned.vti", fileWith(frame)));
  EXPECT_EQ(source->info().voxels, kVtiVoxels);
  const GridGeometry& geometry = source->info().geometry;
  EXPECT_EQ(geometry.direction[0], glm::dvec3(0, 1, 0));
  EXPECT_EQ(geometry.direction[1], glm::dvec3(-1, 0, 0));
  EXPECT_EQ(geometry.origin, glm::dvec3(1 + 0.5, 2 + 5, 3));
}

TEST_F(VtiSourceTest, TakesTheScalarsOrTheFirstArrayWithOneComponent) {
  VtiFrame frame;
  for (const std::string point_data : {"", "Scalars='none of these'", "Scalars='values'"}) {
    frame.point_data = point_data;
    const auto source = openVtiSource(write("arrays.vti", fileWith(frame)));
    ASSERT_EQ(source->info().notes.size(), 1u);
    EXPECT_CONTAINS(source->info().notes[0], "of 2 arrays, 'values' was taken");
  }
  frame.point_data = "Scalars='other &lt;'";
  EXPECT_CONTAINS(errorOf([&] { openVtiSource(write("arrays.vti", fileWith(frame))); }),
                  "3 values per voxel");
}

TEST_F(VtiSourceTest, RefusesWhatItCannotUseWithOneLine) {
  const auto refuses = [&](const std::string& bytes, const std::string& reason) {
    const std::string path = write("refused.vti", bytes);
    const std::string message = errorOf([&] { readAll(*openVtiSource(path)); });
    EXPECT_CONTAINS(message, reason);
    EXPECT_CONTAINS(message, path);
  };
  const auto refusesFrame = [&](const std::function<void(VtiFrame&)>& change,
                                const std::string& reason) {
    VtiFrame frame;
    change(frame);
    refuses(fileWith(frame), reason);
  };
  refusesFrame([](VtiFrame& f) { f.file_type = "PolyData"; }, "'PolyData', not ImageData");
  refusesFrame([](VtiFrame& f) { f.compressor = "vtkBZ2DataCompressor"; }, "vtkBZ2DataCompressor");
  refusesFrame([](VtiFrame& f) { f.image = ""; }, "WholeExtent");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0'"; }, "six whole numbers");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0 5 7'"; }, "six whole numbers");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0 99999999999999999999'"; },
               "six whole numbers");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0 9223372036854775807'"; },
               "six whole numbers");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0 6'"; }, "the voxel 0,0,6");
  refusesFrame([](VtiFrame& f) { f.image = "WholeExtent='0 6 0 4 0 4'"; }, "beyond the whole");
  refusesFrame([](VtiFrame& f) { f.piece = "Extent='0 6 0 4'"; }, "six whole numbers");
  const auto both = [](VtiFrame& f, const std::string& extent) {
    f.image = "WholeExtent='" + extent + "'";
    f.piece = "Extent='" + extent + "'";
  };
  refusesFrame([&](VtiFrame& f) { both(f, "0 6 0 4 0 0"); }, "at least 2 voxels");
  refusesFrame([&](VtiFrame& f) { both(f, "6 0 0 4 0 5"); }, "at least 2 voxels");
  refusesFrame([&](VtiFrame& f) { both(f, "0 2147483647 0 4 0 5"); }, "at most");
  refusesFrame([&](VtiFrame& f) { both(f, "0 999999 0 999999 0 999999"); },
               "needs 1000000000000000000");
  refusesFrame([&](VtiFrame& f) { both(f, "0 6 0 4 0 6"); },
               "has 210 bytes and its extent needs 245");
  refusesFrame([](VtiFrame& f) { f.image += " Direction='1 0 0'"; }, "nine numbers");
  refusesFrame([](VtiFrame& f) { f.image += " Direction='1 0 0 1 1 0 0 0 1'"; }, "right angles");
  refusesFrame([](VtiFrame& f) { f.image += " WholeExtent='0 6 0 4 0 5'"; }, "damaged tag");
  refusesFrame([](VtiFrame& f) { f.image = R"(WholeExtent="0 6 0 4 0 5" Spacing="0 1 1")"; },
               "spacing");
  refusesFrame([](VtiFrame& f) { f.piece = "Extent='0 -1 0 4 0 5'"; }, "pieces are empty");
  refusesFrame([](VtiFrame& f) { f.piece += "></Piece><Piece Extent='0 6 0 4 0 5'"; },
               "has no array with one value per voxel; it has none");

  const VtiVariant v;
  const std::string text = vtiText(vtiEncoded(std::string(210, 'x'), v), v);
  refuses(vtiBytes("String", text, v), "no number");
  refuses(vtiBytes("Bit", text, v), "bits are packed");
  refuses(vtiBytes("UInt8", text, v, {}, "NumberOfComponents='4'"), "4 values per voxel");
  refuses(vtiBytes("UInt8", text, v, {}, "NumberOfComponents='-1'"), "is no number");
  std::string bytes = fileWith({});
  const auto with = [&](const std::string& old_part, const std::string& new_part) {
    std::string changed = bytes;
    const std::size_t at = changed.rfind(old_part);
    EXPECT_NE(at, std::string::npos) << old_part;
    return changed.replace(at, old_part.size(), new_part);
  };
  refuses(with("offset=\"8\"", "offset=\"99999\""), "behind the end");
  refuses(with("offset=\"8\"", "offset=\"18446744073709551615\""), "behind the end");
  refuses(with("offset=\"8\"", "offset=\"18446744073709551616\""), "no number");
  refuses(with("offset=\"8\"", "offset=\"7\""), "bytes and its extent needs 210");
  refuses(with("format='appended'", "format='hex'"), "'hex'");
  refuses(with("encoding=\"raw\"", "encoding=\"hex\""), "'hex'");
  refuses(with("   _", "   x"), "begin with '_'");
  refuses(with("LittleEndian", "MiddleEndian"), "MiddleEndian");
  refuses(with("UInt64", "UInt16"), "UInt16");
  refuses(with("</Piece>", "</Peace>"), "not open");
  refuses(with("<VTKFile", "<!DOCTYPE x><VTKFile"), "declaration");
  refuses("", "cut short");
  refuses("<VTKFile>", "no type");
  refuses("<html></html>", "no VTK file");
  refuses(std::string(200'000, '<'), "XML");
  refuses("<VTKFile type=\"ImageData\" a=\"" + std::string(200'000, 'x'), "tag without an end");
  std::string deep = "<VTKFile type='ImageData'>";
  for (int i = 0; i < 1000; ++i) deep += "<a>";
  refuses(deep, "too deep");
  EXPECT_CONTAINS(errorOf([&] { openVtiSource(pathOf("none.vti")); }), "No such file");
  EXPECT_CONTAINS(errorOf([&] { openVtiSource(folder_.string()); }), "not a regular file");
}

std::string packedByLz4(const std::string& bytes) {
  std::string packed(static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(bytes.size()))),
                     '\0');
  packed.resize(static_cast<std::size_t>(LZ4_compress_default(bytes.data(), packed.data(),
                                                              static_cast<int>(bytes.size()),
                                                              static_cast<int>(packed.size()))));
  return packed;
}

std::string packedByLzma(const std::string& bytes) {
  std::string packed(lzma_stream_buffer_bound(bytes.size()), '\0');
  std::size_t size = 0;
  EXPECT_EQ(lzma_easy_buffer_encode(
                1, LZMA_CHECK_CRC32, nullptr, reinterpret_cast<const std::uint8_t*>(bytes.data()),
                bytes.size(), reinterpret_cast<std::uint8_t*>(packed.data()), &size, packed.size()),
            LZMA_OK);
  packed.resize(size);
  return packed;
}

TEST_F(VtiSourceTest, ReadsBlocksOfLz4AndLzma) {
  const auto values = sampleVoxels<std::int16_t>();
  for (const bool is_lz4 : {true, false})
    for (const std::string format : {"raw", "base64", "binary"})
      for (const bool wide : {false, true})
        for (const bool big : {false, true})
          for (const std::size_t block : {64u, 105u, 4096u}) {
            VtiVariant v{format, true, wide, big, block};
            v.pack = is_lz4 ? packedByLz4 : packedByLzma;
            VtiFrame frame;
            frame.compressor = is_lz4 ? "vtkLZ4DataCompressor" : "vtkLZMADataCompressor";
            const std::string text = vtiText(vtiEncoded(bytesOfValues(values, big), v), v);
            const std::string whole = vtiBytes("Int16", text, v, frame);
            const auto source = openVtiSource(write("a.vti", whole));
            ASSERT_EQ(readVoxels<std::int16_t>(*source, 2), values) << format << wide << big;
            if (format != "raw" || block != 105) continue;
            // Damage is noticed, and cut files too.
            const std::size_t at = whole.find("   _") + 4 + 8 + text.size() / 2;
            for (std::size_t i = at; i < at + 40; ++i) {
              std::string damaged = whole;
              damaged[i] = static_cast<char>(damaged[i] ^ 0x55);
              try {
                readAll(*openVtiSource(write("a.vti", damaged)));
              } catch (const Error& error) {
                EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
              }
              EXPECT_CONTAINS(
                  errorOf([&] { readAll(*openVtiSource(write("a.vti", whole.substr(0, i)))); }),
                  "cut short");
            }
          }
  VtiVariant v{"raw", true};
  VtiFrame frame;
  frame.compressor = "vtkLZ4DataCompressor";
  EXPECT_CONTAINS(
      errorOf([&] {
        readAll(*openVtiSource(write(
            "a.vti",
            vtiBytes("UInt8",
                     bytesOfValues(std::vector<std::uint64_t>{1, 210, 0, ~std::uint64_t{0}}) + "x",
                     v, frame))));
      }),
      "damaged after 0 bytes");
}

std::string vtiOfArrays(const std::string& extent, const std::string& pieces) {
  return "<VTKFile type='ImageData' byte_order='BigEndian'><ImageData WholeExtent='" + extent +
         "' Origin='1 2 3' Spacing='0.5 0.25 2'>" + pieces + "</ImageData></VTKFile>";
}

std::string textArray(const std::string& type, const std::string& name, const std::string& text) {
  return "<DataArray type='" + type + "' Name='" + name + "' format='ascii'>" + text +
         "</DataArray>";
}

template <typename T>
std::string textOfNumbers(const std::vector<T>& values, const std::string& separator = " ") {
  std::string text;
  for (const T value : values) text += std::to_string(value) + separator;
  return text;
}

TEST_F(VtiSourceTest, ReadsNumbersAsText) {
  const auto open = [&](const std::string& type, const std::string& text) {
    return openVtiSource(
        write("a.vti",
              vtiOfArrays("0 1 0 1 0 1", "<Piece Extent='0 1 0 1 0 1'><PointData>" +
                                             textArray(type, "a", text) + "</PointData></Piece>")));
  };
  EXPECT_EQ(readVoxels<std::int16_t>(*open("Int16", "\n -1 2\t3 4\r\n5 6 7 32767 ")),
            (std::vector<std::int16_t>{-1, 2, 3, 4, 5, 6, 7, 32767}));
  EXPECT_EQ(
      readVoxels<float>(*open("Float32", "0.5 -1e3 inf 4 5 6 7 .25")),
      (std::vector<float>{0.5F, -1000, std::numeric_limits<float>::infinity(), 4, 5, 6, 7, 0.25F}));
  EXPECT_EQ(readVoxels<double>(*open("Float64", "1 2 3 4 5 6 7 8")).back(), 8);
  EXPECT_EQ(readVoxels<std::uint8_t>(*open("Bit", "0 1 0 1 0 0 0 1")),
            (std::vector<std::uint8_t>{0, 1, 0, 1, 0, 0, 0, 1}));
  for (const std::string wrong : {"1 2 3 4 5 6 7 x", "1 2 3 4 5 6 7 1.5", "1 2 3 4 5 6 7 40000"})
    EXPECT_CONTAINS(errorOf([&] { readAll(*open("Int16", wrong)); }), "is no number of its type");
  EXPECT_CONTAINS(errorOf([&] { readAll(*open("Int16", "1 2 3 4 5 6 7")); }), "ends after 14");
  EXPECT_CONTAINS(errorOf([&] { readAll(*open("Int16", std::string(100'000, '1'))); }),
                  "is no number");
  // Longer than the text that is read at a time.
  const std::string blanks(40'000, ' ');
  EXPECT_EQ(readVoxels<std::uint8_t>(*open("UInt8", blanks + "1 2" + blanks + "3 4 5 6 7 8"))[2],
            3);
}

TEST_F(VtiSourceTest, ReadsCellsAtTheirCentres) {
  const std::string cells = textOfNumbers(sampleVoxels<std::uint8_t>());
  const auto bytes = [&](const std::string& points) {
    return vtiOfArrays("10 17 0 5 0 6", "<Piece Extent='10 17 0 5 0 6'><PointData>" + points +
                                            "</PointData><CellData Scalars='a'>" +
                                            textArray("UInt8", "a", cells) + "</CellData></Piece>");
  };
  const auto check = [&](const std::string& path, const OpenOptions& options) {
    const auto source = openVtiSource(path, options);
    EXPECT_EQ(source->info().voxels, kVtiVoxels);
    EXPECT_EQ(source->info().geometry.origin, glm::dvec3(1 + 5.25, 2.125, 4));
    EXPECT_EQ(readVoxels<std::uint8_t>(*source), sampleVoxels<std::uint8_t>());
  };
  check(write("a.vti", bytes("")), {});
  const std::string both =
      write("a.vti", bytes(textArray("Int16", "p", textOfNumbers(std::vector<int>(336, 7)))));
  OpenOptions options;
  options.grid = "a";
  check(both, options);
  EXPECT_EQ(openVtiSource(both)->info().voxels, Index3(8, 6, 7));
  options.grid = "b";
  EXPECT_CONTAINS(errorOf([&] { openVtiSource(both, options); }),
                  "it has 'p' of points, 'a' of cells");
}

// Pieces of points share their borders, and those of cells do not.
TEST_F(VtiSourceTest, PutsPiecesTogether) {
  const auto values = sampleVoxels<std::uint8_t>();
  const auto pieceOf = [&](const Index3& first, const Index3& last, bool of_cells) {
    std::vector<int> numbers;
    const Index3 end = last + Index3(of_cells ? 0 : 1);
    for (std::int64_t z = first.z; z < end.z; ++z)
      for (std::int64_t y = first.y; y < end.y; ++y)
        for (std::int64_t x = first.x; x < end.x; ++x)
          numbers.push_back(values[static_cast<std::size_t>((z * 5 + y) * 7 + x)]);
    std::string extent;
    for (int axis = 0; axis < 3; ++axis)
      extent += std::to_string(first[axis]) + " " + std::to_string(last[axis]) + " ";
    const std::string kind = of_cells ? "CellData" : "PointData";
    return "<Piece Extent='" + extent + "'><" + kind + ">" +
           textArray("UInt8", "a", textOfNumbers(numbers)) + "</" + kind + "></Piece>";
  };
  for (const bool of_cells : {false, true}) {
    const Index3 last = of_cells ? kVtiVoxels : kVtiVoxels - Index3(1);
    const std::string whole = of_cells ? "0 7 0 5 0 6" : "0 6 0 4 0 5";
    std::string pieces;
    for (const Index3 low : {Index3(0), Index3(3, 0, 0), Index3(0, 2, 0), Index3(3, 2, 0)})
      pieces += pieceOf(low, {low.x == 0 ? 3 : last.x, low.y == 0 ? 2 : last.y, last.z}, of_cells);
    const std::string path = write("a.vti", vtiOfArrays(whole, pieces));
    const auto source = openVtiSource(path);
    EXPECT_EQ(source->files(), std::vector<std::string>{path});
    EXPECT_EQ(readVoxels<std::uint8_t>(*source), values);
    const std::string part = pieceOf(Index3(0), {3, last.y, last.z}, of_cells);
    EXPECT_CONTAINS(errorOf([&] { openVtiSource(write("b.vti", vtiOfArrays(whole, part))); }),
                    "none of its pieces has the voxel " + std::string(of_cells ? "3" : "4"));
  }
  const std::string other = "<Piece Extent='0 6 0 4 0 5'><PointData>" +
                            textArray("Int8", "a", "1") + "</PointData></Piece>";
  EXPECT_CONTAINS(errorOf([&] {
                    openVtiSource(write(
                        "b.vti", vtiOfArrays("0 6 0 4 0 5",
                                             pieceOf(Index3(0), Index3(6, 4, 5), false) + other)));
                  }),
                  "like that of the first");
}

TEST_F(VtiSourceTest, PutsTheFilesOfAPvtiTogether) {
  const auto values = sampleVoxels<std::uint8_t>();
  for (const std::int64_t low : {0, 3}) {
    std::vector<int> numbers;
    for (std::int64_t i = low * 35; i < (low == 0 ? 4 : 6) * 35; ++i)
      numbers.push_back(values[static_cast<std::size_t>(i)]);
    const std::string extent = low == 0 ? "0 6 0 4 0 3" : "0 6 0 4 3 5";
    write("p_" + std::to_string(low) + ".vti",
          vtiOfArrays(extent, "<Piece Extent='" + extent + "'><PointData>" +
                                  textArray("UInt8", "a", textOfNumbers(numbers)) +
                                  "</PointData></Piece>"));
  }
  const auto pvti = [&](const std::string& second) {
    return write("p.pvti",
                 "<VTKFile type='PImageData'><PImageData WholeExtent='0 6 0 4 0 5' Origin='1 2 3' "
                 "Spacing='0.5 0.25 2'><PPointData><PDataArray type='UInt8' Name='a'/></PPointData>"
                 "<Piece Extent='0 6 0 4 0 3' Source='p_0.vti'/><Piece " +
                     second + "/></PImageData></VTKFile>");
  };
  const std::string path = pvti("Extent='0 6 0 4 3 5' Source='p_3.vti'");
  const auto source = openVtiSource(path);
  EXPECT_EQ(source->info().geometry.origin, glm::dvec3(1, 2, 3));
  EXPECT_EQ(source->files(),
            (std::vector<std::string>{path, pathOf("p_0.vti"), pathOf("p_3.vti")}));
  EXPECT_EQ(readVoxels<std::uint8_t>(*source), values);
  const auto refuses = [&](const std::string& second, const std::string& why) {
    EXPECT_CONTAINS(errorOf([&] { openVtiSource(pvti(second)); }), why);
  };
  refuses("Extent='0 6 0 4 3 5' Source='none.vti'", "none.vti");
  refuses("Extent='0 6 0 4 4 5' Source='p_3.vti'", "has not the extent");
  refuses("Extent='0 6 0 4 3 5' Source='p.pvti'", "is no .vti file");
}

TEST_F(VtiSourceTest, ReadsStructuredPointsOfTheLegacyFormat) {
  const auto values = sampleVoxels<std::int16_t>();
  std::vector<float> cells(6 * 4 * 5);
  for (std::size_t i = 0; i < cells.size(); ++i) cells[i] = static_cast<float>(i);
  for (const bool is_text : {false, true}) {
    const auto valuesOf = [&](const auto& numbers) {
      return (is_text ? textOfNumbers(numbers) : bytesOfValues(numbers, true)) + "\n";
    };
    const std::string bytes =
        std::string("# vtk DataFile Version 5.1\na title of several words\n") +
        (is_text ? "ASCII" : "BINARY") +
        "\nDATASET STRUCTURED_POINTS\nFIELD FieldData 1\nTIME 1 1 double\n" +
        valuesOf(std::vector<double>{7}) +
        "DIMENSIONS 7 5 6\nSPACING 0.5 0.25 2\nORIGIN 1 2 3\nCELL_DATA 120\nSCALARS q float 1\n"
        "LOOKUP_TABLE default\n" +
        valuesOf(cells) +
        "METADATA\nINFORMATION 1\nNAME x LOCATION y\nDATA 1\n\nPOINT_DATA 210\n"
        "VECTORS wind char\n" +
        valuesOf(std::vector<std::int8_t>(630, 1)) + "SCALARS a%20b short\nLOOKUP_TABLE default\n" +
        valuesOf(values) + "FIELD FieldData 1\nmore 1 210 unsigned_char\n" +
        valuesOf(std::vector<std::uint8_t>(210, 9));
    const std::string path = write("a.vtk", bytes);
    const auto source = openVtiSource(path);
    EXPECT_EQ(source->info().voxels, kVtiVoxels);
    EXPECT_EQ(source->info().geometry.spacing, glm::dvec3(0.5, 0.25, 2));
    EXPECT_EQ(source->info().geometry.origin, glm::dvec3(1, 2, 3));
    EXPECT_EQ(readVoxels<std::int16_t>(*source), values);
    OpenOptions options;
    options.grid = "more";
    EXPECT_EQ(readVoxels<std::uint8_t>(*openVtiSource(path, options)),
              std::vector<std::uint8_t>(210, 9));
    options.grid = "q";
    const auto of_cells = openVtiSource(path, options);
    EXPECT_EQ(of_cells->info().geometry.origin, glm::dvec3(1.25, 2.125, 4));
    EXPECT_EQ(readVoxels<float>(*of_cells), cells);
    options.grid = "none";
    EXPECT_CONTAINS(errorOf([&] { openVtiSource(path, options); }), "'a b' of points");
    const std::size_t begin = bytes.find("LOOKUP_TABLE default\n" + valuesOf(values)) + 21;
    // Between these, the values of the cells are whole.
    const std::size_t first = bytes.find("SCALARS q");
    for (std::size_t size = 0; size < begin + (is_text ? 300 : 420); size += 5)
      if (size < first || size > begin) {
        EXPECT_CONTAINS(
            errorOf([&] { readAll(*openVtiSource(write("a.vtk", bytes.substr(0, size)))); }),
            "a.vtk");
      }
  }
  const auto refuses = [&](const std::string& text, const std::string& why) {
    EXPECT_CONTAINS(errorOf([&] { openVtiSource(write("a.vtk", "# vtk\nt\n" + text)); }), why);
  };
  refuses("BINARY\nDATASET POLYDATA\n", "'POLYDATA'");
  refuses("HEX\n", "neither ASCII nor BINARY");
  refuses("ASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 x 6\n", "no number");
  refuses(
      "BINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 5 6\nPOINT_DATA 210\nSCALARS a bit\n"
      "LOOKUP_TABLE default\n",
      "bits are packed");
  refuses(
      "BINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 5 6\nPOINT_DATA 9223372036854775807\n"
      "SCALARS a double 1000\nLOOKUP_TABLE default\n",
      "no number of values");
}

// UInt8 voxels behind words of any value.
std::string fileWithWords(const std::vector<std::uint64_t>& words, const std::string& data) {
  VtiVariant v;
  v.zlib = true;
  return vtiBytes("UInt8", bytesOfValues(words) + data, v);
}

TEST_F(VtiSourceTest, RefusesHostileBlocks) {
  const std::string bytes(210, 'x');
  const std::string block = deflated(bytes, false);
  const auto message = [&](const std::vector<std::uint64_t>& words, const std::string& data) {
    return errorOf(
        [&] { readAll(*openVtiSource(write("blocks.vti", fileWithWords(words, data)))); });
  };
  EXPECT_NO_THROW(
      readAll(*openVtiSource(write("good.vti", fileWithWords({1, 210, 0, block.size()}, block)))));
  EXPECT_NO_THROW(readAll(
      *openVtiSource(write("good.vti", fileWithWords({1, 300, 210, block.size()}, block)))));
  EXPECT_NO_THROW(readAll(
      *openVtiSource(write("good.vti", fileWithWords({1, 210, 210, block.size()}, block)))));
  constexpr std::uint64_t kMost = ~std::uint64_t{0};
  for (const std::vector<std::uint64_t>& words :
       std::vector<std::vector<std::uint64_t>>{{0, 210, 0},
                                               {0, 0, 210},
                                               {1, 0, 0, 9},
                                               {1, 209, 0, 9},
                                               {1, 211, 0, 9},
                                               {2, 210, 0, 9, 9},
                                               {kMost, kMost, 0, 9},
                                               {kMost, kMost, kMost, 9},
                                               {kMost, 1, 0, 9},
                                               {std::uint64_t{1} << 63, 2, 210, 9},
                                               {kMost / 210 + 2, 210, 0, 9}})
    EXPECT_CONTAINS(message(words, block), "extent needs 210");
  // A list of sizes that is longer than the file.
  EXPECT_CONTAINS(message({210, 1, 0}, block), "cut short");
  const std::string half = deflated(bytes.substr(0, 105), false);
  EXPECT_CONTAINS(message({1, 210, 0, half.size()}, half), "damaged after 0 bytes");
  EXPECT_CONTAINS(message({2, 105, 0, half.size(), 9}, half + block.substr(0, 9)), "damaged after");
  EXPECT_CONTAINS(message({1, 210, 0, 9}, "not packed"), "damaged after 0 bytes");
}

TEST_F(VtiSourceTest, ABlockTakesNoMoreMemoryThanItsBytesCanBecome) {
  VtiFrame frame;
  for (std::string* const extent : {&frame.image, &frame.piece})
    *extent =
        std::string(extent == &frame.image ? "WholeExtent" : "Extent") + "='0 1023 0 1023 0 1023'";
  VtiVariant v;
  v.zlib = true;
  constexpr std::uint64_t kBlock = std::uint64_t{1} << 30;
  const std::string block = deflated(std::string(210, 'x'), false);
  for (const std::uint64_t bytes : {std::uint64_t{block.size()}, std::uint64_t{1} << 30}) {
    const std::string words = bytesOfValues(std::vector<std::uint64_t>{1, kBlock, 0, bytes});
    const auto source = openVtiSource(write("a.vti", vtiBytes("UInt8", words + block, v, frame)));
    std::vector<std::uint8_t> row(1024);
    struct rusage before = {}, after = {};
    getrusage(RUSAGE_SELF, &before);
    EXPECT_CONTAINS(errorOf([&] { source->readRows(0, 1, row.data()); }),
                    bytes == kBlock ? "cut short after 0" : "damaged after 0");
    getrusage(RUSAGE_SELF, &after);
    EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 64 * 1024) << "KiB";
  }
}

TEST_F(VtiSourceTest, EveryPrefixIsAnErrorUntilTheVoxelsAreThere) {
  for (const std::string format : {"raw", "base64", "binary"})
    for (const bool zlib : {false, true}) {
      const VtiVariant v{format, zlib};
      const std::string whole = fileWith({}, v);
      // Of the voxels' last byte; what follows is XML that nobody needs where they are appended.
      const std::size_t end = whole.rfind(format == "binary" ? "\n</VTKFile" : "\n</AppendedData");
      const std::string path = pathOf("prefix.vti");
      for (std::size_t size = 0; size < end; size += size < 900 ? 7 : 1) {
        write("prefix.vti", whole.substr(0, size));
        const std::string message = errorOf([&] { readAll(*openVtiSource(path)); });
        ASSERT_NE(message.find(path), std::string::npos) << size << " " << message;
      }
    }
}

TEST_F(VtiSourceTest, DamagedBytesNeverCrash) {
  for (const std::string format : {"raw", "base64", "binary"}) {
    const std::string whole = fileWith({}, {format, true});
    for (std::size_t i = 0; i < whole.size(); ++i) {
      constexpr int kBits[] = {0x01, 0x20, 0x80};
      std::string damaged = whole;
      damaged[i] = static_cast<char>(damaged[i] ^ kBits[i % 3]);
      try {
        readAll(*openVtiSource(write("damaged.vti", damaged)));
      } catch (const Error& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      }
    }
  }
}

}  // namespace
}  // namespace isobrick
