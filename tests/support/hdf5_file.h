// HDF5 files for tests, without HDF5's headers.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace isobrick::test {

struct Hdf5TestLayout {
  std::vector<std::uint64_t> chunk = {};  // empty: in one piece
  bool has_checksum = false;              // of each chunk, by Fletcher
  std::optional<int> filter = {};         // then the bytes are those of the only chunk, as packed
  std::vector<unsigned> filter_values = {};  // its parameters
  std::string raw_file = {};                 // that has the bytes, outside of HDF5
};

// A new file, written when it goes out of scope. Names are paths in it; groups on the way are made.
class Hdf5TestFile {
 public:
  explicit Hdf5TestFile(const std::string& path);
  ~Hdf5TestFile();
  Hdf5TestFile(const Hdf5TestFile&) = delete;
  Hdf5TestFile& operator=(const Hdf5TestFile&) = delete;

  // `type` as in numpy: "u1", "i2", "f4", ">u2".
  void dataset(const std::string& name, const std::vector<std::uint64_t>& dims,
               const std::string& type, const std::string& bytes,
               const Hdf5TestLayout& layout = {});
  // Takes all its voxels from another dataset of the same size.
  void virtualDataset(const std::string& name, const std::vector<std::uint64_t>& dims,
                      const std::string& type, const std::string& file, const std::string& dataset);
  void group(const std::string& name);
  void externalLink(const std::string& name, const std::string& file, const std::string& target);

  void text(const std::string& object, const std::string& attribute, const std::string& value);
  // As Imaris writes it: characters of their own.
  void letters(const std::string& object, const std::string& attribute, const std::string& value);
  void numbers(const std::string& object, const std::string& attribute,
               const std::vector<double>& values, const std::vector<std::uint64_t>& dims = {});
  // Makes datasets the scales of another one's axes, "" for none.
  void scales(const std::string& object, const std::vector<std::string>& datasets);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace isobrick::test
