#include "isobrick/preprocess/export/source_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "isobrick/preprocess/export/source_view.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/stored_grid.h"

namespace isobrick {
namespace {

class CroppedSource final : public SourceView {
 public:
  CroppedSource(std::unique_ptr<VolumeSource> source, const IndexBox& box)
      : SourceView(std::move(source),
                   "box " + indexText(box.first) + " to " + indexText(box.end() - Index3(1))),
        box_(box) {
    info_.voxels = box.count;
    info_.geometry.origin = source_->info().geometry.indexToWorld(glm::dvec3(box.first));
    // If the voxels lie in a grid of their own.
    if (const auto first = info_.properties.find("vdb.first"); first != info_.properties.end())
      info_.properties.erase(first);
  }

  std::uint64_t bufferBytes() const override {
    return source_->bufferBytes() + (readsBoxes() ? 0 : wholeRowBytes());
  }

  void readRows(std::int64_t first, std::int64_t count, void* out) override {
    if (readsBoxes()) return VolumeSource::readRows(first, count, out);
    auto* to = static_cast<std::byte*>(out);
    const std::size_t bytes = voxelBytes(info_.voxel_type);
    const std::size_t row_bytes = static_cast<std::size_t>(box_.count.x) * bytes;
    row_.resize(wholeRowBytes());
    for (std::int64_t row = first; row < first + count; ++row, to += row_bytes) {
      const std::int64_t y = box_.first.y + row % box_.count.y;
      const std::int64_t z = box_.first.z + row / box_.count.y;
      source_->readRows(z * source_->info().voxels.y + y, 1, row_.data());
      std::copy_n(row_.data() + static_cast<std::size_t>(box_.first.x) * bytes, row_bytes, to);
    }
  }

  void readBox(const IndexBox& box, void* out) const override {
    source_->readBox({box_.first + box.first, box.count}, out);
  }
  void announce(std::span<const IndexBox> boxes) const override {
    std::vector<IndexBox> moved(boxes.begin(), boxes.end());
    for (IndexBox& box : moved) box.first += box_.first;
    source_->announce(moved);
  }

 private:
  std::size_t wholeRowBytes() const {
    return static_cast<std::size_t>(source_->info().voxels.x) * voxelBytes(info_.voxel_type);
  }

