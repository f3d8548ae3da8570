// Pyramids, their parts, journals of builds, and shares of meshes.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "isobrick/extract/extractor.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/shares/share_format.h"
#include "isobrick/extract/surface_mesh.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/pyramid.h"
#include "isobrick/storage/pyramid_verify.h"
#include "isobrick/storage/write_journal.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/sealed_pyramid.h"

namespace isobrick::test {
namespace {

// A few constant bricks may stand for any volume: larger ones take as long as their voxels do.
constexpr std::int64_t kMostVoxels = 40000;

#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
constexpr bool kChecksumsCount = false;
#else
constexpr bool kChecksumsCount = true;
#endif

// Checksums of a pyramid as the fuzzer's build takes them: for right.
std::string sealed(const std::string& bytes) {
  if (!kChecksumsCount) return bytes;
  Bytes file(bytes.begin(), bytes.end());
  sealChecksums(file);
  return {file.begin(), file.end()};
}

// The same of a share.
std::string sealedShare(std::string bytes) {
  using namespace share_format;
  if (!kChecksumsCount || bytes.size() < sizeof(Header)) return bytes;
  Header header;
  std::memcpy(&header, bytes.data(), sizeof header);
  const std::size_t text = std::min<std::size_t>(header.identity_bytes, bytes.size());
  header.identity_checksum = checksum64(bytes.data() + bytes.size() - text, text);
  header.header_checksum = checksum64(&header, offsetof(Header, header_checksum));
  std::memcpy(bytes.data(), &header, sizeof header);
  std::size_t at = sizeof header;
  for (std::uint64_t batch = 0; batch < header.batches; ++batch) {
    BatchRecord record;
    if (bytes.size() - at < sizeof record) break;
    std::memcpy(&record, bytes.data() + at, sizeof record);
    if (record.bytes < sizeof record || record.bytes > bytes.size() - at) break;
    constexpr std::size_t kChecked = offsetof(BatchRecord, level);
    record.checksum = checksum64(bytes.data() + at + kChecked, record.bytes - kChecked);
    std::memcpy(bytes.data() + at, &record, sizeof record);
    at += record.bytes;
  }
  return bytes;
}

class DemandingSink : public TriangleSink {
 public:
  void accept(const MeshBatch& batch) override {
    demand(batch.normals.size() == batch.positions.size(), "each vertex has a normal");
    for (const std::uint32_t index : batch.triangles)
      demand(index < batch.positions.size(), "triangles have vertices of the mesh");
    for (const glm::vec3& p : batch.positions)
      demand(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z),
             "positions are finite");
  }
};

// Some query, by the last bytes of the input.
Query queryBy(FuzzBytes bytes, const Pyramid& pyramid) {
  const unsigned choice = bytes.empty() ? 0 : bytes.back();
  const ValueRange range = pyramid.valueRange();
  Query query;
  query.isovalue = 0.5 * (double{range.min} + double{range.max});
  if (choice % 2 == 0)
    query.focus = FocusSphere{glm::dvec3(pyramid.spec().voxels) * 0.5, double(choice % 8)};
  if (choice % 5 == 0 && pyramid.spec().has_curvature) query.curvature_tolerance = 0.01;
  if (choice % 7 == 0) query.simplify = SimplifyOptions{0.5};
  return query;
}

void readPyramid(const std::string& path, FuzzBytes bytes) {
  const Pyramid pyramid(path, std::uint64_t{32} << 20);
  if (elementCount(pyramid.spec().voxels) > kMostVoxels) return;
  VerifyOptions options;
  options.threads = 1;
  verifyPyramid(pyramid, options);
  DemandingSink sink;
  extractIsosurface(pyramid, queryBy(bytes, pyramid), sink);
}

void runPyramid(FuzzBytes bytes) {
  const FuzzFolder folder({{"", sealed(filesOf(bytes).front().bytes)}}, "a.isb");
  readPyramid(folder.files().front(), bytes);
}

void runDivided(FuzzBytes bytes) {
  std::vector<FuzzFile> files = filesOf(bytes);
  for (FuzzFile& file : files) file.bytes = sealed(file.bytes);
  const FuzzFolder folder(files, "index.isb");
  readPyramid(folder.path(), bytes);
}

// The codec, the size of the part in two bytes, and how it is stored.
void runCodec(FuzzBytes bytes) {
  if (bytes.size() < 3) return;
  const auto codec = static_cast<format::Codec>(bytes[0] % 6);
  std::vector<std::byte> out(16u * (bytes[1] + 256u * bytes[2]) + bytes[0] / 6u);
  if (decodePart(codec, std::as_bytes(bytes.subspan(3)), out.size(), out.data()))
    demand(codec != format::Codec::kAbsent, "an absent part is not unpacked");
}

void runJournal(FuzzBytes bytes) {
  const FuzzFolder folder({{"", filesOf(bytes).front().bytes}}, "a.journal");
  WriteJournal::read(folder.files().front());
}

void runShares(FuzzBytes bytes) {
  std::vector<FuzzFile> files = filesOf(bytes);
  for (FuzzFile& file : files) file.bytes = sealedShare(file.bytes);
  const FuzzFolder folder(files, "1.isbm");
  DemandingSink sink;
  mergeMeshShares(folder.files(), sink);
}

constexpr FuzzTarget kTable[] = {
    {"storage", "isb", "storage/(pyramid|brick|paged|buffer|voxel_histogram|gradient)", runPyramid,
     true},
    {"storage", "isbs", "storage/(pyramid_division|divided|pyramid_file|brick_index)", runDivided,
     true},
    {"storage", "codec", "storage/brick_encoder", runCodec},
    {"storage", "journal", "storage/write_journal", runJournal, true},
    {"storage", "isbm", "extract/shares/", runShares, true},
};

}  // namespace

constinit const std::span<const FuzzTarget> kStorageTargets = kTable;

}  // namespace isobrick::test
