#include "isobrick/extract/sinks/mesh_file_sink.h"

#include <fcntl.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Bytes gathered before they are written.
constexpr std::size_t kBufferBytes = std::size_t{1} << 20;

// Appends plain values to a byte buffer.
class ByteBuffer {
 public:
  template <typename... Values>
  void put(Values... values) {
    (putOne(values), ...);
  }
  bool isFull() const { return bytes_.size() >= kBufferBytes; }
  const std::vector<std::byte>& bytes() const { return bytes_; }
  void clear() { bytes_.clear(); }

 private:
  template <typename V>
  void putOne(V value) {
    const auto* from = reinterpret_cast<const std::byte*>(&value);
    bytes_.insert(bytes_.end(), from, from + sizeof value);
  }
  std::vector<std::byte> bytes_;
};

// A PLY file needs all vertices before the first face, so faces wait in a second file, which has
// gone from its folder by the time it is written and vanishes with the process.
class FaceFile {
 public:
  explicit FaceFile(const std::string& mesh_path) : path_(mesh_path + ".faces.XXXXXX") {
    fd_ = ::mkostemp(path_.data(), O_CLOEXEC);  // a name that nobody else has
    if (fd_ < 0) fail();
    ::unlink(path_.c_str());
  }
  ~FaceFile() { ::close(fd_); }
  FaceFile(const FaceFile&) = delete;
  FaceFile& operator=(const FaceFile&) = delete;

  void write(const std::vector<std::byte>& bytes) {
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t n = ::write(fd_, bytes.data() + done, bytes.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail();
      done += static_cast<std::size_t>(n);
    }
  }
  void appendTo(AtomicFile& file, const CancelFlag* cancel) {
    std::vector<std::byte> buffer(kBufferBytes);
    for (off_t at = 0;;) {
      if (cancel != nullptr) cancel->check();
      const ssize_t n = ::pread(fd_, buffer.data(), buffer.size(), at);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail();
      if (n == 0) return;
      file.write(buffer.data(), static_cast<std::size_t>(n));
      at += n;
    }
  }

 private:
  [[noreturn]] void fail() const {
    throw Error("cannot write '" + path_ + "': " + std::strerror(errno) +
                    "; free some space or choose another folder with -o",
                {.path = path_});
  }
  std::string path_;
  int fd_ = -1;
};

class PlySink : public MeshFileSink {
 public:
  PlySink(const std::string& path, const CancelFlag* cancel)
      : cancel_(cancel), file_(path), faces_(path) {}

  void begin(const MeshFrame& frame) override {
    double_precision_ = frame.coordinateMagnitudeInVoxels() >= 2048;
    const std::string blank(kHeaderBytes, ' ');
    file_.write(blank.data(), blank.size());
  }

