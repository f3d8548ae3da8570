// VTK PolyData in XML, its data appended.
#include <tbb/task_arena.h>
#include <zlib.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <string>
#include <vector>

#include "isobrick/extract/sinks/gltf_text.h"
#include "isobrick/extract/sinks/mesh_formats.h"
#include "isobrick/extract/sinks/numbered_sink.h"
#include "isobrick/extract/sinks/side_file.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/isolated_loop.h"

namespace isobrick {
namespace {

// Writes arrays behind each other as VTK has them, their sizes in 64 bits: as they are behind their
// size, or in blocks packed with zlib.
class ArrayAppender {
 public:
  ArrayAppender(AtomicFile& file, bool packed, const CancelFlag* cancel)
      : file_(file), packed_(packed), cancel_(cancel) {}

  // Calls fill(out, bytes, offset) for parts of the array, for packed ones from several threads.
  template <typename Fill>
  void append(std::uint64_t bytes, const Fill& fill) {
    if (packed_)
      appendPacked(bytes, fill);
    else
      appendPlain(bytes, fill);
  }

 private:
  // For an array; a multiple of all element sizes.
  static constexpr std::uint64_t kBlockBytes = std::uint64_t{1} << 18;

  template <typename Fill>
  void appendPlain(std::uint64_t bytes, const Fill& fill) {
    file_.write(&bytes, sizeof bytes);
    std::vector<std::byte> buffer(static_cast<std::size_t>(std::min(bytes, 4 * kBlockBytes)));
    for (std::uint64_t at = 0; at < bytes;) {
      if (cancel_ != nullptr) cancel_->check();
      const auto step = static_cast<std::size_t>(std::min(bytes - at, 4 * kBlockBytes));
      fill(buffer.data(), step, at);
      file_.write(buffer.data(), step);
      at += step;
    }
  }

  // Some blocks at a time, all threads side by side; their sizes, which come before them, last.
  template <typename Fill>
  void appendPacked(std::uint64_t bytes, const Fill& fill) {
    const std::uint64_t blocks = (bytes + kBlockBytes - 1) / kBlockBytes;
    std::vector<std::uint64_t> header = {blocks, kBlockBytes, bytes % kBlockBytes};
    header.resize(3 + static_cast<std::size_t>(blocks));
    const std::uint64_t header_at = file_.position();
    file_.continueFrom(header_at + header.size() * sizeof header[0]);
    std::vector<Block> batch(4 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()));
    for (std::uint64_t first = 0; first < blocks; first += batch.size()) {
      if (cancel_ != nullptr) cancel_->check();
      const auto count =
          static_cast<std::size_t>(std::min<std::uint64_t>(blocks - first, batch.size()));
      isolatedFor(std::size_t{0}, count, [&](std::size_t i) {
        const std::uint64_t at = (first + i) * kBlockBytes;
        const auto size = static_cast<std::size_t>(std::min(bytes - at, kBlockBytes));
        Block& block = batch[i];
        block.plain.resize(size);
        fill(block.plain.data(), size, at);
        block.pack();
      });
      for (std::size_t i = 0; i < count; ++i) {
        file_.write(batch[i].packed.data(), batch[i].packed.size());
        header[static_cast<std::size_t>(3 + first) + i] = batch[i].packed.size();
      }
    }
    file_.pwrite(header.data(), header.size() * sizeof header[0], header_at);
  }

  struct Block {
    std::vector<std::byte> plain, packed;
    void pack() {
      uLongf size = compressBound(plain.size());
      packed.resize(size);
      if (compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
                    reinterpret_cast<const Bytef*>(plain.data()), plain.size(),
                    Z_BEST_SPEED) != Z_OK)
        throw Error("zlib cannot pack a block of the mesh; write it without packing");
      packed.resize(size);
    }
  };

  AtomicFile& file_;
  const bool packed_;
  const CancelFlag* cancel_;
};

// Every property is an array of its own, and arrays come one behind the other: positions first,
// which go straight to their place if they are not packed; the others wait in files of their own.
class VtpSink : public NumberedSink {
 public:
  VtpSink(const std::string& path, const MeshFileOptions& options, std::uint64_t most_narrow)
      : NumberedSink(path, options),
        most_narrow_(most_narrow),
        header_bytes_(2048 + extraBytes(192)),
        positions_(path, "points"),
        normals_(path, "normals"),
        corners_(path, "corners"),
        levels_(path, "levels"),
        cap_marks_(path, "caps") {
    for (std::size_t a = 0; a < attributes().size(); ++a) values_.emplace_back(path, "values");
  }

