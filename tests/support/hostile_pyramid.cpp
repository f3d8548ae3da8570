#include "tests/support/hostile_pyramid.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <iterator>
#include <limits>

namespace isobrick::test {
namespace {

bool oneIn(Random& random, std::uint64_t n) { return randomBelow(random, n) == 0; }

std::uint64_t nastyNumber(Random& random) {
  constexpr std::uint64_t kMost = ~std::uint64_t{0};
  switch (randomBelow(random, 6)) {
    case 0:
      return randomBelow(random, 300);
    case 1:
      return std::uint64_t{1} << randomBelow(random, 64);
    case 2:
      return (std::uint64_t{1} << randomBelow(random, 64)) - 1;
    case 3:
      return 64 * randomBelow(random, 200);
    case 4:
      return kMost - randomBelow(random, 128);
    default:
      return random();
  }
}

double nastyDouble(Random& random) {
  constexpr double kNumbers[] = {0.0,  -0.0, 1.0, -1.0, 1e-300, 1e300, 1e-30,  1e30,    -1e30,
                                 1e-9, 1e9,  0.5, 2.0,  1e38,   1e-45, 0x1p99, 0x1p-99, 0x1p101};
  if (oneIn(random, 4)) return std::bit_cast<double>(random());
  return kNumbers[randomBelow(random, std::size(kNumbers))];
}

template <typename T>
T nastyValue(Random& random) {
  if constexpr (std::is_floating_point_v<T>) {
    return nastyFloat(random);
  } else {
    if (oneIn(random, 3)) return std::numeric_limits<T>::max();
    if (oneIn(random, 3)) return std::numeric_limits<T>::lowest();
    return static_cast<T>(random());
  }
}

// A reference into the draft for each kind of change.
class Mutation {
 public:
  Mutation(PyramidDraft& draft, Random& random) : draft_(draft), random_(random) {}

  const char* change() {
    switch (randomBelow(random_, 21)) {
      case 0:
        return changeHeader();
      case 1:
      case 2:
        return changePlacement();
      case 3:
        return changeRow();
      case 4:
        return changeProvenance();
      case 5:
      case 6:
      case 7:
        return changePackedBytes();
      case 8:
      case 9:
      case 10:
      case 11:
        return changeSamples();
      case 12:
      case 13:
      case 14:
      case 15:
        return changeTileRanges();
      case 16:
        return changeCurvature();
      case 17:
        return changeBrickRanges();
      case 18:
        return exchangeParts();
      case 19:
        return oneIn(random_, 2) ? changeCounts(draft_.histogram, draft_.header.histogram)
                                 : changeCounts(draft_.gradients, draft_.header.gradients);
      default:
        return makeConstant();
    }
  }

 private:
  PyramidDraft::Brick& anyBrick() {
    return draft_.bricks[randomBelow(random_, draft_.bricks.size())];
  }
  format::Codec anyCodec() {
    constexpr format::Codec kCodecs[] = {format::Codec::kStored, format::Codec::kLz4,
                                         format::Codec::kZstd};
    return kCodecs[randomBelow(random_, 3)];
  }

  const char* changeHeader() {
    format::Header& header = draft_.header;
    std::uint32_t* const words[] = {
        &header.version,     &header.header_bytes,
        &header.voxel_type,  &header.filter,
        &header.level_count, &header.brick_cells,
        &header.tile_cells,  &header.kind_count,
        &header.length_unit, &header.kinds[randomBelow(random_, format::kMostKinds)]};
    if (oneIn(random_, 2)) {
      *words[randomBelow(random_, std::size(words))] =
          static_cast<std::uint32_t>(nastyNumber(random_));
    } else if (oneIn(random_, 2)) {
      header.dims[randomBelow(random_, 3)] = nastyNumber(random_);
    } else {
      header.reserved[randomBelow(random_, sizeof header.reserved)] = 1;
    }
    return "header";
  }
  // Changes that leave the file without contradiction.
  const char* changePlacement() {
    format::Header& header = draft_.header;
    double* const numbers[] = {
        &header.spacing[0],   &header.spacing[1],   &header.spacing[2],        &header.origin[0],
        &header.origin[1],    &header.origin[2],    &header.direction[0],      &header.direction[4],
        &header.direction[8], &header.direction[1], &header.curvature_epsilon, &header.value_min,
        &header.value_max,    &header.noise};
    double& number = *numbers[randomBelow(random_, std::size(numbers))];
    number = nastyDouble(random_);
    // A value that no voxel has is refused at once.
    if ((&number == &header.value_min || &number == &header.value_max) && !oneIn(random_, 4))
      visitVoxelType(draft_.spec().voxel_type, [&](auto tag) {
        number = static_cast<double>(nastyValue<typename decltype(tag)::Type>(random_));
      });
    return "placement";
  }
  const char* changeRow() {
    if (oneIn(random_, 4)) {
      auto& level = draft_.levels[randomBelow(random_, draft_.levels.size())];
      std::uint64_t numbers[7];
      std::memcpy(numbers, &level, sizeof level);
      numbers[randomBelow(random_, 7)] = nastyNumber(random_);
      std::memcpy(&level, numbers, sizeof level);
      return "level table";
    }
    BrickRow& row = anyBrick().row;
    auto* const bytes = reinterpret_cast<std::byte*>(&row);
    const auto number = static_cast<std::uint32_t>(nastyNumber(random_));
    std::memcpy(bytes + 4 * randomBelow(random_, sizeof row / 4), &number, 4);
    return "brick table";
  }
  const char* changeCounts(Bytes& counts, format::PartEntry& part) {
    if (oneIn(random_, 3)) counts.resize(randomBelow(random_, 2 * counts.size() + 1));
    for (std::uint8_t& byte : counts)
      if (oneIn(random_, 8)) byte = static_cast<std::uint8_t>(random_());
    if (oneIn(random_, 2)) part.codec = static_cast<std::uint32_t>(randomBelow(random_, 6));
    return "histogram or gradients";
  }
  const char* changeProvenance() {
    std::string& text = draft_.provenance;
    switch (randomBelow(random_, 4)) {
      case 0:
        text = std::string(randomBelow(random_, 100000), '[');
        break;
      case 1:
        text.clear();
        break;
      case 2:
        text += std::string(3, '\0') + "\xff\xfe\n";
        break;
      default:
        for (char& c : text)
          if (oneIn(random_, 20)) c = static_cast<char>(random_());
    }
    return "provenance";
  }