  void accept(const MeshBatch& batch) override {
    numbering_.number(batch, numbers_, is_new_);
    if (numbering_.count() > std::numeric_limits<std::uint32_t>::max())
      throw Error("'" + file_.path() +
                      "': a PLY file holds at most 4,294,967,295 vertices; extract a part of the "
                      "surface or a coarser level",
                  {.path = file_.path()});
    for (std::size_t v = 0; v < numbers_.size(); ++v) {
      if (!is_new_[v]) continue;
      const glm::dvec3& p = batch.positions[v];
      const glm::vec3& n = batch.normals[v];
      if (double_precision_)
        vertex_bytes_.put(p.x, p.y, p.z, n.x, n.y, n.z);
      else
        vertex_bytes_.put(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z),
                          n.x, n.y, n.z);
      if (vertex_bytes_.isFull()) flushVertices();
    }
    for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
      face_bytes_.put(std::uint8_t{3}, static_cast<std::uint32_t>(numbers_[batch.triangles[i]]),
                      static_cast<std::uint32_t>(numbers_[batch.triangles[i + 1]]),
                      static_cast<std::uint32_t>(numbers_[batch.triangles[i + 2]]),
                      static_cast<std::uint8_t>(batch.level));
      if (face_bytes_.isFull()) flushFaces();
    }
    triangles_ += batch.triangles.size() / 3;
  }

  void finish() override {
    flushVertices();
    flushFaces();
    faces_.appendTo(file_, cancel_);
    const std::string header = makeHeader();
    file_.pwrite(header.data(), header.size(), 0);
    file_.commit(cancel_);
  }

  std::uint64_t vertices() const override { return numbering_.count(); }

 private:
  static constexpr std::size_t kHeaderBytes = 512;

  void flushVertices() {
    file_.write(vertex_bytes_.bytes().data(), vertex_bytes_.bytes().size());
    vertex_bytes_.clear();
  }
  void flushFaces() {
    faces_.write(face_bytes_.bytes());
    face_bytes_.clear();
  }

  // Always kHeaderBytes long: a comment fills what the counts leave.
  std::string makeHeader() const {
    const std::string real = double_precision_ ? "double" : "float";
    std::string head = "ply\nformat binary_little_endian 1.0\ncomment isobrick\n";
    std::string rest = "element vertex " + std::to_string(numbering_.count()) + "\n";
    for (const char* name : {"x", "y", "z"}) rest += "property " + real + " " + name + "\n";
    for (const char* name : {"nx", "ny", "nz"})
      rest += std::string("property float ") + name + "\n";
    rest += "element face " + std::to_string(triangles_) +
            "\nproperty list uchar uint vertex_indices\nproperty uchar level\nend_header\n";
    const std::string prefix = "comment ";
    const std::size_t fill = kHeaderBytes - head.size() - rest.size() - prefix.size() - 1;
    return head + prefix + std::string(fill, '.') + "\n" + rest;
  }

  const CancelFlag* cancel_;
  AtomicFile file_;
  FaceFile faces_;
  bool double_precision_ = false;
  VertexNumbering numbering_;
  std::vector<std::uint64_t> numbers_;
  std::vector<bool> is_new_;
  ByteBuffer vertex_bytes_, face_bytes_;
  std::uint64_t triangles_ = 0;
};

class StlSink : public MeshFileSink {
 public:
  StlSink(const std::string& path, const CancelFlag* cancel) : cancel_(cancel), file_(path) {}

  void begin(const MeshFrame&) override {
    char header[84] = "isobrick";  // must not begin with "solid": that is how ASCII STL is told
    file_.write(header, sizeof header);
  }
  void accept(const MeshBatch& batch) override {
    triangles_ += batch.triangles.size() / 3;
    if (triangles_ > std::numeric_limits<std::uint32_t>::max())
      throw Error("'" + file_.path() +
                      "': an STL file holds at most 4,294,967,295 triangles; write .ply instead",
                  {.path = file_.path()});
    for (std::size_t i = 0; i < batch.triangles.size(); i += 3) {
      const glm::dvec3& a = batch.positions[batch.triangles[i]];
      const glm::dvec3& b = batch.positions[batch.triangles[i + 1]];
      const glm::dvec3& c = batch.positions[batch.triangles[i + 2]];
      // A triangle without an area has no normal, and zeros say so.
      const glm::dvec3 across = glm::cross(b - a, c - a);
      put(glm::dot(across, across) > 0 ? glm::vec3(glm::normalize(across)) : glm::vec3(0.0f));
      put(glm::vec3(a));
      put(glm::vec3(b));
      put(glm::vec3(c));
      bytes_.put(std::uint16_t{0});
      if (bytes_.isFull()) flush();
    }
  }
  void finish() override {
    flush();
    const auto count = static_cast<std::uint32_t>(triangles_);
    file_.pwrite(&count, sizeof count, 80);
    file_.commit(cancel_);
  }
  std::uint64_t vertices() const override { return 3 * triangles_; }

 private:
  void put(const glm::vec3& v) { bytes_.put(v.x, v.y, v.z); }
  void flush() {
    file_.write(bytes_.bytes().data(), bytes_.bytes().size());
    bytes_.clear();
  }

  const CancelFlag* cancel_;
  AtomicFile file_;
  ByteBuffer bytes_;
  std::uint64_t triangles_ = 0;
};

}  // namespace

std::unique_ptr<MeshFileSink> makeMeshFileSink(const std::string& path, const CancelFlag* cancel) {
  std::string end = path.size() > 4 ? path.substr(path.size() - 4) : "";
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (end == ".ply") return std::make_unique<PlySink>(path, cancel);
  if (end == ".stl") return std::make_unique<StlSink>(path, cancel);
  throw Error("cannot tell the mesh format of '" + path + "'; name it .ply or .stl",
              {.path = path});
}

}  // namespace isobrick
