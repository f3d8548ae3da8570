#include "isobrick/storage/brick_index.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"

namespace isobrick {

BrickIndex::BrickIndex(const PagedFile& file, const PyramidSpec& spec, const format::Header& header)
    : file_(file),
      spec_(spec),
      layout_(spec.layout()),
      offset_(header.brick_table_offset),
      row_bytes_(format::rowBytes(header.kind_count)),
      kinds_(header.kinds, header.kinds + header.kind_count),
      rows_(layout_) {
  if (header.brick_count != count() || count() > file.size() / row_bytes_)
    throw Error("'" + file.path() + "' has a wrong number of bricks; build it again",
                {.path = file.path()});
  if (!file.holds(offset_, count() * row_bytes_))
    throw Error("'" + file.path() + "' has a damaged brick table; build it again",
                {.path = file.path()});
  slot_count_ = std::min(kMostSlots, (count() + kRowsAtATime - 1) / kRowsAtATime);
  slots_ = std::make_unique<Slot[]>(slot_count_);
  if (count() * row_bytes_ <= kReadAtOnceBytes)
    for (std::size_t piece = 0; piece < slot_count_; ++piece) load(slots_[piece], piece);
}

std::vector<ByteRange> BrickIndex::rangesReadAtOnce(const format::Header& header) {
  std::vector<ByteRange> ranges;
  const std::uint64_t row_bytes = format::rowBytes(header.kind_count);
  if (header.brick_count > kReadAtOnceBytes / row_bytes) return ranges;
  for (std::uint64_t first = 0; first < header.brick_count; first += kRowsAtATime)
    ranges.push_back(
        {header.brick_table_offset + first * row_bytes,
         std::min<std::uint64_t>(kRowsAtATime, header.brick_count - first) * row_bytes});
  return ranges;
}

BrickRow BrickIndex::row(std::size_t number) const {
  BrickRow row;
  withRow(number, [&](const std::byte* bytes) { row = decode(bytes); });
  return row;
}

BrickIndex::StoredRow BrickIndex::storedRow(std::size_t number) const {
  StoredRow row;
  row.parts.resize(kinds_.size());
  withRow(number, [&](const std::byte* bytes) {
    const std::size_t part_bytes = kinds_.size() * sizeof(format::PartEntry);
    std::memcpy(row.parts.data(), bytes, part_bytes);
    std::memcpy(&row.tail, bytes + part_bytes, sizeof row.tail);
  });
  return row;
}

bool BrickIndex::isAtHand(std::size_t number) const {
  return slots_[number / kRowsAtATime % slot_count_].is_filled;
}

bool BrickIndex::isAbsent(std::size_t number) const {
  const std::size_t piece = number / kRowsAtATime;
  Slot& slot = slots_[piece % slot_count_];
  const std::lock_guard lock(slot.mutex);
  return slot.piece != piece;
}

void BrickIndex::bringIn(std::span<const std::size_t> numbers) const {
  std::vector<std::size_t> pieces;
  for (const std::size_t number : numbers)
    if (isAbsent(number)) pieces.push_back(number / kRowsAtATime);
  std::sort(pieces.begin(), pieces.end());
  pieces.erase(std::unique(pieces.begin(), pieces.end()), pieces.end());
  std::vector<ByteRange> ranges;
  for (const std::size_t piece : pieces) ranges.push_back(rangeOf(piece));
  file_.announce(ranges);
  for (const std::size_t piece : pieces) {
    Slot& slot = slots_[piece % slot_count_];
    const std::lock_guard lock(slot.mutex);
    if (slot.piece != piece) load(slot, piece);
  }
}

ByteRange BrickIndex::rangeOf(std::size_t piece) const {
  const std::size_t first = piece * kRowsAtATime;
  return {offset_ + first * row_bytes_, std::min(kRowsAtATime, count() - first) * row_bytes_};
}

template <typename F>
void BrickIndex::withRow(std::size_t number, F&& f) const {
  const std::size_t piece = number / kRowsAtATime, place = number % kRowsAtATime;
  Slot& slot = slots_[piece % slot_count_];
  const std::lock_guard lock(slot.mutex);
  if (slot.piece != piece) load(slot, piece);
  const std::byte* const bytes = slot.bytes.data() + place * row_bytes_;
  const std::uint32_t bit = std::uint32_t{1} << place;
  if ((slot.checked & bit) == 0) check(number, bytes);
  slot.checked |= bit;
  f(bytes);
}

void BrickIndex::load(Slot& slot, std::size_t piece) const {
  const ByteRange range = rangeOf(piece);
  slot.piece = kNoPiece;
  slot.checked = 0;
  slot.bytes.resize(range.bytes);
  RangeReader::Failure why = "cannot be read";
  if (!file_.read(range.offset, range.bytes, slot.bytes.data(), &why))
    fail(piece * kRowsAtATime, why);
  slot.piece = piece;
  slot.is_filled = true;
  bytes_read_ += range.bytes;
}

BrickRow BrickIndex::decode(const std::byte* bytes) const {
  BrickRow row;
  row.parts.fill({0, 0, 0, static_cast<std::uint32_t>(format::Codec::kAbsent)});
  for (std::size_t i = 0; i < kinds_.size(); ++i)
    if (kinds_[i] < row.parts.size())
      std::memcpy(&row.parts[kinds_[i]], bytes + i * sizeof(format::PartEntry),
                  sizeof(format::PartEntry));
  format::RowTail tail;
  std::memcpy(&tail, bytes + kinds_.size() * sizeof(format::PartEntry), sizeof tail);
  row.range_min = tail.range_min;
  row.range_max = tail.range_max;
  row.constant = tail.constant;
  return row;
}

void BrickIndex::check(std::size_t number, const std::byte* bytes) const {
  std::uint64_t stated = 0;
  std::memcpy(&stated, bytes + row_bytes_ - sizeof stated, sizeof stated);
  if (checksum64(bytes, row_bytes_ - sizeof stated, number) != stated) fail(number, "is damaged");
  // Parts of unknown kinds are never read, but have to lie in the file as all parts do.
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    format::PartEntry part;
    std::memcpy(&part, bytes + i * sizeof part, sizeof part);
    if (!file_.holds(part.offset, part.stored_bytes)) fail(number, "has an impossible entry");
  }
  const BrickRow row = decode(bytes);
  const auto [level, brick] = address(number);
  for (const PartKind kind : kPartKinds)
    if (!isPossiblePart(row, spec_, layout_, kind, level, brick))
      fail(number, "has an impossible entry");
  if (!(row.range_min <= row.range_max) || !std::isfinite(row.range_min) ||
      !std::isfinite(row.range_max))
    fail(number, "has an impossible range");
  const bool is_used =
      row.part(PartKind::kSamples).codec == static_cast<std::uint32_t>(format::Codec::kConstant);
  if (!isPossibleConstant(row.constant, spec_.voxel_type) ||
      (is_used && !(row.constant >= row.range_min && row.constant <= row.range_max)))
    fail(number, "has an impossible constant");
}

void BrickIndex::fail(std::size_t number, const char* what) const {
  const auto [level, brick] = address(number);
  const std::uint64_t offset = offset_ + number * row_bytes_;
  throw Error("'" + file_.path() + "' " + brickName(level, brick) +
                  ", its row in the brick table, " + std::to_string(row_bytes_) +
                  " bytes at offset " + std::to_string(offset) + ", " +
                  withAdvice(what, "build it again or restore a copy"),
              {.path = file_.path(), .offset = offset, .level = level, .brick = brick});
}

}  // namespace isobrick
