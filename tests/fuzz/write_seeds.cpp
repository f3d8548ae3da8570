// Writes what fuzzing begins with into FOLDER/TARGET/: small files of the library's own writers,
// and of the tests' where it has none.
//
//   isobrick_fuzz_seeds FOLDER
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/zip_writer.h"
#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/write_journal.h"
#include "isobrick/viewer/state/view_file.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/file_bytes.h"
#include "tests/support/mrc_file.h"
#include "tests/support/nifti_file.h"
#include "tests/support/noise_pyramid.h"
#include "tests/support/packed_bytes.h"
#include "tests/support/test_paths.h"
#include "tests/support/tiff_file.h"
#include "tests/support/vti_file.h"

namespace isobrick::test {
namespace {

namespace stdfs = std::filesystem;

class Seeds {
 public:
  explicit Seeds(std::string folder) : folder_(std::move(folder)) {}

  void all() {
    writePyramids();
    writeParts();
    writeShares();
    writeVolumes();
    writeVtk();
    writeDicom();
    writeHdf5();
    writeTexts();
  }

 private:
  void seed(const std::string& target, const std::string& name, const std::string& bytes) const {
    stdfs::create_directories(folder_ + "/" + target);
    writeBytes(folder_ + "/" + target + "/" + name, bytes);
  }
  // All files below a folder, as one input.
  static std::string parcel(const std::string& folder) {
    std::vector<FuzzFile> files;
    for (const auto& entry : stdfs::recursive_directory_iterator(folder))
      if (entry.is_regular_file())
        files.push_back({stdfs::relative(entry.path(), folder), readBytes(entry.path())});
    std::sort(files.begin(), files.end(),
              [](const FuzzFile& a, const FuzzFile& b) { return a.name < b.name; });
    return bytesOf(files);
  }
  static PhantomSpec phantom(std::int64_t size, VoxelType type = VoxelType::kUint8) {
    return {"sphere", size, type};
  }

  void writePyramids() {
    for (const char* const name : {"u8-zstd", "i16-lz4", "around-f32-zstd", "errors-i8-none"})
      seed("isb", name, readBytes(goldenFolder() + "/" + name + ".isb"));
    seed("isb", "tiny", readBytes(buildTinyFile(made_)));
    const std::string pyramid = made_.file("a.isbs");
    stdfs::create_directory(pyramid);
    BuildOptions options = smallBricks();
    options.super_cells = 8;
    const auto source = [] { return NoiseSource(Index3(13, 5, 5), VoxelType::kUint8); };
    for (std::size_t i = 0; i < superBrickFiles(source().info(), options).size(); ++i) {
      NoiseSource fresh = source();
      buildSuperBrick(fresh, pyramid, i, options);
    }
    joinPyramid(pyramid, {});
    seed("isbs", "noise", parcel(pyramid));
  }

  void writeParts() {
    std::vector<std::byte> numbers(512);
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = std::byte(i / 16);
    for (const format::Codec codec : kCodecs) {
      EncodedPart part;
      part.bytes = numbers;
      encodeNumbers(1, codec, part);
      const std::string stored(reinterpret_cast<const char*>(part.bytes.data()), part.bytes.size());
      const auto number = static_cast<char>(codec);
      seed("codec", "codec" + std::to_string(number), std::string{number, 32, 0} + stored);
      seed("unpack", "blosc" + std::to_string(number), std::string{1, 64, 0} + stored);
    }
    const std::string plain(reinterpret_cast<const char*>(numbers.data()), numbers.size());
    seed("unpack", "zlib", std::string{2, 64, 0} + deflated(plain, false));
    seed("unpack", "gzip", std::string{2, 64, 0} + deflated(plain, true));
    const std::string journal = made_.file("journal");
    WriteJournal(journal, "an identity", std::vector<JournalEntry>(3));
    seed("journal", "three", readBytes(journal));
  }

  std::string sphere() const {
    const std::string path = made_.file("sphere.isb");
    buildPyramid(*makePhantomSource(phantom(7)), path, smallBricks());
    return path;
  }
  static Query sphereQuery() {
    Query query;
    query.isovalue = 128;
    return query;
  }

