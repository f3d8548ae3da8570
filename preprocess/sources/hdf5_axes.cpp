#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/shallow_json.h"
#include "isobrick/preprocess/sources/hdf5_dataset.h"
#include "isobrick/preprocess/sources/one_grid.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {
namespace {

enum class Role { kUnknown, kX, kY, kZ, kTime, kChannel };

Role roleOf(const std::string& name) {
  constexpr struct {
    std::string_view name;
    Role role;
  } kNames[] = {{"x", Role::kX},
                {"lon", Role::kX},
                {"longitude", Role::kX},
                {"y", Role::kY},
                {"lat", Role::kY},
                {"latitude", Role::kY},
                {"z", Role::kZ},
                {"lev", Role::kZ},
                {"level", Role::kZ},
                {"depth", Role::kZ},
                {"height", Role::kZ},
                {"altitude", Role::kZ},
                {"t", Role::kTime},
                {"time", Role::kTime},
                {"c", Role::kChannel},
                {"channel", Role::kChannel},
                {"channels", Role::kChannel},
                {"band", Role::kChannel}};
  const std::string lower = lowercase(name);
  for (const auto& known : kNames)
    if (known.name == lower) return known.role;
  return Role::kUnknown;
}

class AxisFinder {
 public:
  AxisFinder(const std::string& name, const std::vector<hsize_t>& dims, const Hdf5Choice& choice,
             const OpenOptions& options)
      : name_(name), dims_(dims), names_(dims.size()), roles_(dims.size(), Role::kUnknown) {
    axes_.fixed.assign(dims.size(), 0);
    if (!choice.took_time) time_ = options.time;
    if (!choice.took_channel) channel_ = options.channel;
  }

  void nameAxes(hid_t dataset, const std::vector<Hdf5Scale>& scales) {
    if (takeVigraTags(Hdf5Attribute(dataset, "axistags").text())) return;
    for (std::size_t i = 0; i < scales.size(); ++i) names_[i] = scales[i].name;
    const auto labels = Hdf5Attribute(dataset, "DIMENSION_LABELS").texts();
    for (std::size_t i = 0; i < std::min(labels.size(), names_.size()); ++i)
      if (!labels[i].empty()) names_[i] = labels[i];
    for (std::size_t i = 0; i < names_.size(); ++i) roles_[i] = roleOf(names_[i]);
  }

  Hdf5Axes find() {
    if (!findByName()) findByPlace();
    fixOthers();
    return std::move(axes_);
  }

 private:
  bool takeVigraTags(const std::string& text) {
    const nlohmann::json json = parseShallowJson(text);
    const nlohmann::json& axes = member(json, "axes");
    if (!axes.is_array() || axes.size() != dims_.size()) return false;
    for (std::size_t i = 0; i < dims_.size(); ++i) {
      if (!member(axes[i], "key").is_string()) return false;
      names_[i] = textOf(member(axes[i], "key"));
      roles_[i] = roleOf(names_[i]);
      const nlohmann::json& resolution = member(axes[i], "resolution");
      axes_.resolutions.push_back(resolution.is_number() ? resolution.get<double>() : 0);
    }
    return true;
  }

  bool isOfSpace(std::size_t i) const {
    return std::ranges::find(axes_.of_space, i) != axes_.of_space.end();
  }

  bool findByName() {
    constexpr std::array kRoles = {Role::kX, Role::kY, Role::kZ};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (std::ranges::count(roles_, kRoles[axis]) != 1) return false;
      axes_.of_space[axis] =
          static_cast<std::size_t>(std::ranges::find(roles_, kRoles[axis]) - roles_.begin());
    }
    return true;
  }

  // The last three that have more than one element, or else the last three.
  void findByPlace() {
    std::vector<std::size_t> candidates;
    for (std::size_t i = dims_.size(); i-- > 0;)
      if (roles_[i] != Role::kTime && roles_[i] != Role::kChannel) candidates.push_back(i);
    if (candidates.size() < 3)
      throw unusableDataset(name_, "its axes are ", axesText(),
                            ", and a volume has three of space");
    std::stable_partition(candidates.begin(), candidates.end(),
                          [&](std::size_t i) { return dims_[i] != 1; });
    candidates.resize(3);
    std::sort(candidates.rbegin(), candidates.rend());
    std::ranges::copy(candidates, axes_.of_space.begin());
  }

