// glTF 2.0, binary, packed as EXT_meshopt_compression says.
#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <string>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/meshopt_chunk.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// The format packs a view as a whole, so the mesh is cut into chunks of some batches each, and each
// is a primitive. A vertex that several batches have is there once for each of them; all positions
// are on one lattice, so the copies are equal and nothing opens.
//
// place() decides which batches are a chunk, in their order. write() adds the piece of a batch; the
// call that adds the last piece of a chunk packs it. Packed chunks go into a temporary file in
// their order, as the length of the JSON in front of them is known with the last; few wait for
// their turn, since few batches are on their way at a time.
class MeshoptSink : public NumberedSink {
 public:
  MeshoptSink(const std::string& path, const MeshFileOptions& options, std::uint64_t most_bytes)
      : NumberedSink(path, options), most_bytes_(most_bytes), packed_(path, "packed") {}

  void begin(const MeshFrame& frame) override {
    NumberedSink::begin(frame);
    lattice_ = PositionLattice::of(frame_);
  }

  void place(PlacedBatch& placed) override {
    NumberedSink::place(placed);
    const std::lock_guard lock(mutex_);
    if (filling_ == nullptr) filling_ = &chunks_[chunk_count_++];
    // Numbers within the whole mesh are of no use here.
    placed.first_byte = chunk_count_ - 1;
    placed.first_vertex = filling_->pieces.size();
    filling_->pieces.emplace_back();
    ++filling_->awaited;
    filling_->vertices += placed.batch.positions.size();
    if (filling_->vertices >= kChunkVertices) filling_ = nullptr;
  }

  void write(PlacedBatch& placed) override {
    MeshoptPiece piece = makePiece(placed);
    std::vector<MeshoptPiece> whole;
    {
      const std::lock_guard lock(mutex_);
      Chunk& chunk = chunks_.at(placed.first_byte);
      chunk.pieces[placed.first_vertex] = std::move(piece);
      if (--chunk.awaited > 0 || &chunk == filling_) return;
      whole = std::move(chunk.pieces);
    }
    pack(placed.first_byte, whole);
  }

  void finish() override {
    if (filling_ != nullptr) pack(chunk_count_ - 1, filling_->pieces);
    filling_ = nullptr;
    std::string json = makeJson();
    json.resize((json.size() + 3) & ~std::size_t{3}, ' ');
    if (glbHeaderBytes(json.size()) + packed_bytes_ > most_bytes_)
      throw glbTooLarge(file_.path(), false);
    const std::string header = glbHeader(json, json.size(), packed_bytes_);
    file_.write(header.data(), header.size());
    packed_.appendTo(file_, packed_bytes_, options_.cancel);
    file_.commit(options_.cancel);
  }

 private:
  static constexpr std::uint64_t kChunkVertices = 1 << 16;
  // Offsets in unpacked buffers are kept below the greatest number of 32 bits with a sign.
  static constexpr std::uint64_t kMostUnpackedBytes = std::uint64_t{1} << 31;

  struct Chunk {
    std::vector<MeshoptPiece> pieces;
    std::size_t awaited = 0;  // pieces that are not there yet
    std::uint64_t vertices = 0;
  };

  MeshoptPiece makePiece(PlacedBatch& placed) const {
    const MeshBatch& batch = placed.batch;
    findVertices(placed, true);
    MeshoptPiece piece;
    piece.positions.reserve(placed.world.size());
    for (const glm::dvec3& world : placed.world) piece.positions.push_back(lattice_.nearest(world));
    piece.normals.assign(batch.normals.begin(), batch.normals.end());
    const auto caps = batch.triangles.end() - static_cast<std::ptrdiff_t>(batch.cap_indices);
    piece.triangles.assign(batch.triangles.begin(), caps);
    piece.caps.assign(caps, batch.triangles.end());
    const std::size_t count = placed.world.size();
    for (std::size_t a = 0; a < attributes().size(); ++a) {
      std::vector<float>& values = piece.attributes.emplace_back();
      for (std::size_t i = 0; i < count; ++i) {
        const double value = valueOf(placed, a, i);
        values.push_back(std::isnan(value) ? 0 : static_cast<float>(value));  // NaN is forbidden
      }
    }
    for (std::size_t i = 0; options_.colors && i < count; ++i)
      piece.colors.push_back(gltfColor(colorOf(placed, i)));
    return piece;
  }

  void pack(std::uint64_t number, const std::vector<MeshoptPiece>& pieces) {
    PackedChunk packed = packChunk(pieces, lattice_);
    const std::lock_guard lock(mutex_);
    chunks_.erase(number);
    waiting_.emplace(number, std::move(packed));
    while (!waiting_.empty() && waiting_.begin()->first == written_) {
      append(waiting_.begin()->second);
      waiting_.erase(waiting_.begin());
      ++written_;
    }
  }

  void append(const PackedChunk& chunk) {
    if (packed_bytes_ + chunk.bytes.size() > most_bytes_) throw glbTooLarge(file_.path(), false);
    packed_.pwrite(chunk.bytes.data(), chunk.bytes.size(), packed_bytes_);
    describe(chunk);
    packed_bytes_ += chunk.bytes.size();
  }