  void writeShares() {
    const Pyramid pyramid(sphere());
    const Extractor extractor(pyramid);
    const Query query = sphereQuery();
    for (const std::uint32_t count : {1u, 2u}) {
      std::vector<FuzzFile> files;
      const ExtractionPlan plan = extractor.plan(query);
      for (std::uint32_t number = 1; number <= count; ++number) {
        const std::string name = std::to_string(number) + ".isbm";
        const auto sink = makeMeshShareSink(made_.file(name), pyramid, plan, {number, count});
        const NumberRun run = bricksOf(plan, {number, count});
        Extractor(pyramid).execute(plan, run.first, run.count, *sink);
        files.push_back({name, readBytes(made_.file(name))});
      }
      if (count == 1) files.front().name.clear();
      seed("isbm", "of" + std::to_string(count), bytesOf(files));
    }
  }

  std::string exported(const std::string& name, const ExportOptions& options = {},
                       VoxelType type = VoxelType::kUint8) const {
    VolumeLevels levels;
    levels.push_back(makePhantomSource(phantom(6, type)));
    exportVolume(levels, made_.file(name), options);
    return made_.file(name);
  }

  void writeVolumes() {
    for (const int version : {2, 3}) {
      ExportOptions options;
      options.zarr_version = version;
      options.zarr_shard = 64;
      const std::string name = std::to_string(version) + ".ome.zarr";
      seed("zarr", "v" + std::to_string(version), parcel(exported(name, options)));
    }
    seed("zarr", "v2-plain",
         bytesOf({{".zarray",
                   R"({"zarr_format":2,"shape":[1,2,3,4],"chunks":[1,2,2,4],"dtype":"<i2",)"
                   R"("fill_value":-1,"order":"F","compressor":null,"dimension_separator":"/",)"
                   R"("filters":[{"id":"delta","dtype":"<i2"},{"id":"shuffle","elementsize":2}]})"},
                  {"0/0/0/0", std::string(32, '\2')}}));
    const std::string zip = made_.file("a.zip");
    AtomicFile file(zip);
    ZipWriter writer(file);
    for (const auto& [name, text] :
         {std::pair{".zarray", std::string(R"({"zarr_format":2,"shape":[2,3,4],"chunks":[2,2,4],)"
                                           R"("dtype":"|u1","fill_value":0,"order":"C",)"
                                           R"("compressor":{"id":"zlib"},"filters":null})")},
          std::pair{"0.0.0", deflated(std::string(16, '\3'), false)}}) {
      writer.beginMember(name);
      writer.add(packText(text));
      writer.endMember();
    }
    writer.finish();
    file.commit();
    seed("zip", "two-chunks", readBytes(zip));

    seed("nrrd", "own", readBytes(exported("a.nrrd")));
    seed("nrrd", "own-i16", readBytes(exported("b.nrrd", {}, VoxelType::kInt16)));
    seed("nrrd", "text",
         "NRRD0005\ntype: short\ndimension: 4\nsizes: 2 3 2 2\nencoding: ascii\n"
         "space: left-posterior-superior\nspace directions: none (1,0,0) (0,2,0) (0,0,3)\n"
         "space origin: (1,2,3)\nspace units: \"mm\" \"mm\" \"mm\"\nkinds: vector domain domain "
         "domain\n\n1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24\n");
    seed("nrrd", "gzip",
         "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 3 3\nencoding: gzip\nspacings: 1 2 3\n\n" +
             deflated(std::string(27, '\5'), true));
    seed("nrrd", "detached",
         bytesOf({{"a.nhdr",
                   "NRRD0004\ntype: ushort\ndimension: 3\nsizes: 3 3 2\nencoding: raw\n"
                   "endian: big\ndata file: a%d.raw 1 2 1 2\nline skip: 1\n"},
                  {"a1.raw", "x\n" + std::string(18, '\1')},
                  {"a2.raw", "x\n" + std::string(18, '\2')}}));
    seed("metaimage", "own", readBytes(exported("a.mha")));
    seed("metaimage", "detached",
         bytesOf({{"a.mhd",
                   "ObjectType = Image\nNDims = 3\nDimSize = 3 3 2\nElementType = MET_SHORT\n"
                   "ElementSpacing = 1 2 3\nOffset = 1 2 3\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n"
                   "BinaryDataByteOrderMSB = True\nHeaderSize = -1\nElementDataFile = LIST\n"
                   "1.raw\n2.raw\n"},
                  {"1.raw", std::string(18, '\1')},
                  {"2.raw", std::string(18, '\2')}}));
    NiftiFields fields;
    fields.slope = 2;
    fields.intercept = -1;
    const std::string nifti = niftiHeader({3, 4, 2}, fields, false) + std::string(48, '\1');
    seed("nifti", "one-file", nifti);
    seed("nifti", "gzip", deflated(nifti, true));
    seed("nifti", "big-endian", niftiHeader({3, 4, 2}, {}, true) + std::string(48, '\1'));
    fields.magic = "ni1";
    fields.offset = 0;
    seed("nifti", "two-files",
         bytesOf(
             {{"a.hdr", niftiHeader({3, 4, 2}, fields, false)}, {"a.img", std::string(48, '\1')}}));
    MrcFile mrc;
    seed("mrc", "float", mrc.header() + std::string(96, '\1'));
    mrc.mode = 101;
    mrc.big_endian = true;
    mrc.axes = {2, 1, 3};
    seed("mrc", "nibbles", mrc.header() + std::string(96, '\1'));

    seed("tiff", "own", readBytes(exported("a.tif")));
    for (const auto& [name, form] :
         {std::pair{"big", TiffForm{true, true}}, std::pair{"packed", TiffForm{false, false, true}},
          std::pair{"tiles", TiffForm{false, false, false, 7, 16}}}) {
      TiffBuilder builder(form);
      for (int page = 0; page < 2; ++page) builder.addPage({9, 8, 2, 1, 1, std::string(144, '\1')});
      seed("tiff", name, builder.bytes());
    }
    TiffBuilder described(TiffForm{});
    described.addPage(
        {3, 3, 1, 1, 1, std::string(9, '\1'), 0,
         R"(<OME><Image><Pixels DimensionOrder="XYZCT" Type="uint8" SizeX="3" SizeY="3" )"
         R"(SizeZ="2" SizeC="1" SizeT="1" PhysicalSizeX="0.5"><TiffData IFD="0"/>)"
         R"(</Pixels></Image></OME>)"});
    described.addPage({3, 3, 1, 1, 1, std::string(9, '\2')});
    seed("tiff", "ome", described.bytes());
    TiffBuilder imagej(TiffForm{});
    for (int page = 0; page < 2; ++page)
      imagej.addPage({3, 3, 1, 1, 1, std::string(9, '\1'), 0,
                      "ImageJ=1.53\nimages=2\nslices=2\nspacing=2.5\nunit=um\n"});
    seed("tiff", "imagej", imagej.bytes());

    const Pyramid pyramid(sphere());
    for (const char* const name : {"a.ply", "a.stl"}) {
      extractIsosurface(pyramid, sphereQuery(), *makeMeshFileSink(made_.file(name)));
      seed("mesh", name, readBytes(made_.file(name)));
    }
    seed("mesh", "text",
         "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty double y\n"
         "property int z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
         "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n");
  }