  void fixOthers() {
    std::vector<std::size_t> further;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      if (!isOfSpace(i) && dims_[i] != 1) further.push_back(i);
    if (further.size() > 2)
      throw unusableDataset(
          name_, "it has the axes ", axesText(),
          ", and beside three of space two are read; write a part of it to a file");
    if (further.size() == 2) {
      const bool are_turned =
          roles_[further[0]] == Role::kChannel || roles_[further[1]] == Role::kTime;
      axes_.time_step = fix(further[are_turned ? 1 : 0], "time", time_, Remedy::kChooseTime);
      axes_.channel = fix(further[are_turned ? 0 : 1], "channel", channel_, Remedy::kChooseVariant);
    } else if (further.size() == 1) {
      // One number is enough to tell which, whatever the axis is called.
      const bool is_time = roles_[further[0]] == Role::kTime;
      const bool takes_time = is_time ? time_ || !channel_ : time_ && !channel_;
      (takes_time ? axes_.time_step : axes_.channel) =
          fix(further[0], is_time ? "time" : "channel", takes_time ? time_ : channel_,
              is_time ? Remedy::kChooseTime : Remedy::kChooseVariant);
    }
    refuseUnused("time", time_, Role::kTime);
    refuseUnused("channel", channel_, Role::kChannel);
  }

  OneOfSeveral fix(std::size_t axis, const char* kind, std::optional<std::int64_t>& wanted,
                   Remedy remedy) {
    const std::string kinds = concat("'", name_, "' has the ", kind, "s 0 to ", dims_[axis] - 1);
    if (!wanted) throw Error(kinds + "; one is a volume", place(), {remedy});
    if (*wanted < 0 || static_cast<hsize_t>(*wanted) >= dims_[axis])
      throw Error(concat(kinds, ", and not ", *wanted, "; choose one of these"), place());
    axes_.fixed[axis] = static_cast<hsize_t>(*wanted);
    axes_.encoding +=
        (axes_.encoding.empty() ? "" : ", ") + std::string(kind) + " " + std::to_string(*wanted);
    const OneOfSeveral taken{*wanted, static_cast<std::int64_t>(dims_[axis])};
    wanted.reset();
    return taken;
  }

  // An axis of one element has the index 0, and so has one that is not there.
  void refuseUnused(const char* kind, const std::optional<std::int64_t>& wanted, Role role) const {
    if (wanted.value_or(0) == 0) return;
    bool has_one = false;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      has_one |= !isOfSpace(i) && (roles_[i] == role || roles_[i] == Role::kUnknown);
    throw unusableDataset(name_, "it has ", has_one ? "one " : "no ", kind,
                          has_one ? ", number 0" : " to choose: its axes are " + axesText(),
                          "; leave the choice of ", kind, " ", *wanted, " out");
  }

  // "z 10, y 20, x 24", or without names "10 x 20 x 24".
  std::string axesText() const {
    const bool have_names =
        std::ranges::all_of(names_, [](const std::string& name) { return !name.empty(); });
    std::string text;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      text += concat(i == 0       ? ""
                     : have_names ? ", "
                                  : " x ",
                     have_names ? quotedText(names_[i], 20) + " " : "", dims_[i]);
    return text;
  }

  ErrorPlace place() const { return {.path = splitHdf5Name(name_).first}; }

  const std::string& name_;
  const std::vector<hsize_t>& dims_;
  std::vector<std::string> names_;
  std::vector<Role> roles_;
  std::optional<std::int64_t> time_, channel_;  // that were not used yet
  Hdf5Axes axes_;
};

}  // namespace

Hdf5Axes findHdf5Axes(hid_t dataset, const std::string& name, const std::vector<hsize_t>& dims,
                      const std::vector<Hdf5Scale>& scales, const Hdf5Choice& choice,
                      const OpenOptions& options) {
  AxisFinder finder(name, dims, choice, options);
  if (!choice.is_zyx) finder.nameAxes(dataset, scales);
  return finder.find();
}

