#include "isobrick/extract/sinks/vertex_numbering.h"

#include <numeric>

#include "isobrick/extract/sinks/edge_vertex_map.h"

namespace isobrick {

VertexNumbering::VertexNumbering() : shared_(std::make_unique<SharedVertexMap>()) {}
VertexNumbering::~VertexNumbering() = default;
VertexNumbering::VertexNumbering(VertexNumbering&&) noexcept = default;
VertexNumbering& VertexNumbering::operator=(VertexNumbering&&) noexcept = default;

void VertexNumbering::place(PlacedBatch& placed) {
  SharedVertexMap& known = *shared_;
  placed.first_vertex = count_;
  placed.known.clear();
  for (const MeshBatch::SharedVertex& shared : placed.batch.shared) {
    const std::uint64_t fresh = count_ + shared.vertex - placed.known.size();
    if (const auto number = known.meet(shared, fresh))
      placed.known.push_back({shared.vertex, *number});
  }
  count_ += placed.batch.positions.size() - placed.known.size();
}

void VertexNumbering::clear() {
  forgetKeys();
  count_ = 0;
}

void VertexNumbering::forgetKeys() { shared_->clear(); }

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