  void writeVtk() const {
    VtiFrame frame;
    frame.image = R"(WholeExtent="0 2 0 2 0 2" Origin="1 2 3" Spacing="0.5 0.25 2")";
    frame.piece = R"(Extent="0 2 0 2 0 2")";
    const std::string voxels(54, '\1');
    for (const char* const form : {"raw", "base64", "binary"})
      for (const bool is_packed : {false, true}) {
        VtiVariant variant;
        variant.format = form;
        variant.zlib = is_packed;
        variant.wide = is_packed;
        variant.block_bytes = 32;
        seed("vti", form + std::string(is_packed ? "-zlib" : ""),
             vtiBytes("Int16", vtiText(vtiEncoded(voxels, variant), variant), variant, frame));
      }
    seed(
        "vti", "pieces",
        bytesOf(
            {{"a.pvti",
              R"(<VTKFile type="PImageData"><PImageData WholeExtent="0 2 0 2 0 2" )"
              R"(Spacing="1 1 1"><PPointData Scalars="a"><PDataArray type="UInt8" Name="a"/>)"
              R"(</PPointData><Piece Extent="0 2 0 2 0 2" Source="1.vti"/></PImageData></VTKFile>)"},
             {"1.vti", R"(<VTKFile type="ImageData"><ImageData WholeExtent="0 2 0 2 0 2"><Piece )"
                       R"(Extent="0 2 0 2 0 2"><PointData><DataArray type="UInt8" Name="a" )"
                       R"(format="ascii">1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3 4 5 6 7 8 9)"
                       R"(</DataArray></PointData></Piece></ImageData></VTKFile>)"}}));
    const std::string legacy =
        "# vtk DataFile Version 3.0\na\n%\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 3 3\n"
        "ORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 27\nSCALARS a unsigned_char 1\n"
        "LOOKUP_TABLE default\n";
    for (const char* const form : {"BINARY", "ASCII"}) {
      std::string text = legacy;
      text.replace(text.find('%'), 1, form);
      for (int i = 0; i < 27; ++i) text += form[0] == 'B' ? "\1" : "7 ";
      seed("vtk", form, text);
    }
  }