  const char* changePackedBytes() {
    for (int tries = 0; tries < 20; ++tries) {
      Bytes& stored = anyBrick().stored[randomBelow(random_, 3)];
      if (stored.empty()) continue;
      for (std::uint64_t edits = 1 + randomBelow(random_, 4); edits > 0; --edits) {
        // The header, the table of blocks and the first sizes; or anywhere.
        const std::uint64_t reach =
            oneIn(random_, 2) ? std::min<std::uint64_t>(stored.size(), 32) : stored.size();
        const std::uint64_t at = randomBelow(random_, reach);
        if (oneIn(random_, 3) && at + 4 <= stored.size()) {
          const auto number = static_cast<std::uint32_t>(nastyNumber(random_));
          std::memcpy(stored.data() + at, &number, 4);
        } else {
          stored[at] = static_cast<std::uint8_t>(random_());
        }
      }
      return "packed bytes";
    }
    return "nothing";
  }

  template <typename F>
  void changeElements(F&& change_brick) {
    const std::uint64_t share = 1 + randomBelow(random_, 4);
    for (PyramidDraft::Brick& brick : draft_.bricks) {
      if (!oneIn(random_, share)) continue;
      if (!isWhole(brick)) continue;
      PyramidDraft::Elements elements = draft_.elementsOf(brick);
      visitVoxelType(draft_.spec().voxel_type, [&](auto tag) {
        using T = typename decltype(tag)::Type;
        change_brick(elements, T{});
      });
      draft_.setElements(brick, elements, anyCodec());
    }
  }
  // An earlier change may have left nothing to unpack.
  bool isWhole(const PyramidDraft::Brick& brick) const {
    try {
      return isPossibleRow(brick.row, draft_.spec(), draft_.layout(), brick.level, brick.index) &&
             draft_.elementsOf(brick)[0].size() > 0;
    } catch (const std::exception&) {
      return false;
    }
  }

  const char* changeSamples() {
    const std::uint64_t every = std::uint64_t{1} << randomBelow(random_, 7);
    const bool random_bytes = oneIn(random_, 3);
    changeElements([&](PyramidDraft::Elements& elements, auto zero) {
      using T = decltype(zero);
      for (std::size_t at = 0; at < elements[0].size(); at += sizeof(T)) {
        if (!oneIn(random_, every)) continue;
        const T value = random_bytes ? static_cast<T>(random_() % 256) : nastyValue<T>(random_);
        std::memcpy(elements[0].data() + at, &value, sizeof value);
      }
    });
    if (oneIn(random_, 2)) widenBrickRanges();
    return "samples";
  }

  const char* changeTileRanges() {
    const std::uint64_t every = std::uint64_t{1} << randomBelow(random_, 5);
    const std::uint64_t way = randomBelow(random_, 5);
    changeElements([&](PyramidDraft::Elements& elements, auto zero) {
      using T = decltype(zero);
      T range[2];
      for (std::size_t at = 0; at < elements[1].size(); at += sizeof range) {
        if (!oneIn(random_, every)) continue;
        std::memcpy(range, elements[1].data() + at, sizeof range);
        if (way == 0) range[1] = range[0];  // narrow
        if (way == 1) std::swap(range[0], range[1]);
        if (way == 2) {
          range[0] = std::numeric_limits<T>::lowest();
          range[1] = std::numeric_limits<T>::max();
        }
        if (way == 3) range[randomBelow(random_, 2)] = nastyValue<T>(random_);
        if (way == 4) range[0] = range[1];
        std::memcpy(elements[1].data() + at, range, sizeof range);
      }
    });
    return "tile ranges";
  }