  void write(PlacedBatch& placed) override {
    writeVertices(placed);
    writeTriangles(placed);
  }
  void finish() override {
    file_.continueFrom(header_bytes_);
    Offsets offsets;
    ArrayAppender appender(file_, options_.zlib, options_.cancel);
    const auto append = [&](std::uint64_t& offset, std::uint64_t bytes, const auto& fill) {
      offset = file_.position() - header_bytes_;
      appender.append(bytes, fill);
    };
    const auto from = [](const SideFile& side) {
      return [&side](std::byte* out, std::size_t bytes, std::uint64_t at) {
        side.read(out, bytes, at);
      };
    };
    const std::uint64_t position_bytes = vertices() * positionBytes();
    if (options_.zlib) {
      append(offsets.positions, position_bytes, from(positions_));
    } else {
      file_.write(&position_bytes, sizeof position_bytes);
      file_.continueFrom(file_.position() + position_bytes);
    }
    append(offsets.normals, vertices() * kNormalBytes, from(normals_));
    for (std::size_t a = 0; a < attributes().size(); ++a)
      append(offsets.values.emplace_back(), vertices() * infoOf(attributes()[a].type).bytes,
             from(values_[a]));
    appendCells(offsets, append);
    append(offsets.levels, triangles_, from(levels_));
    if (frame_.has_caps) append(offsets.caps, triangles_, from(cap_marks_));
    constexpr std::string_view kEnd = "\n</AppendedData>\n</VTKFile>\n";
    file_.write(kEnd.data(), kEnd.size());
    publish(makeHeader(offsets));
  }

 private:
  static constexpr std::size_t kNormalBytes = 12;
  static constexpr std::size_t kCornersBytes = 12;  // of a triangle

  // For arrays, in the appended data.
  struct Offsets {
    std::uint64_t positions = 0, normals = 0, corners = 0, ends = 0, levels = 0, caps = 0;
    std::vector<std::uint64_t> values;  // of each attribute
  };

  std::size_t positionBytes() const { return double_precision_ ? 24 : 12; }
  // Readers take connectivity and offsets of one signed type.
  bool hasWideIndices() const { return vertices() > most_narrow_ || 3 * triangles_ > most_narrow_; }

