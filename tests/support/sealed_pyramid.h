// Pyramids that lie: the parts of a good file taken apart, changed at will, and put together again
// with checksums that are right. Anybody can do that; a checksum only finds accidents.
//
//   PyramidDraft draft(readWholeFile("good.isb"));
//   draft.bricks[0].row.range_max = 1e30f;
//   Bytes lying = draft.seal();
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/format.h"

namespace isobrick::test {

using Bytes = std::vector<std::uint8_t>;

class PyramidDraft {
 public:
  struct Brick {
    int level = 0;
    Index3 index{0};
    BrickRow row{};
    std::array<Bytes, kPartKinds.size()> stored;  // by PartKind, as they lie in the file
  };
  using Elements = std::array<std::vector<std::byte>, kPartKinds.size()>;

  // `file` is a good pyramid.
  explicit PyramidDraft(const Bytes& file);

  format::Header header{};
  std::vector<format::LevelRow> levels;
  std::vector<Brick> bricks;   // in the order of the brick table
  Bytes histogram, gradients;  // as they are stored
  std::string provenance;

  const PyramidSpec& spec() const { return spec_; }
  const BrickLayout& layout() const { return layout_; }

  // The contents of a brick's parts, unpacked; constant ones written out.
  Elements elementsOf(const Brick& brick) const;
  // Packs them again, as the builder does; codecs, sizes and the constant follow.
  void setElements(Brick& brick, const Elements& elements, format::Codec codec) const;

  // The file: every part at a multiple of 64, all checksums right. Kinds of the header that the
  // program does not know have no bytes.
  Bytes seal() const;

 private:
  PyramidSpec spec_;
  BrickLayout layout_;
};

// Makes every checksum right for the bytes that the header and the tables point at, wherever that
// is in the file.
void sealChecksums(Bytes& file);

}  // namespace isobrick::test