namespace {

bool takeOwnAttributes(hid_t dataset, GridGeometry& geometry) {
  const auto spacing = Hdf5Attribute(dataset, "spacing").numbers(3);
  const auto origin = Hdf5Attribute(dataset, "origin").numbers(3);
  const auto direction = Hdf5Attribute(dataset, "direction").numbers(9);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int a = static_cast<int>(axis);
    if (!spacing.empty()) geometry.spacing[a] = spacing[axis];
    if (!origin.empty()) geometry.origin[a] = origin[axis];
    for (std::size_t row = 0; row < 3 && !direction.empty(); ++row)
      geometry.direction[a][static_cast<int>(row)] = direction[3 * axis + row];
  }
  if (!spacing.empty() &&
      Hdf5Attribute(dataset, "length_unit").text() == lengthUnitName(LengthUnit::kMillimetre))
    geometry.unit = LengthUnit::kMillimetre;
  return !spacing.empty();
}

// A number for every axis of the dataset, or for those of space, slowest first, or for the five
// that ilastik has: time, z, y, x, channel.
std::optional<glm::dvec3> elementSize(hid_t dataset, const Hdf5Axes& axes) {
  const auto sizes = Hdf5Attribute(dataset, "element_size_um").numbers();
  const bool has_all = sizes.size() == axes.fixed.size();
  if (!has_all && sizes.size() != 3 && sizes.size() != 5) return std::nullopt;
  std::array<std::size_t, 3> order = axes.of_space;
  std::ranges::sort(order);
  glm::dvec3 size;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t among =
        static_cast<std::size_t>(std::ranges::find(order, axes.of_space[axis]) - order.begin()) +
        (sizes.size() == 5 ? 1 : 0);
    size[static_cast<int>(axis)] = sizes[has_all ? axes.of_space[axis] : among];
  }
  return size;
}

// Scales with a number for every element, in even steps.
bool takeScales(const Hdf5Axes& axes, const std::vector<Hdf5Scale>& scales, VolumeInfo& info) {
  if (scales.empty()) return false;
  GridGeometry geometry = info.geometry;
  std::array<std::string, 3> units;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Hdf5Scale& scale = scales[axes.of_space[axis]];
    const int a = static_cast<int>(axis);
    if (static_cast<std::int64_t>(scale.values.size()) != info.voxels[a]) return false;
    const double first = scale.values.front();
    const double step =
        (scale.values.back() - first) / static_cast<double>(scale.values.size() - 1);
    double furthest = 0;
    for (std::size_t i = 0; i < scale.values.size(); ++i)
      furthest =
          std::max(furthest, std::abs(scale.values[i] - (first + step * static_cast<double>(i))));
    constexpr double kMostVoxels = 0.01;
    if (!(furthest <= kMostVoxels * std::abs(step)))
      throw unusableDataset(info.source, "the steps of its axis ", quotedText(scale.name, 40),
                            " are uneven, up to ", furthest / std::abs(step),
                            " voxels off; give it a spacing, or resample it to even steps");
    geometry.spacing[a] = step;
    geometry.origin[a] = first;
    units[axis] = scale.units;
  }
  info.geometry = geometry;
  takeLengthUnits(units, info);
  return true;
}

bool takeResolutions(const Hdf5Axes& axes, GridGeometry& geometry) {
  if (axes.resolutions.empty()) return false;
  glm::dvec3 steps;
  for (std::size_t axis = 0; axis < 3; ++axis)
    steps[static_cast<int>(axis)] = axes.resolutions[axes.of_space[axis]];
  if (!(steps.x > 0 && steps.y > 0 && steps.z > 0)) return false;
  geometry.spacing = steps;
  return true;
}

}  // namespace

void placeHdf5(hid_t dataset, const Hdf5Choice& choice, const Hdf5Axes& axes,
               const std::vector<Hdf5Scale>& scales, bool is_spacing_given, VolumeInfo& info) {
  const auto takeMicrometres = [&] {
    const auto size = elementSize(dataset, axes);
    if (size) info.geometry.spacing = *size;
    if (size) takeLengthUnits({"um", "um", "um"}, info);
    return size.has_value();
  };
  if (takeOwnAttributes(dataset, info.geometry)) {
  } else if (choice.geometry) {
    info.geometry = *choice.geometry;
    takeLengthUnits({choice.unit, choice.unit, choice.unit}, info);
  } else if (!takeMicrometres() && !is_spacing_given && !takeScales(axes, scales, info) &&
             !takeResolutions(axes, info.geometry)) {
    info.notes.push_back("the dataset says no spacing; 1 was used");
  }
  tidyGeometry(splitHdf5Name(info.source).first, info.geometry, info.voxels, info.notes);
}

}  // namespace isobrick