  IndexBox box_;
  std::vector<std::byte> row_;  // of the source, if it is read by rows
};

// "1,1,2 um"
std::string lengthsText(const glm::dvec3& lengths, const std::string& unit) {
  return pointText(lengths) + (unit.empty() ? "" : " " + unit);
}

std::string placeText(const GivenPlace& given) {
  std::string text;
  const auto add = [&](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  if (given.spacing) add("spacing " + lengthsText(*given.spacing, given.spacing_unit));
  if (given.origin) add("origin " + lengthsText(*given.origin, given.origin_unit));
  if (!given.unit.empty()) add("unit " + given.unit);
  return text;
}

class PlacedSource final : public SourceView {
 public:
  PlacedSource(std::unique_ptr<VolumeSource> source, const GivenPlace& given)
      : SourceView(std::move(source), placeText(given)) {
    std::string unit = given.unit;
    if (unit.empty() && info_.geometry.unit == LengthUnit::kUnknown)
      unit = given.spacing_unit.empty() ? given.origin_unit : given.spacing_unit;
    if (!unit.empty()) takeUnit(unit);
    place("the spacing", given.spacing, given.spacing_unit.empty() ? unit : given.spacing_unit,
          info_.geometry.spacing);
    place("the origin", given.origin, given.origin_unit.empty() ? unit : given.origin_unit,
          info_.geometry.origin);
    if (!isUsableGeometry(info_.geometry))
      throw fileError(info_.source, "cannot use '", info_.source, "' with the spacing ",
                      pointText(info_.geometry.spacing), " and the origin ",
                      pointText(info_.geometry.origin), ": choose spacings above 0");
  }

 private:
  LengthScale scaleOf(const std::string& unit) const {
    if (const auto scale = lengthScale(unit)) return *scale;
    throw fileError(info_.source, "cannot use '", info_.source, "' with ", "the unit '", unit,
                    "', which is no unit of length; give one such as um or mm");
  }

  void takeUnit(const std::string& unit) {
    GridGeometry& geometry = info_.geometry;
    const bool is_known = geometry.unit == LengthUnit::kMillimetre;
    const LengthScale scale = scaleOf(unit);
    if (is_known && info_.stated_lengths == scale) return;
    if (!info_.stated_lengths)
      throw fileError(info_.source, "'", info_.source, "' states lengths in several units, and ",
                      unit, " cannot stand for them all; give its spacing and origin in ", unit);
    const LengthScale stated = *info_.stated_lengths;
    for (glm::dvec3* const lengths : {&geometry.spacing, &geometry.origin})
      for (int axis = 0; axis < 3; ++axis)
        (*lengths)[axis] = scale.of((*lengths)[axis] * stated.over / stated.times);
    geometry.unit = LengthUnit::kMillimetre;
    info_.stated_lengths = scale;
    info_.notes.push_back("the unit " + unit + " was given" +
                          (is_known ? " in place of the input's own" : "") +
                          "; lengths became millimetres");
  }

  void place(const char* what, const std::optional<glm::dvec3>& given, const std::string& unit,
             glm::dvec3& now) {
    if (!given) return;
    glm::dvec3 lengths = *given;
    const LengthScale scale = unit.empty() ? LengthScale() : scaleOf(unit);
    for (int axis = 0; axis < 3; ++axis) lengths[axis] = scale.of(lengths[axis]);
    info_.notes.push_back(std::string(what) + " " + lengthsText(*given, unit) +
                          " was given in place of " + pointText(now));
    now = lengths;
  }
};

// Maps one value after the other; map(in, out) gets the types.
class MappedSource : public SourceView {
 public:
  std::uint64_t bufferBytes() const final { return source_->bufferBytes() + kBlockBytes; }

  void readRows(std::int64_t first, std::int64_t count, void* out) final {
    const std::int64_t row = info_.voxels.x;
    const std::size_t in_bytes = voxelBytes(source_->info().voxel_type);
    const std::int64_t most = std::max(
        std::int64_t{1},
        static_cast<std::int64_t>(kBlockBytes / (static_cast<std::size_t>(row) * in_bytes)));
    auto* to = static_cast<std::byte*>(out);
    while (count > 0) {
      const std::int64_t rows = std::min(most, count);
      block_.resize(static_cast<std::size_t>(rows * row) * in_bytes);
      source_->readRows(first, rows, block_.data());
      mapValues(block_.data(), static_cast<std::size_t>(rows * row), to);
      to += static_cast<std::size_t>(rows * row) * voxelBytes(info_.voxel_type);
      first += rows;
      count -= rows;
    }
  }

  void readBox(const IndexBox& box, void* out) const final {
    std::vector<std::byte> block(static_cast<std::size_t>(box.size()) *
                                 voxelBytes(source_->info().voxel_type));
    source_->readBox(box, block.data());
    mapValues(block.data(), static_cast<std::size_t>(box.size()), out);
  }

 protected:
  using SourceView::SourceView;

 private:
  void takeVoxels(const VolumeInfo&) final {}  // it has a type of its own
  // For the source's type and of info_.voxel_type.
  virtual void mapValues(const std::byte* from, std::size_t count, void* to) const = 0;

  static constexpr std::size_t kBlockBytes = std::size_t{1} << 20;
  std::vector<std::byte> block_;
};

// Values of the input in another type.
class RealSource final : public MappedSource {
 public:
  RealSource(std::unique_ptr<VolumeSource> source, VoxelType type, std::shared_ptr<ValueLoss> loss)
      : MappedSource(std::move(source), "as " + std::string(voxelTypeName(type))),
        is_asked_for_(loss == nullptr),
        loss_(loss != nullptr ? std::move(loss) : std::make_shared<ValueLoss>()) {
    info_.voxel_type = type;
    info_.values = {};
    info_.numbers.reset();
    info_.bounds.reset();
  }

  std::vector<std::string> notesOfReading() const override {
    std::vector<std::string> notes = MappedSource::notesOfReading();
    if (is_asked_for_ && loss_->changed() > 0) notes.push_back(loss_->text());
    return notes;
  }

 private:
  void mapValues(const std::byte* from, std::size_t count, void* to) const override {
    const ValueTransform& values = source_->info().values;
    std::uint64_t changed = 0;
    double most_change = 0;
    RealRange range{std::numeric_limits<double>::infinity(),
                    -std::numeric_limits<double>::infinity()};
    visitNumberType(source_->info().voxel_type, [&](auto in_tag) {
      visitNumberType(info_.voxel_type, [&](auto out_tag) {
        using In = typename decltype(in_tag)::Type;
        using Out = typename decltype(out_tag)::Type;
        const In* const in = reinterpret_cast<const In*>(from);
        Out* const out = static_cast<Out*>(to);
        for (std::size_t i = 0; i < count; ++i) {
          if constexpr (std::is_integral_v<In> && std::is_integral_v<Out>) {
            // Modulo 2^64, which is exact, also beyond the whole numbers of doubles.
            const auto offset =
                values.offset < 0
                    ? static_cast<std::uint64_t>(static_cast<std::int64_t>(values.offset))
                    : static_cast<std::uint64_t>(values.offset);
            out[i] = static_cast<Out>(static_cast<std::uint64_t>(in[i]) + offset);
          } else {
            const double value = values.real(static_cast<double>(in[i]));
            out[i] = static_cast<Out>(value);
            if (!std::isfinite(value)) continue;
            const auto written = static_cast<double>(out[i]);
            const double change = std::abs((std::isfinite(written) ? written : 0) - value);
            changed += change > 0 ? 1 : 0;
            most_change = std::max(most_change, change);
            range.min = std::min(range.min, value);
            range.max = std::max(range.max, value);
          }
        }
      });
    });
    loss_->add(changed, most_change, range);
  }

  const bool is_asked_for_;  // the type, whatever is lost
  const std::shared_ptr<ValueLoss> loss_;
};

// True if all values of the input are whole numbers between the two bounds of T.
template <typename T>
bool holdsWhole(const VolumeInfo& info) {
  return info.range.min >= static_cast<double>(std::numeric_limits<T>::lowest()) &&
         info.range.max <= static_cast<double>(std::numeric_limits<T>::max());
}

VoxelType realTypeOf(const VolumeInfo& info, bool has_all_types) {
  if (info.values.isIdentity())
    return isStorable(info.voxel_type) || has_all_types ? info.voxel_type : VoxelType::kFloat32;
  const bool are_whole = info.voxel_type != VoxelType::kFloat32 && info.values.scale == 1 &&
                         info.values.offset == std::floor(info.values.offset);
  if (are_whole) {
    if (holdsWhole<std::int16_t>(info)) return VoxelType::kInt16;
    if (holdsWhole<std::uint16_t>(info)) return VoxelType::kUint16;
    if (has_all_types) {
      if (holdsWhole<std::int32_t>(info)) return VoxelType::kInt32;
      if (holdsWhole<std::uint32_t>(info)) return VoxelType::kUint32;
      constexpr double kWholeDoubles = 0x1p53;
      if (std::max(-info.range.min, info.range.max) <= kWholeDoubles) return VoxelType::kFloat64;
      return info.range.min < 0 ? VoxelType::kInt64 : VoxelType::kUint64;
    }
  }
  return has_all_types ? VoxelType::kFloat64 : VoxelType::kFloat32;
}

class WindowedSource final : public MappedSource {
 public:
  WindowedSource(std::unique_ptr<VolumeSource> source, const ValueWindow& window, VoxelType type)
      : MappedSource(std::move(source), "window " + numberText(window.low) + "," +
                                            numberText(window.high) + " as " +
                                            std::string(voxelTypeName(type))),
        window_(window) {
    info_.voxel_type = type;
    info_.values = {};
    info_.numbers.reset();
    // Backgrounds and classes are about the values as they were.
    std::erase_if(info_.properties, [](const auto& p) { return p.first.starts_with("vdb."); });
    visitVoxelType(type, [&](auto tag) {
      using Out = typename decltype(tag)::Type;
      if constexpr (std::is_integral_v<Out>) {
        least_ = std::numeric_limits<Out>::min();
        most_ = std::numeric_limits<Out>::max();
      }
    });
    info_.notes.push_back(
        "values were cut to " + numberText(window.low) + " .. " + numberText(window.high) +
        " and rounded to steps of " + numberText((window.high - window.low) / (most_ - least_)) +
        ": value = " + numberText(window.low) + " + (stored - " + numberText(least_) + ") * " +
        numberText((window.high - window.low) / (most_ - least_)));
  }

 private:
  void mapValues(const std::byte* from, std::size_t count, void* to) const override {
    const double steps = most_ - least_;
    const double low = window_.low, scale = steps / (window_.high - window_.low);
    const auto least = static_cast<std::int32_t>(least_);
    const ValueTransform& values = source_->info().values;
    visitNumberType(source_->info().voxel_type, [&](auto in_tag) {
      visitVoxelType(info_.voxel_type, [&](auto out_tag) {
        using In = typename decltype(in_tag)::Type;
        using Out = typename decltype(out_tag)::Type;
        const In* const in = reinterpret_cast<const In*>(from);
        Out* const out = static_cast<Out*>(to);
        for (std::size_t i = 0; i < count; ++i) {
          const double value = values.real(static_cast<double>(in[i]));
          const double step = std::min((value - low) * scale, steps);
          // NaN becomes the least: it compares with nothing.
          out[i] = static_cast<Out>(least + static_cast<std::int32_t>(step > 0 ? step + 0.5 : 0.0));
        }
      });
    });
  }

  ValueWindow window_;
  double least_ = 0, most_ = 0;  // of the type
};

class LabelSource final : public MappedSource {
 public:
  LabelSource(std::unique_ptr<VolumeSource> source, std::uint64_t label)
      : MappedSource(std::move(source), concat("label ", label)), label_(label) {
    info_.voxel_type = VoxelType::kUint8;
    info_.values = {};
    info_.numbers.reset();
    info_.properties.clear();  // they are about the values as they were
  }

 private:
  void mapValues(const std::byte* from, std::size_t count, void* to) const override {
    visitNumberType(source_->info().voxel_type, [&](auto tag) {
      using In = typename decltype(tag)::Type;
      if constexpr (std::is_integral_v<In>) {
        const In* const in = reinterpret_cast<const In*>(from);
        const bool is_one = std::in_range<In>(label_);
        const In label = is_one ? static_cast<In>(label_) : In{};
        auto* const out = static_cast<std::uint8_t*>(to);
        for (std::size_t i = 0; i < count; ++i) out[i] = is_one && in[i] == label ? 1 : 0;
      }
    });
  }

  const std::uint64_t label_;
};

}  // namespace

std::unique_ptr<VolumeSource> makeCroppedSource(std::unique_ptr<VolumeSource> source,
                                                const IndexBox& box) {
  const VolumeInfo& info = source->info();
  for (int axis = 0; axis < 3; ++axis)
    // Without a sum, which might not fit into 64 bits.
    if (box.first[axis] < 0 || box.count[axis] < 2 || box.count[axis] > info.voxels[axis] ||
        box.first[axis] > info.voxels[axis] - box.count[axis])
      throw fileError(info.source, "cannot cut '", info.source, "' to a box of ",
                      indexText(box.count), " voxels from ", indexText(box.first),
                      " on: it has the voxels 0,0,0 to ", indexText(info.voxels - Index3(1)),
                      ", and at least two are needed along every axis; choose a box within");
  return std::make_unique<CroppedSource>(std::move(source), box);
}

std::unique_ptr<VolumeSource> makeFloatSource(std::unique_ptr<VolumeSource> source) {
  return std::make_unique<RealSource>(std::move(source), VoxelType::kFloat32, nullptr);
}

void ValueLoss::add(std::uint64_t changed, double most_change, const RealRange& range) {
  const std::lock_guard lock(mutex_);
  changed_ += changed;
  most_change_ = std::max(most_change_, most_change);
  least_ = std::min(least_, range.min);
  greatest_ = std::max(greatest_, range.max);
}

std::string ValueLoss::text() const {
  return concat(changed_, " values changed as float32, by at most ", most_change_,
                " of a range of ", range());
}

std::unique_ptr<VolumeSource> makeRealSource(std::unique_ptr<VolumeSource> source,
                                             bool has_all_types, std::shared_ptr<ValueLoss> loss) {
  const VoxelType type = realTypeOf(source->info(), has_all_types);
  if (source->info().values.isIdentity() && type == source->info().voxel_type) return source;
  return std::make_unique<RealSource>(std::move(source), type, std::move(loss));
}

std::unique_ptr<VolumeSource> makeWindowedSource(std::unique_ptr<VolumeSource> source,
                                                 const ValueWindow& window, VoxelType type) {
  if (!(window.low < window.high) || !std::isfinite(window.high - window.low))
    throw Error("the window " + numberText(window.low) + "," + numberText(window.high) +
                " is empty; give the lower value first");
  if (type == VoxelType::kFloat32)
    throw Error("a window is for integer voxels; leave it out for float32");
  return std::make_unique<WindowedSource>(std::move(source), window, type);
}

std::unique_ptr<VolumeSource> makeLabelSource(std::unique_ptr<VolumeSource> source,
                                              std::uint64_t label) {
  source = makeRealSource(std::move(source), true, nullptr);
  const VolumeInfo& info = source->info();
  if (info.voxel_type == VoxelType::kFloat32 || info.voxel_type == VoxelType::kFloat64)
    throw fileError(info.source, "cannot take a label of '", info.source, "': labels are whole ",
                    "numbers, and it has ", voxelTypeName(info.voxel_type),
                    "; give a volume of integers");
  return std::make_unique<LabelSource>(std::move(source), label);
}

std::unique_ptr<VolumeSource> makePlacedSource(std::unique_ptr<VolumeSource> source,
                                               const GivenPlace& given) {
  return std::make_unique<PlacedSource>(std::move(source), given);
}

}  // namespace isobrick
