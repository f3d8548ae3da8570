#include "isobrick/extract/sinks/vertex_numbering.h"

#include <numeric>

#include "isobrick/extract/sinks/edge_vertex_map.h"

namespace isobrick {
namespace {

// A number and, above it, how many batches are still to list the vertex.
constexpr int kNumberBits = 56;
constexpr std::uint64_t kNever = 255;  // forgotten

}  // namespace

VertexNumbering::VertexNumbering() : shared_(std::make_unique<EdgeVertexMap<std::uint64_t>>()) {}
VertexNumbering::~VertexNumbering() = default;
VertexNumbering::VertexNumbering(VertexNumbering&&) noexcept = default;
VertexNumbering& VertexNumbering::operator=(VertexNumbering&&) noexcept = default;

void VertexNumbering::place(PlacedBatch& placed) {
  EdgeVertexMap<std::uint64_t>& known = *shared_;
  placed.first_vertex = count_;
  placed.known.clear();
  for (const MeshBatch::SharedVertex& shared : placed.batch.shared) {
    bool inserted = false;
    const std::uint64_t fresh = count_ + shared.vertex - placed.known.size();
    const std::uint64_t batches_left = shared.batches == 0 ? kNever : shared.batches - 1u;
    std::uint64_t& entry =
        known.findOrInsert(shared.key, fresh | batches_left << kNumberBits, &inserted);
    if (inserted) continue;
    placed.known.push_back({shared.vertex, entry & ((std::uint64_t{1} << kNumberBits) - 1)});
    if (entry >> kNumberBits == 1)
      known.erase(shared.key);
    else if (entry >> kNumberBits != kNever)
      entry -= std::uint64_t{1} << kNumberBits;
  }
  count_ += placed.batch.positions.size() - placed.known.size();
}

void VertexNumbering::clear() {
  shared_->clear();
  count_ = 0;
}

std::size_t VertexNumbering::remembered() const { return shared_->size(); }

void findNumbers(PlacedBatch& placed) {
  placed.numbers.resize(placed.batch.positions.size());
  forEachNewRun(placed, [&](std::size_t begin, std::size_t end, std::uint64_t number) {
    std::iota(placed.numbers.begin() + static_cast<std::ptrdiff_t>(begin),
              placed.numbers.begin() + static_cast<std::ptrdiff_t>(end),
              static_cast<std::uint32_t>(number));
  });
  for (const KnownVertex& known : placed.known)
    placed.numbers[known.vertex] = static_cast<std::uint32_t>(known.number);
}

}  // namespace isobrick
