#include "isobrick/storage/brick_index.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/checksum.h"
#include "isobrick/storage/error.h"

namespace isobrick {

BrickIndex::BrickIndex(const PagedFile& file, const PyramidSpec& spec, const format::Header& header,
                       const TableRows& own, const PyramidDivision* division)
    : file_(file),
      spec_(spec),
      layout_(spec.layout()),
      offset_(header.brick_table_offset),
      row_bytes_(format::rowBytes(header.kind_count)),
      kinds_(header.kinds, header.kinds + header.kind_count),
      division_(division),
      own_(own),
      rows_(division != nullptr ? TableRows(layout_) : own) {
  if (header.brick_count != own_.count() || own_.count() > header.file_bytes / row_bytes_)
    throw Error("'" + file.path() + "' has a wrong number of bricks; build it again",
                {.path = file.path()});
  const std::uint64_t own_bytes = own_.count() * row_bytes_;
  if (offset_ > header.file_bytes || own_bytes > header.file_bytes - offset_)
    throw Error("'" + file.path() + "' has a damaged brick table; build it again",
                {.path = file.path()});
  const auto add = [&](std::size_t rows) {
    piece_count_ += (rows + kRowsAtATime - 1) / kRowsAtATime;
  };
  add(own_.count());
  const std::size_t own_pieces = piece_count_;
  if (division_ != nullptr)
    for (std::size_t number = 0; number < division_->fileCount(); ++number) {
      first_pieces_.push_back(piece_count_);
      add(rowsIn(number));
    }
  slot_count_ = std::min(kMostSlots, piece_count_);
  slots_ = std::make_unique<Slot[]>(slot_count_);
  if (own_bytes <= kReadAtOnceBytes)
    for (std::size_t piece = 0; piece < own_pieces; ++piece) load(slots_[piece], piece);
}

BrickIndex::Place BrickIndex::placeOf(std::size_t number) const {
  if (division_ == nullptr) return {kOwn, number};
  const auto [level, brick] = rows_.address(number);
  const SuperBricks& super_bricks = division_->superBricks();
  if (level >= super_bricks.levels()) return {kOwn, own_.row(level, brick)};
  return {super_bricks.numberOf(level, brick), super_bricks.rowOf(level, brick)};
}

std::size_t BrickIndex::numberOf(const Place& place) const {
  if (division_ == nullptr) return place.row;
  const BrickAddress at = place.file == kOwn
                              ? own_.address(place.row)
                              : division_->superBricks().rowsOf(place.file).address(place.row);
  return rows_.row(at.level, at.brick);
}

BrickIndex::Place BrickIndex::firstOf(std::size_t piece) const {
  const auto after = std::upper_bound(first_pieces_.begin(), first_pieces_.end(), piece);
  if (after == first_pieces_.begin()) return {kOwn, piece * kRowsAtATime};
  const auto file = static_cast<std::size_t>(after - first_pieces_.begin()) - 1;
  return {file, (piece - first_pieces_[file]) * kRowsAtATime};
}

std::size_t BrickIndex::pieceOf(const Place& place) const {
  return (place.file == kOwn ? 0 : first_pieces_[place.file]) + place.row / kRowsAtATime;
}

std::size_t BrickIndex::rowsIn(std::size_t file) const {
  return file == kOwn ? own_.count() : division_->superBricks().rowCount(file);
}

std::uint64_t BrickIndex::base(std::size_t file) const {
  return file == kOwn ? 0 : division_->base(file);
}

std::uint64_t BrickIndex::offsetOf(const Place& place) const {
  const std::uint64_t table =
      place.file == kOwn ? offset_
                         : base(place.file) + division_->file(place.file).brick_table_offset;
  return table + place.row * row_bytes_;
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
  withRow(number, [&](const std::byte* bytes, const Place& place, const Slot& slot) {
    row = decode(bytes);
    if (place.file == kOwn) return;
    moveParts(place, row.parts);
    format::RowTail tail{row.range_min, row.range_max, 0, 0, 0};
    widen(number, place, slot, tail);
    row.range_min = tail.range_min;
    row.range_max = tail.range_max;
  });
  return row;
}

BrickIndex::StoredRow BrickIndex::storedRow(std::size_t number) const {
  StoredRow row;
  row.parts.resize(kinds_.size());
  withRow(number, [&](const std::byte* bytes, const Place& place, const Slot& slot) {
    const std::size_t part_bytes = kinds_.size() * sizeof(format::PartEntry);
    std::memcpy(row.parts.data(), bytes, part_bytes);
    std::memcpy(&row.tail, bytes + part_bytes, sizeof row.tail);
    if (place.file == kOwn) return;
    moveParts(place, row.parts);
    widen(number, place, slot, row.tail);
  });
  return row;
}

void BrickIndex::moveParts(const Place& place, std::span<format::PartEntry> parts) const {
  for (format::PartEntry& part : parts)
    if (isInFile(part)) part.offset += base(place.file);
}

void BrickIndex::widen(std::size_t number, const Place& place, const Slot& slot,
                       format::RowTail& tail) const {
  const auto [level, brick] = address(number);
  if (level == division_->superBricks().levels() - 1) {
    const ValueRange range = division_->borderRange(brick);
    tail.range_min = range.min;
    tail.range_max = range.max;
  }
  for (const RangeCorrection& correction : slot.corrections)
    if (correction.row == place.row) {
      tail.range_min = correction.min;
      tail.range_max = correction.max;
    }
}

bool BrickIndex::isAtHand(std::size_t number) const {
  return slots_[pieceOf(placeOf(number)) % slot_count_].is_filled;
}

bool BrickIndex::isAbsent(std::size_t number) const {
  const std::size_t piece = pieceOf(placeOf(number));
  Slot& slot = slots_[piece % slot_count_];
  const std::lock_guard lock(slot.mutex);
  return slot.piece != piece;
}

void BrickIndex::bringIn(std::span<const std::size_t> numbers) const {
  std::vector<std::size_t> pieces;
  for (const std::size_t number : numbers)
    if (isAbsent(number)) pieces.push_back(pieceOf(placeOf(number)));
  std::sort(pieces.begin(), pieces.end());
  pieces.erase(std::unique(pieces.begin(), pieces.end()), pieces.end());
  std::vector<ByteRange> ranges;
  std::size_t last_file = kOwn;
  for (const std::size_t piece : pieces) {
    ranges.push_back(rangeOf(piece));
    const std::size_t file = firstOf(piece).file;
    if (file != last_file && knownCorrections(file) == nullptr) {
      const format::PartEntry& entry = division_->file(file).corrections;
      if (entry.stored_bytes > 0) ranges.push_back({entry.offset, entry.stored_bytes});
    }
    last_file = file;
  }
  file_.announce(ranges);
  for (const std::size_t piece : pieces) {
    Slot& slot = slots_[piece % slot_count_];
    const std::lock_guard lock(slot.mutex);
    if (slot.piece != piece) load(slot, piece);
  }
}

ByteRange BrickIndex::rangeOf(std::size_t piece) const {
  const Place first = firstOf(piece);
  return {offsetOf(first), std::min(kRowsAtATime, rowsIn(first.file) - first.row) * row_bytes_};
}

template <typename F>
void BrickIndex::withRow(std::size_t number, F&& f) const {
  const Place place = placeOf(number);
  const std::size_t piece = pieceOf(place), at = place.row % kRowsAtATime;
  Slot& slot = slots_[piece % slot_count_];
  const std::lock_guard lock(slot.mutex);
  if (slot.piece != piece) load(slot, piece);
  const std::byte* const bytes = slot.bytes.data() + at * row_bytes_;
  const std::uint32_t bit = std::uint32_t{1} << at;
  if ((slot.checked & bit) == 0) check(number, bytes);
  slot.checked |= bit;
  f(bytes, place, slot);
}

void BrickIndex::load(Slot& slot, std::size_t piece) const {
  const ByteRange range = rangeOf(piece);
  const Place first = firstOf(piece);
  slot.piece = kNoPiece;
  slot.checked = 0;
  slot.corrections.clear();
  slot.bytes.resize(range.bytes);
  try {
    file_.read(range.offset, range.bytes, slot.bytes.data());
  } catch (const ReadFailure& failure) {
    fail(numberOf(first), failure.what());
  }
  if (first.file != kOwn) {
    const Corrections corrections = correctionsOf(first.file);
    auto at =
        std::lower_bound(corrections->begin(), corrections->end(), first.row,
                         [](const RangeCorrection& c, std::size_t row) { return c.row < row; });
    while (at != corrections->end() && at->row < first.row + kRowsAtATime)
      slot.corrections.push_back(*at++);
  }
  slot.piece = piece;
  slot.is_filled = true;
  bytes_read_ += range.bytes;
}

BrickIndex::Corrections BrickIndex::knownCorrections(std::size_t file) const {
  const std::lock_guard lock(corrections_mutex_);
  const auto known = std::find_if(corrections_.begin(), corrections_.end(),
                                  [&](const auto& some) { return some.first == file; });
  if (known == corrections_.end()) return nullptr;
  corrections_.splice(corrections_.begin(), corrections_, known);
  return known->second;
}

BrickIndex::Corrections BrickIndex::correctionsOf(std::size_t file) const {
  constexpr std::size_t kFilesAtOnce = 64;
  if (Corrections known = knownCorrections(file)) return known;
  const format::PartEntry& entry = division_->file(file).corrections;
  const std::size_t count = division_->file(file).correction_count;
  std::vector<std::byte> stored(entry.stored_bytes), words(3 * count * sizeof(std::uint32_t));
  std::string fault = "are damaged";
  bool is_sound = false;
  try {
    file_.read(entry.offset, stored.size(), stored.data());
    is_sound =
        stored.empty() || isChecksum(checksum64(stored.data(), stored.size()), entry.checksum);
  } catch (const ReadFailure& failure) {
    fault = failure.what();
  }
  is_sound = is_sound && (count == 0 || decodePart(static_cast<format::Codec>(entry.codec), stored,
                                                   words.size(), words.data()));
  auto corrections = std::make_shared<std::vector<RangeCorrection>>(is_sound ? count : 0);
  std::uint64_t least_row = 0;
  const std::uint64_t end_row = rowsIn(file);
  for (std::size_t i = 0; i < corrections->size(); ++i) {
    auto& [row, min, max] = (*corrections)[i];
    std::memcpy(&row, &words[4 * i], 4);
    std::memcpy(&min, &words[4 * (count + i)], 4);
    std::memcpy(&max, &words[4 * (2 * count + i)], 4);
    is_sound = is_sound && row >= least_row && row < end_row && min <= max && std::isfinite(min) &&
               std::isfinite(max);
    least_row = std::uint64_t{row} + 1;
  }
  if (!is_sound)
    throw Error("'" + file_.path() + "', the corrected ranges of '" +
                    division_->superBricks().fileName(file) + "', " +
                    std::to_string(entry.stored_bytes) + " bytes at offset " +
                    std::to_string(entry.offset) + ", " + withAdvice(fault, "join the files again"),
                {.path = file_.path(), .offset = entry.offset});
  const std::lock_guard lock(corrections_mutex_);
  corrections_.emplace_front(file, corrections);
  if (corrections_.size() > kFilesAtOnce) corrections_.pop_back();
  return corrections;
}

BrickRow BrickIndex::decode(const std::byte* bytes) const {
  BrickRow row;
  row.parts.fill({0, 0, 0, static_cast<std::uint32_t>(format::Codec::kAbsent)});
  for (std::size_t i = 0; i < kinds_.size(); ++i)
    for (const PartKind kind : kPartKinds)
      if (kinds_[i] == kindNumber(kind))
        std::memcpy(&row.part(kind), bytes + i * sizeof(format::PartEntry),
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
  const Place place = placeOf(number);
  if (!isChecksum(checksum64(bytes, row_bytes_ - sizeof stated, place.row), stated))
    fail(number, "is damaged");
  const std::uint64_t end = place.file == kOwn
                                ? (division_ != nullptr ? division_->indexBytes() : file_.size())
                                : division_->file(place.file).file_bytes;
  // Parts of unknown kinds are never read, but have to lie in the file as all parts do.
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    format::PartEntry part;
    std::memcpy(&part, bytes + i * sizeof part, sizeof part);
    if (isInFile(part) && (part.offset > end || part.stored_bytes > end - part.offset))
      fail(number, "has an impossible entry");
  }
  const BrickRow row = decode(bytes);
  const auto [level, brick] = address(number);
  for (const PartKind kind : kPartKinds)
    if (spec_.level0 == Level0Place::kStored &&
        row.part(kind).codec == static_cast<std::uint32_t>(format::Codec::kInSource))
      fail(number, "is packed by a later program, which has to read it");
  for (const PartKind kind : kPartKinds)
    if (!isPossiblePart(row, spec_, layout_, kind, level, brick))
      fail(number, "has an impossible entry");
  const bool is_empty = spec_.has_missing && row.range_min == std::numeric_limits<float>::max() &&
                        row.range_max == std::numeric_limits<float>::lowest();
  if (!is_empty && (!(row.range_min <= row.range_max) || !std::isfinite(row.range_min) ||
                    !std::isfinite(row.range_max)))
    fail(number, "has an impossible range");
  const bool is_used =
      row.part(PartKind::kSamples).codec == static_cast<std::uint32_t>(format::Codec::kConstant);
  if (!isPossibleConstant(row.constant, spec_) ||
      (is_used && (row.constant < row.range_min || row.constant > row.range_max)))
    fail(number, "has an impossible constant");
}

void BrickIndex::fail(std::size_t number, const char* what) const {
  const auto [level, brick] = address(number);
  const std::uint64_t offset = offsetOf(placeOf(number));
  ErrorPlace place = file_.place(offset);
  place.level = level;
  place.brick = brick;
  throw Error("'" + file_.path() + "' " + brickName(level, brick) +
                  ", its row in the brick table, " + std::to_string(row_bytes_) + " bytes at " +
                  file_.offsetText(offset) + ", " +
                  withAdvice(what, division_ == nullptr ? kDamageAdvice : kDividedDamageAdvice),
              std::move(place));
}

}  // namespace isobrick