  void writeVertices(PlacedBatch& placed) {
    if (newVertices(placed) == 0) return;
    findVertices(placed);
    placed.bytes.resize(placed.world.size() * positionBytes());
    BytePointer to(placed.bytes.data());
    for (const glm::dvec3& p : placed.world) putPosition(to, p);
    const std::uint64_t at = placed.first_vertex * positionBytes();
    if (options_.zlib)
      positions_.pwrite(placed.bytes.data(), placed.bytes.size(), at);
    else
      file_.pwrite(placed.bytes.data(), placed.bytes.size(),
                   header_bytes_ + sizeof(std::uint64_t) + at);

    placed.bytes.resize(placed.world.size() * kNormalBytes);
    BytePointer normals(placed.bytes.data());
    forEachNew(placed, [&](std::size_t v) {
      const glm::vec3& n = placed.batch.normals[v];
      normals.put(n.x, n.y, n.z);
    });
    normals_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_vertex * kNormalBytes);
    for (std::size_t a = 0; a < attributes().size(); ++a) {
      const std::size_t bytes = infoOf(attributes()[a].type).bytes;
      placed.bytes.resize(placed.world.size() * bytes);
      BytePointer values(placed.bytes.data());
      for (std::size_t i = 0; i < placed.world.size(); ++i)
        putValue(values, attributes()[a], valueOf(placed, a, i));
      values_[a].pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_vertex * bytes);
    }
  }

  void writeTriangles(PlacedBatch& placed) {
    const MeshBatch& batch = placed.batch;
    findCorners(placed);
    corners_.pwrite(placed.bytes.data(), placed.bytes.size(),
                    placed.first_triangle * kCornersBytes);
    placed.bytes.assign(batch.triangles.size() / 3, static_cast<std::byte>(batch.level));
    levels_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_triangle);
    if (!frame_.has_caps) return;
    placed.bytes.assign(firstCapIndex(batch) / 3, std::byte{0});
    placed.bytes.resize(batch.triangles.size() / 3, std::byte{1});
    cap_marks_.pwrite(placed.bytes.data(), placed.bytes.size(), placed.first_triangle);
  }

  // Connectivity, and the end of each cell in it.
  template <typename Append>
  void appendCells(Offsets& offsets, const Append& append) {
    if (!hasWideIndices()) {
      append(offsets.corners, triangles_ * kCornersBytes,
             [&](std::byte* out, std::size_t bytes, std::uint64_t at) {
               corners_.read(out, bytes, at);
             });
      append(offsets.ends, triangles_ * sizeof(std::int32_t), fillEnds<std::int32_t>);
      return;
    }
    append(offsets.corners, 2 * triangles_ * kCornersBytes,
           [&](std::byte* out, std::size_t bytes, std::uint64_t at) {
             std::vector<std::uint32_t> narrow(bytes / sizeof(std::int64_t));
             corners_.read(narrow.data(), bytes / 2, at / 2);
             BytePointer to(out);
             for (const std::uint32_t corner : narrow) to.put(std::int64_t{corner});
           });
    append(offsets.ends, triangles_ * sizeof(std::int64_t), fillEnds<std::int64_t>);
  }
  template <typename Index>
  static void fillEnds(std::byte* out, std::size_t bytes, std::uint64_t at) {
    BytePointer to(out);
    for (std::uint64_t t = at / sizeof(Index); t < (at + bytes) / sizeof(Index); ++t)
      to.put(static_cast<Index>(3 * (t + 1)));
  }

  // Always header_bytes_ long, up to the mark that the appended data begin behind.
  std::string makeHeader(const Offsets& offsets) const {
    const std::string real = double_precision_ ? "Float64" : "Float32";
    const std::string index = hasWideIndices() ? "Int64" : "Int32";
    const auto array = [](std::string_view type, std::string_view name, int components,
                          std::uint64_t offset) {
      return joined("<DataArray type=\"", type, "\" Name=\"", name, "\" NumberOfComponents=\"",
                    std::to_string(components), "\" format=\"appended\" offset=\"",
                    std::to_string(offset), "\"/>\n");
    };
    std::string values;
    for (std::size_t a = 0; a < attributes().size(); ++a)
      values += array(infoOf(attributes()[a].type).vtk, attributes()[a].name, 1, offsets.values[a]);
    std::string head =
        "<?xml version=\"1.0\"?>\n<!-- written by isobrick; world coordinates are " +
        spaceText(frame_) + ", their unit is " + unitText(frame_) + shiftLine(", shifted by ", "") +
        " -->\n<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\"" +
        (options_.zlib ? " compressor=\"vtkZLibDataCompressor\"" : "") +
        ">\n<PolyData>\n<Piece NumberOfPoints=\"" + std::to_string(vertices()) +
        "\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"" +
        std::to_string(triangles_) + "\">\n<PointData Normals=\"Normals\"" +
        (attributes().empty() ? "" : " Scalars=\"" + attributes().front().name + "\"") + ">\n" +
        array("Float32", "Normals", 3, offsets.normals) + values + "</PointData>\n<CellData>\n" +
        array("UInt8", "level", 1, offsets.levels) +
        (frame_.has_caps ? array("UInt8", "cap", 1, offsets.caps) : "") +
        "</CellData>\n<Points>\n" + array(real, "Points", 3, offsets.positions) +
        "</Points>\n<Polys>\n" + array(index, "connectivity", 1, offsets.corners) +
        array(index, "offsets", 1, offsets.ends) + "</Polys>\n</Piece>\n</PolyData>\n";
    const std::string tail = "<AppendedData encoding=\"raw\">\n_";
    head.resize(header_bytes_ - tail.size() - 1, ' ');
    return head + "\n" + tail;
  }

  const std::uint64_t most_narrow_;
  const std::size_t header_bytes_;
  SideFile positions_, normals_, corners_, levels_, cap_marks_;
  std::deque<SideFile> values_;  // of each attribute
};

}  // namespace

std::unique_ptr<MeshFileSink> makeVtpSink(const std::string& path, const MeshFileOptions& options) {
  return makeVtpSink(path, options, std::numeric_limits<std::int32_t>::max());
}

std::unique_ptr<MeshFileSink> makeVtpSink(const std::string& path, const MeshFileOptions& options,
                                          std::uint64_t most_narrow) {
  return std::make_unique<VtpSink>(path, options, most_narrow);
}

}  // namespace isobrick
