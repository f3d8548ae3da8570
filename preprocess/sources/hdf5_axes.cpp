#include "isobrick/preprocess/sources/hdf5_axes.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>

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
    const auto json = nlohmann::json::parse(text, nullptr, false);
    if (!json.is_object() || !json.contains("axes") || !json["axes"].is_array() ||
        json["axes"].size() != dims_.size())
      return false;
    for (std::size_t i = 0; i < dims_.size(); ++i) {
      const auto& axis = json["axes"][i];
      if (!axis.is_object() || !axis.contains("key") || !axis["key"].is_string()) return false;
      names_[i] = axis["key"].get<std::string>();
      roles_[i] = roleOf(names_[i]);
      const bool has_number = axis.contains("resolution") && axis["resolution"].is_number();
      axes_.resolutions.push_back(has_number ? axis["resolution"].get<double>() : 0);
    }
    return true;
  }

  bool isOfSpace(std::size_t i) const {
    return std::find(axes_.of_space.begin(), axes_.of_space.end(), i) != axes_.of_space.end();
  }

  bool findByName() {
    constexpr std::array kRoles = {Role::kX, Role::kY, Role::kZ};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (std::count(roles_.begin(), roles_.end(), kRoles[axis]) != 1) return false;
      axes_.of_space[axis] = static_cast<std::size_t>(
          std::find(roles_.begin(), roles_.end(), kRoles[axis]) - roles_.begin());
    }
    return true;
  }

  // The last three that have more than one element, or else the last three.
  void findByPlace() {
    std::vector<std::size_t> candidates;
    for (std::size_t i = dims_.size(); i-- > 0;)
      if (roles_[i] != Role::kTime && roles_[i] != Role::kChannel) candidates.push_back(i);
    if (candidates.size() < 3)
      throw refused("its axes are " + axesText() + ", and a volume has three of space");
    std::stable_partition(candidates.begin(), candidates.end(),
                          [&](std::size_t i) { return dims_[i] != 1; });
    candidates.resize(3);
    std::sort(candidates.rbegin(), candidates.rend());
    std::copy(candidates.begin(), candidates.end(), axes_.of_space.begin());
  }

  void fixOthers() {
    std::vector<std::size_t> further;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      if (!isOfSpace(i) && dims_[i] != 1) further.push_back(i);
    if (further.size() > 2)
      throw refused("it has the axes " + axesText() +
                    ", and beside three of space two are read; write a part of it to a file");
    if (further.size() == 2) {
      const bool are_turned =
          roles_[further[0]] == Role::kChannel || roles_[further[1]] == Role::kTime;
      fix(further[are_turned ? 1 : 0], "time", time_, Remedy::kChooseTime);
      fix(further[are_turned ? 0 : 1], "channel", channel_, Remedy::kChooseVariant);
    } else if (further.size() == 1) {
      // One number is enough to tell which, whatever the axis is called.
      const bool is_time = roles_[further[0]] == Role::kTime;
      auto& own = is_time ? time_ : channel_;
      auto& other = is_time ? channel_ : time_;
      if (!own) std::swap(own, other);
      fix(further[0], is_time ? "time" : "channel", own,
          is_time ? Remedy::kChooseTime : Remedy::kChooseVariant);
    }
    refuseUnused("time", time_, Role::kTime);
    refuseUnused("channel", channel_, Role::kChannel);
  }

  void fix(std::size_t axis, const char* kind, std::optional<std::int64_t>& wanted, Remedy remedy) {
    const std::string kinds = std::string("'") + name_ + "' has the " + kind + "s 0 to " +
                              std::to_string(dims_[axis] - 1);
    if (!wanted) throw Error(kinds + "; one is a volume", place(), {remedy});
    if (*wanted < 0 || static_cast<hsize_t>(*wanted) >= dims_[axis])
      throw Error(kinds + ", and not " + std::to_string(*wanted) + "; choose one of these",
                  place());
    axes_.fixed[axis] = static_cast<hsize_t>(*wanted);
    axes_.encoding +=
        (axes_.encoding.empty() ? "" : ", ") + std::string(kind) + " " + std::to_string(*wanted);
    wanted.reset();
  }

  // An axis of one element has the index 0, and so has one that is not there.
  void refuseUnused(const char* kind, const std::optional<std::int64_t>& wanted, Role role) const {
    if (wanted.value_or(0) == 0) return;
    bool has_one = false;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      has_one |= !isOfSpace(i) && (roles_[i] == role || roles_[i] == Role::kUnknown);
    throw refused(std::string("it has ") + (has_one ? "one " : "no ") + kind +
                  (has_one ? ", number 0" : " to choose: its axes are " + axesText()) +
                  "; leave the choice of " + kind + " " + std::to_string(*wanted) + " out");
  }

  // "z 10, y 20, x 24", or without names "10 x 20 x 24".
  std::string axesText() const {
    const bool have_names = std::all_of(names_.begin(), names_.end(),
                                        [](const std::string& name) { return !name.empty(); });
    std::string text;
    for (std::size_t i = 0; i < dims_.size(); ++i)
      text += (i == 0       ? ""
               : have_names ? ", "
                            : " x ") +
              (have_names ? quotedText(names_[i], 20) + " " : "") + std::to_string(dims_[i]);
    return text;
  }

  ErrorPlace place() const { return {.path = splitHdf5Name(name_).first}; }
  Error refused(const std::string& why) const {
    return Error("cannot use '" + name_ + "': " + why, place());
  }

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

}  // namespace isobrick