  const char* changeCurvature() {
    const std::uint64_t every = std::uint64_t{1} << randomBelow(random_, 5);
    changeElements([&](PyramidDraft::Elements& elements, auto) {
      for (std::byte& code : elements[2])
        if (oneIn(random_, every)) code = static_cast<std::byte>(random_());
    });
    return "curvature";
  }

  void widenBrickRanges() {
    constexpr float kMost = std::numeric_limits<float>::max();
    for (PyramidDraft::Brick& brick : draft_.bricks)
      brick.row.range_min = -kMost, brick.row.range_max = kMost;
  }
  const char* changeBrickRanges() {
    if (oneIn(random_, 2)) {
      widenBrickRanges();
      return "brick ranges";
    }
    auto& row = anyBrick().row;
    (oneIn(random_, 2) ? row.range_min : row.range_max) = nastyFloat(random_);
    return "brick ranges";
  }

  // Samples of one brick for those of another, where they take the same bytes.
  const char* exchangeParts() {
    const std::size_t part = randomBelow(random_, 3);
    PyramidDraft::Brick& a = anyBrick();
    PyramidDraft::Brick& b = anyBrick();
    if (a.stored[part].size() == b.stored[part].size()) std::swap(a.stored[part], b.stored[part]);
    return "exchanged parts";
  }

  const char* makeConstant() {
    PyramidDraft::Brick& brick = anyBrick();
    brick.stored[0].clear();
    brick.row.part(PartKind::kSamples) = {0, 0, 0,
                                          static_cast<std::uint32_t>(format::Codec::kConstant)};
    brick.row.constant = oneIn(random_, 2) ? brick.row.range_min : nastyFloat(random_);
    return "constant";
  }

  PyramidDraft& draft_;
  Random& random_;
};

// Where the tables say that things are, and how many; and the file's length.
const char* changeFile(Bytes& file, Random& random) {
  format::Header header;
  std::memcpy(&header, file.data(), sizeof header);
  const auto put = [&] { std::memcpy(file.data(), &header, sizeof header); };
  const std::uint32_t kinds = std::clamp(header.kind_count, 1u, format::kMostKinds);
  const std::uint64_t row_bytes = format::rowBytes(kinds);
  switch (randomBelow(random, 4)) {
    case 0: {
      std::uint64_t* const fields[] = {&header.level_table_offset, &header.brick_table_offset,
                                       &header.brick_count,        &header.provenance_offset,
                                       &header.provenance_bytes,   &header.histogram.offset,
                                       &header.gradients.offset};
      *fields[randomBelow(random, std::size(fields))] = nastyNumber(random);
      put();
      return "places of tables";
    }
    case 1: {
      const std::uint64_t row =
          header.brick_table_offset + row_bytes * randomBelow(random, header.brick_count);
      auto* const bytes =
          file.data() + row + sizeof(format::PartEntry) * randomBelow(random, kinds);
      format::PartEntry part;
      std::memcpy(&part, bytes, sizeof part);
      if (oneIn(random, 3))
        part.offset = nastyNumber(random);
      else if (oneIn(random, 2))
        part.offset = 64 * randomBelow(random, file.size() / 64 + 1);  // another's bytes
      else if (oneIn(random, 2))
        part.stored_bytes = static_cast<std::uint32_t>(nastyNumber(random));
      else
        part.codec = static_cast<std::uint32_t>(randomBelow(random, 6));
      std::memcpy(bytes, &part, sizeof part);
      return "places of parts";
    }
    case 2:
      file.resize(oneIn(random, 2)
                      ? file.size() + 1 + randomBelow(random, 5000)
                      : file.size() - randomBelow(random, file.size() - sizeof header));
      header.file_bytes = file.size();
      put();
      return "length";
    default:
      for (int edits = 0; edits < 5; ++edits)
        file[sizeof header + randomBelow(random, file.size() - sizeof header)] ^= 1;
      return "any bytes";
  }
}

}  // namespace

float nastyFloat(Random& random) {
  using Limits = std::numeric_limits<float>;
  constexpr float kNumbers[] = {0.0f,
                                -0.0f,
                                1.0f,
                                -1.0f,
                                50.0f,
                                255.0f,
                                Limits::quiet_NaN(),
                                Limits::infinity(),
                                -Limits::infinity(),
                                Limits::max(),
                                Limits::lowest(),
                                Limits::denorm_min(),
                                -Limits::denorm_min(),
                                Limits::min(),
                                Limits::epsilon()};
  if (oneIn(random, 5)) return std::bit_cast<float>(static_cast<std::uint32_t>(random()));
  return kNumbers[randomBelow(random, std::size(kNumbers))];
}

Bytes makeHostilePyramid(const Bytes& good, Random& random, std::string& what) {
  PyramidDraft draft(good);
  Mutation mutation(draft, random);
  what.clear();
  for (std::uint64_t changes = 1 + randomBelow(random, 3); changes > 0; --changes)
    what += std::string(mutation.change()) + "; ";
  Bytes file = draft.seal();
  if (oneIn(random, 5)) what += changeFile(file, random);
  sealChecksums(file);
  return file;
}

}  // namespace isobrick::test
