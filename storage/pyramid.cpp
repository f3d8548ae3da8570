#include "isobrick/storage/pyramid.h"

#include <cmath>
#include <limits>

#include "isobrick/storage/pyramid_parts.h"

namespace isobrick {

BrickPart::~BrickPart() {
  if (pager_ != nullptr) pager_->release(id_);
}

Pyramid::Pyramid(const std::string& path, std::uint64_t budget_bytes, FileAccess access,
                 const RemoteOptions& remote)
    : tables_(std::make_unique<PyramidTables>(path, access, remote)),
      parts_(std::make_unique<PyramidParts>(*tables_, budget_bytes)),
      budget_bytes_(budget_bytes),
      spec_(tables_->spec()),
      layout_(tables_->layout()),
      value_range_(tables_->valueRange()) {
  if (tables_->dividedFile() && tables_->dividedFile()->number)
    tables_->fail("is the file of one super-brick of a divided pyramid; open its folder");
}
Pyramid::Pyramid(std::string name, const PyramidSpec& spec, const ValueRange& values,
                 std::shared_ptr<const BrickSupply> supply)
    : tables_(std::make_unique<PyramidTables>(std::move(name), spec, values)),
      parts_(std::make_unique<PyramidParts>(*tables_, 0, std::move(supply))),
      budget_bytes_(0),
      spec_(spec),
      layout_(spec.layout()),
      value_range_(values) {}
Pyramid::~Pyramid() = default;

const std::string& Pyramid::path() const { return tables_->path(); }
const std::string& Pyramid::provenance() const { return tables_->provenance(); }
std::uint64_t Pyramid::missingVoxels() const { return tables_->missingVoxels(); }
float Pyramid::storedIsovalue(double isovalue) const {
  const ValueTransform& values = spec_.values;
  const auto nearest = static_cast<float>(values.stored(isovalue));
  if (values.isIdentity() || values.real(static_cast<double>(nearest)) >= isovalue) return nearest;
  return std::nextafter(nearest, std::numeric_limits<float>::infinity());
}
double Pyramid::noise() const { return tables_->header().noise; }
VoxelHistogram Pyramid::histogram() const { return tables_->histogram(); }
std::uint64_t Pyramid::fileBytes() const { return tables_->fileBytes(); }
std::size_t Pyramid::brickCount() const { return parts_->brickCount(); }
RemoteCounters Pyramid::remoteCounters() const { return tables_->bytes().remoteCounters(); }
PyramidSums Pyramid::sums() const { return tables_->sums(); }

ValueRange Pyramid::brickRange(int level, const Index3& brick) const {
  return parts_->brickRange(level, brick);
}
BrickSamples Pyramid::samples(int level, const Index3& brick, const CancelFlag* cancel) const {
  return parts_->samples(level, brick, cancel);
}
void Pyramid::tileRanges(int level, const Index3& brick, std::vector<ValueRange>& out,
                         const CancelFlag* cancel) const {
  parts_->tileRanges(level, brick, out, cancel);
}
void Pyramid::throwIfReadsFailed(int level, const Index3& brick) const {
  parts_->throwIfReadsFailed(level, brick);
}

}  // namespace isobrick
