// Writes a pyramid: bricks in the order of the table under a temporary name, published as a whole.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "isobrick/storage/atomic_file.h"
#include "isobrick/storage/brick_encoder.h"
#include "isobrick/storage/brick_table.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/gradient_spectrum.h"
#include "isobrick/storage/pyramid_division.h"
#include "isobrick/storage/pyramid_info.h"
#include "isobrick/storage/voxel_histogram.h"
#include "isobrick/storage/write_journal.h"

namespace isobrick {

// The ending of a pyramid that is being written.
inline constexpr char kUnfinishedEnding[] = ".partial";

// Removes "<path>.partial.journal" if it stands alone: a build that was killed just after it gave
// the pyramid its name leaves it, and it means nothing. Any failure is silent.
void removeStrayJournal(const std::string& path) noexcept;

// Writes `path`. Nothing has that name before finish() returned. The bytes so far lie in
// "<path>.partial", and "<path>.partial.journal" lists its complete bricks; both are removed with
// the writer, unless keepForResume() was called, or the process is killed. One thread at a time.
// Every failed write throws ResumableError.
class PyramidWriter {
 public:
  // `identity` is a text of what the file is made from, input and options. With `resume`, the
  // bricks of an earlier writer are taken over as far as they are undamaged; the identity must be
  // the same, or it throws Error and leaves everything as it is. Without it they are removed. Takes
  // the exclusive right to write `path`; if another process has it, throws Error. `cancel` may be
  // null and outlives the writer, which checks it during every long wait: here while it checks the
  // leftovers, in reserve() and finish() for the disk. Then it throws Cancelled. `file` says which
  // file of a divided pyramid it is, if it is one.
  PyramidWriter(const std::string& path, const PyramidSpec& spec, const std::string& identity,
                bool resume, const CancelFlag* cancel,
                const std::optional<DividedFile>& file = std::nullopt);
  ~PyramidWriter();

  // The bricks that it writes, in the order of the table.
  const TableRows& rows() const { return rows_; }
  // Number of bricks, counted in the order of the table, that an earlier writer left behind.
  std::uint64_t bricksResumed() const { return bricks_resumed_; }
  std::uint64_t bricksWritten() const { return bricks_written_; }
  std::uint64_t bytesWritten() const { return end_; }
  // Whether any of the bricks written, or taken over, has bounds of the curvature, and surfaces
  // that they could be of.
  bool hasCurvature() const;

  // Free bytes of the file system, or nothing if it cannot tell.
  std::optional<std::uint64_t> freeBytes() const { return file_.freeBytes(); }
  // Takes `bytes` in all from the file system now. Throws ResumableError if it has fewer.
  void reserve(std::uint64_t bytes) { file_.reserve(bytes, cancel_); }

  // Writes the next brick in the order of the table. The journal says so after the next flush().
  void write(const EncodedBrick& brick);
  void flush() { journal_->flush(); }

  // Reads the elements of the samples or ranges of brick `row`, a resumed one (< bricksResumed()).
  // `bytes` is the size that the layout gives. Thread-safe, also while another thread writes.
  void readPart(std::uint64_t row, PartKind part, std::size_t bytes, std::byte* out) const;

  // The temporary file and its journal outlive this object.
  void keepForResume();
  const std::string& temporaryPath() const { return file_.temporaryPath(); }

  // Facts of a volume that are known when its last voxel was seen.
  struct Summary {
    ValueRange voxel_range;
    std::span<const ValueRange> brick_ranges;  // closures of all bricks, in the table's order
    std::optional<VoxelHistogram> histogram;   // of the voxels, which have that range
    double noise = 0;                          // sigma, in the voxels' units; finite, >= 0
    std::string provenance_json;
    std::optional<GradientSpectrum> gradients = {};
    std::vector<std::byte> division = {};  // of a file of a divided pyramid: see format::Header
    std::uint64_t missing_voxels = 0;      // only if the spec has them
  };
  // Appends numbers to the file, for Summary::division to name their place. Every brick was written
  // before.
  format::PartEntry append(std::span<const std::uint32_t> numbers, format::Codec codec);
  // Writes histogram, gradients, tables, provenance and header, makes them durable and publishes
  // the file. Every brick of every level was written before. Returns the size of the file in bytes.
  std::uint64_t finish(const Summary& summary, format::Codec codec);

 private:
  format::PartEntry appendBytes(std::span<const std::byte> bytes);
  std::vector<JournalEntry> takeOver(const std::string& identity, const CancelFlag* cancel);
  [[noreturn]] void refuseToBeginAnew() const;
  std::vector<PartKind> kinds() const;
  // Appends bytes at a multiple of kPartAlignment; returns their offset.
  std::uint64_t append(const void* data, std::size_t bytes);
  std::uint64_t appendBrickTable();
  template <typename T>
  format::PartEntry appendNumbers(std::span<const T> numbers, format::Codec codec);

  const CancelFlag* cancel_;
  PyramidSpec spec_;
  BrickLayout layout_;
  std::optional<DividedFile> divided_;
  AtomicFile file_;
  std::uint64_t end_ = 0;  // where the next byte goes
  const TableRows rows_;
  std::vector<BrickRow> brick_table_;
  std::uint64_t bricks_written_ = 0, bricks_resumed_ = 0;
  bool keeps_ = false;
  std::unique_ptr<WriteJournal> journal_;
};

}  // namespace isobrick