  // Its primitive, accessors and views in the JSON.
  void describe(const PackedChunk& chunk) {
    std::uint64_t plain_bytes = 0;
    for (const auto& view : chunk.views) plain_bytes += view.count * view.stride;
    if (unpacked_bytes_.empty() || unpacked_bytes_.back() + plain_bytes > kMostUnpackedBytes)
      unpacked_bytes_.push_back(0);
    const auto accessor = [&](std::size_t view, const char* rest) {
      accessors_ += joined(accessor_count_ == 0 ? "" : ",", R"({"bufferView":)",
                           std::to_string(addView(chunk, view)), R"(,"count":)",
                           std::to_string(chunk.views[view].count), rest);
      return std::to_string(accessor_count_++);
    };
    std::string names =
        joined(R"("POSITION":)",
               accessor(PackedChunk::kPositions, R"(,"componentType":5126,"type":"VEC3")"));
    accessors_ +=
        joined(R"(,"min":)", arrayText(chunk.least), R"(,"max":)", arrayText(chunk.greatest), "}");
    names += joined(R"(,"NORMAL":)",
                    accessor(PackedChunk::kNormals,
                             R"(,"componentType":5122,"normalized":true,"type":"VEC3"})"));
    std::size_t view = PackedChunk::kAttributes;
    for (const VertexAttribute& attribute : attributes())
      names += joined(R"(,")", gltfAttribute(attribute.name), R"(":)",
                      accessor(view++, R"(,"componentType":5126,"type":"SCALAR"})"));
    if (options_.colors)
      names +=
          joined(R"(,"COLOR_0":)",
                 accessor(view++, R"(,"componentType":5123,"normalized":true,"type":"VEC4"})"));
    for (const auto& [kind, material] :
         {std::pair(chunk.triangles(), "0"), std::pair(chunk.caps(), "1")}) {
      if (chunk.views[kind].count == 0) continue;
      const std::string triangles = accessor(kind, R"(,"componentType":5125,"type":"SCALAR"})");
      primitives_ +=
          joined(primitives_.empty() ? "" : ",", R"({"attributes":{)", names, R"(},"indices":)",
                 triangles, R"(,"mode":4,"material":)", material, "}");
    }
  }

  std::size_t addView(const PackedChunk& chunk, std::size_t kind) {
    const PackedChunk::ViewSize& view = chunk.views[kind];
    constexpr const char* kModes[] = {R"("ATTRIBUTES","filter":"EXPONENTIAL")",
                                      R"("ATTRIBUTES","filter":"OCTAHEDRAL")", R"("ATTRIBUTES")"};
    const bool is_triangles = kind >= chunk.triangles();
    const std::string stride = joined(R"(,"byteStride":)", std::to_string(view.stride));
    std::uint64_t& unpacked = unpacked_bytes_.back();
    views_ += joined(
        view_count_ == 0 ? "" : ",", R"({"buffer":)", std::to_string(unpacked_bytes_.size()),
        R"(,"byteOffset":)", std::to_string(unpacked), R"(,"byteLength":)",
        std::to_string(view.count * view.stride), is_triangles ? "" : stride, R"(,"target":)",
        is_triangles ? "34963" : "34962", R"(,"extensions":{"EXT_meshopt_compression":{"buffer":0)",
        R"(,"byteOffset":)", std::to_string(packed_bytes_ + view.offset), R"(,"byteLength":)",
        std::to_string(view.bytes), stride, R"(,"count":)", std::to_string(view.count),
        R"(,"mode":)", is_triangles ? R"("TRIANGLES")" : kModes[std::min(kind, std::size_t{2})],
        "}}}");
    unpacked += view.count * view.stride;
    return view_count_++;
  }

  std::string makeJson() const {
    const std::string head = joined("{", gltfAsset(frame_));
    if (triangles_ == 0) return joined(head, R"(,"scene":0,"scenes":[{}]})");
    const char* const extensions = R"(["EXT_meshopt_compression","KHR_mesh_quantization"])";
    // Behind the packed buffer come those that readers unpack it to.
    std::string buffers = joined(R"([{"byteLength":)", std::to_string(packed_bytes_), "}");
    for (const std::uint64_t bytes : unpacked_bytes_)
      buffers += joined(R"(,{"byteLength":)", std::to_string(bytes),
                        R"(,"extensions":{"EXT_meshopt_compression":{"fallback":true}}})");
    return joined(head, R"(,"extensionsUsed":)", extensions, R"(,"extensionsRequired":)",
                  extensions, R"(,"scene":0,"scenes":[)", gltfNode(lattice_.center),
                  R"(,"meshes":[{"primitives":[)", primitives_, "]}],", gltfMaterials(frame_),
                  R"(,"accessors":[)", accessors_, R"(],"bufferViews":[)", views_,
                  R"(],"buffers":)", buffers, "]}");
  }

  const std::uint64_t most_bytes_;
  PositionLattice lattice_;
  std::mutex mutex_;                       // guards all below until finish()
  std::map<std::uint64_t, Chunk> chunks_;  // that are not packed yet, by number
  Chunk* filling_ = nullptr;               // takes the next batch
  std::uint64_t chunk_count_ = 0;
  std::map<std::uint64_t, PackedChunk> waiting_;  // for those before them
  std::uint64_t written_ = 0;                     // chunks
  SideFile packed_;
  std::uint64_t packed_bytes_ = 0;
  std::vector<std::uint64_t> unpacked_bytes_;  // of each buffer
  std::size_t accessor_count_ = 0, view_count_ = 0;
  std::string primitives_, accessors_, views_;
};

}  // namespace

std::unique_ptr<MeshFileSink> makeMeshoptSink(const std::string& path,
                                              const MeshFileOptions& options,
                                              std::uint64_t most_bytes) {
  return std::make_unique<MeshoptSink>(path, options, most_bytes);
}

}  // namespace isobrick