  // Elements with explicit types.
  static std::string element(std::uint32_t tag, const std::string& type, std::string value) {
    const auto number = [](std::uint64_t n, int bytes) {
      std::string text;
      for (int i = 0; i < bytes; ++i) text += static_cast<char>(n >> 8 * i);
      return text;
    };
    if (value.size() % 2 != 0) value += ' ';
    const bool is_long = type == "SQ" || type == "OW";
    return number(tag >> 16, 2) + number(tag & 0xffff, 2) + type +
           std::string(is_long ? 2 : 0, '\0') + number(value.size(), is_long ? 4 : 2) + value;
  }
  static std::string item(const std::string& content) {
    return "\xfe\xff" + std::string("\x00\xe0\xff\xff\xff\xff", 6) + content + "\xfe\xff" +
           std::string("\x0d\xe0\0\0\0\0", 6);
  }
  void writeDicom() const {
    const auto u16 = [](char n) { return std::string{n, '\0'}; };
    const std::string head = std::string(128, '\0') + "DICM" +
                             element(0x00020010, "UI", "1.2.840.10008.1.2.1") +
                             element(0x00080016, "UI", "1.2.840.10008.5.1.4.1.1.2");
    const std::string grid =
        element(0x00280002, "US", u16(1)) + element(0x00280004, "CS", "MONOCHROME2");
    const std::string size =
        element(0x00280010, "US", u16(2)) + element(0x00280011, "US", u16(3)) +
        element(0x00280030, "DS", "0.5\\0.5") + element(0x00280100, "US", u16(16)) +
        element(0x00280101, "US", u16(12)) + element(0x00280102, "US", u16(11)) +
        element(0x00280103, "US", u16(1)) + element(0x00281052, "DS", "-1024") +
        element(0x00281053, "DS", "1");
    const std::string place =
        element(0x00200032, "DS", "1\\2\\3") + element(0x00200037, "DS", "1\\0\\0\\0\\1\\0");
    seed("dicom", "slice",
         head + element(0x0020000e, "UI", "1.2") + place + grid + size +
             element(0x7fe00010, "OW", std::string(12, '\1')));
    const std::string measures = element(0x00289110, "SQ", item(element(0x00280030, "DS", "1\\1")));
    std::string frames;
    for (const char* const z : {"1\\2\\3", "1\\2\\4"})
      frames += item(
          element(0x00209111, "SQ", item(element(0x00209057, "UL", std::string("\1\0\0\0", 4)))) +
          element(0x00209113, "SQ", item(element(0x00200032, "DS", z))));
    seed("dicom", "enhanced",
         head + grid + element(0x00280008, "IS", "2") + size +
             element(0x52009229, "SQ", item(measures)) + element(0x52009230, "SQ", frames) +
             element(0x7fe00010, "OW", std::string(24, '\1')));
  }

  void writeHdf5() const {
    seed("hdf5", "plain",
         "data /a u1 3,4,5\ntext /a axistags {\"axes\":[{\"key\":\"z\",\"resolution\":2},{\"key\":"
         "\"y\"},{\"key\":\"x\"}]}\nnumbers /a element_size_um 1,2,3\n");
    seed("hdf5", "scales",
         "data /z f8 3\ndata /y f8 4\ndata /x f8 5\ntext /x units mm\ntext /z CLASS "
         "DIMENSION_SCALE\ndata /v i2 3,4,5\nscales /v /z /y /x\n");
    seed("hdf5", "imaris",
         "data /DataSet/ResolutionLevel_0/TimePoint_0/Channel_0/Data u2 3,4,5\n"
         "letters /DataSet/ResolutionLevel_0/TimePoint_0/Channel_0 ImageSizeX 5\n"
         "letters /DataSet/ResolutionLevel_0/TimePoint_0/Channel_0 ImageSizeY 4\n"
         "letters /DataSet/ResolutionLevel_0/TimePoint_0/Channel_0 ImageSizeZ 3\n"
         "group /DataSetInfo/Image\nletters /DataSetInfo/Image ExtMin0 0\n"
         "letters /DataSetInfo/Image ExtMax0 5\nletters /DataSetInfo/Image ExtMin1 0\n"
         "letters /DataSetInfo/Image ExtMax1 4\nletters /DataSetInfo/Image ExtMin2 0\n"
         "letters /DataSetInfo/Image ExtMax2 3\nletters /DataSetInfo/Image Unit um\n");
    seed("hdf5", "bdv",
         "data /t00000/s00/0/cells i2 3,4,5\ndata /s00/resolutions f8 1,3\ndata /s00/subdivisions "
         "f8 1,3\n");
    seed("hdf5", "channels", "data /a f4 2,2,3,4,5\ntext /a DIMENSION_LABELS t\n");
  }

  void writeTexts() const {
    seed("view", "first", viewStateToJson(ViewState()));
    SavedView view;
    view.volume = "head.isb";
    view.beside = {"other.isb"};
    writeView(made_.file("view.json"), view);
    seed("view", "saved", readBytes(made_.file("view.json")));
    seed("script", "steps",
         R"({"size":[300,200],"scale":1.75,"steps":[{"move":[12.25,40]},)"
         R"({"press":"right","shift":true},{"wheel":[-2,0.5]},{"key_press":"PAD7"},{"text":"a"},)"
         R"({"resize":[5,6]},{"open":"/a.nrrd"},{"wait":0.25},{"wait":"settled"},)"
         R"({"sweep":{"isovalue":[500,1250],"seconds":2}},{"set":{"focus":{"radius":20}}},)"
         R"({"turntable":{"frames":4,"name":"turn"}},{"click":[1,2]},{"picture":"a.png"}]})");
    int number = 0;
    for (const char* const text : {"1,2.5,-3", "256MiB", "3/8", "85x60mm", "#12abEF", "red",
                                   "75,30,75mm", "1e300", "0,0,0,9,9,9"})
      seed("option", std::to_string(number++), text);
    seed("address", "http", "https://user:word@example.org:8443/a/b.isb?X-Amz-Signature=abc#d");
    seed("address", "s3",
         bytesOf({{"url", "s3://bucket/a/b c.isb"},
                  {"keys",
                   "[default]\naws_access_key_id = A\naws_secret_access_key = B\n"
                   "[profile other]\nregion = eu-west-1\nendpoint_url = https://e.org/\n"}}));
    seed("address", "gs", "gs://bucket/key");
    const std::string body(64, 'x');
    seed("http", "range",
         "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-63/1000\r\nContent-Length: 64\r\n"
         "ETag: \"a\"\r\nLast-Modified: Mon, 01 Jan 2024 00:00:00 GMT\r\n\r\n" +
             body);
    seed("http", "busy", "HTTP/1.1 503 Busy\r\nRetry-After: 7\r\nContent-Length: 2\r\n\r\nno");
    seed("http", "region",
         "HTTP/1.1 301 Moved\r\nx-amz-bucket-region: eu-west-1\r\nContent-Length: 0\r\n\r\n");
    seed("http", "redirect",
         bytesOf({{"1",
                   "HTTP/1.1 302 Found\r\nLocation: http://other.test/b\r\nContent-Length: "
                   "0\r\n\r\n"},
                  {"2",
                   "HTTP/1.1 206 P\r\nContent-Range: bytes 0-9/10\r\nTransfer-Encoding: "
                   "chunked\r\n\r\na\r\n0123456789\r\n0\r\nETag: x\r\n\r\n"}}));
    seed("message", "wish",
         R"({"type":"wish","wish":7,"surfaces":[{"iso":0.5},{"iso":9e9,"visible":false}],)"
         R"("focus":[1,-2,300],"radius":1e9,"view":{"eye":[0,-400,60],"pixels_per_radian":1500,)"
         R"("pixels":1.5},"curvature":0.005,"most_triangles":8000000,"most_bytes":null})");
    seed("message", "shown", R"({"type":"shown","pass":3,"seconds":0.25})");
    seed("request", "slice",
         "/api/volume/0/slice.png?axis=z&size=64&window=0,100\n127.0.0.1:8080\n"
         "http://127.0.0.1:8080\nBearer 0123456789abcdef0123456789abcdef");
    seed("request", "plane",
         "/api/volume/12/slice.png?corner=0,0,5&across=9,0,0&along=0,9%2C0\nlocalhost:8080\n"
         "https://scans.example.org\nBearer x");
    seed("request", "surface", "/api/volume/0/surface.glb?iso=500&focus=1,2,3&radius=5&meshopt=1");
  }

  const std::string folder_;
  const TemporaryFolder made_;
};

}  // namespace
}  // namespace isobrick::test

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: isobrick_fuzz_seeds FOLDER\n", stderr);
    return 2;
  }
  isobrick::test::Seeds(argv[1]).all();
}
