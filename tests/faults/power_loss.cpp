#include "tests/faults/power_loss.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <set>

#include "isobrick/storage/checksum.h"
#include "tests/support/file_bytes.h"
#include "tests/support/random_numbers.h"

namespace isobrick::test {
namespace {

constexpr std::uint64_t kPage = 4096, kSector = 512;

std::uint64_t hashOf(std::uint64_t a, std::uint64_t b) {
  const std::uint64_t numbers[] = {a, b};
  return checksum64(numbers, sizeof numbers);
}
std::uint64_t hashOf(const FolderContent& content) {
  std::uint64_t hash = 0;
  for (const auto& [name, bytes] : content)
    hash = checksum64(bytes.data(), bytes.size(), checksum64(name.data(), name.size(), hash));
  return hash;
}

void writeInto(std::string& file, std::uint64_t offset, const char* data, std::size_t bytes) {
  if (file.size() < offset + bytes) file.resize(offset + bytes);
  file.replace(offset, bytes, data, bytes);
}

std::string parentOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

}  // namespace

// What need not be there: changes of names (and truncations, where they are in one order with
// these), and units of bytes: a page of a write, or a truncation.
struct PowerLoss::Pending {
  struct Unit {
    std::size_t step;
    std::uint64_t page;  // of the file
  };
  std::vector<std::size_t> names;
  std::vector<Unit> units;
  std::vector<std::size_t>
      first_unit;  // of each step; kNoObject: it is durable, or among the names
  bool names_are_ordered = false;
};

struct PowerLoss::Choice {
  std::vector<bool> names;  // which of the pending ones are there
  enum class Units { kMask, kUpTo, kTorn, kAllBut, kOnly, kRandom, kRandomSectors } units;
  std::uint64_t number = 0;  // the mask, the unit or the seed
  bool sizes_first = false;

  bool has(std::size_t unit, std::uint64_t sector) const {
    switch (units) {
      case Units::kMask:
        return unit >= 64 ? number == ~std::uint64_t{0} : (number >> unit & 1) != 0;
      case Units::kUpTo:
        return unit < number;
      case Units::kTorn:  // and the first half of that page
        return unit < number || (unit == number && sector % (kPage / kSector) < 4);
      case Units::kAllBut:
        return unit != number;
      case Units::kOnly:
        return unit == number;
      case Units::kRandom:
        return (hashOf(number, unit) & 1) != 0;
      case Units::kRandomSectors:
        break;
    }
    return (hashOf(number, hashOf(unit, sector)) & 1) != 0;
  }
};

PowerLoss::PowerLoss(const std::vector<Change>& changes) {
  std::map<std::string, std::size_t> at;         // the object of each name, as the process saw it
  std::map<std::uint64_t, std::size_t> of_node;  // the last one, as inodes are used again
  const auto leaf = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  const auto name = [&](const std::string& path, std::size_t object) {
    return Name{at.at(parentOf(path)), leaf(path), object};
  };
  // Names of what is in a folder that moves go with it.
  const auto moveAll = [&](const std::string& from, const std::string& to,
                           std::map<std::string, std::size_t>& into) {
    for (auto entry = at.begin(); entry != at.end();) {
      const bool is_it = entry->first == from || entry->first.rfind(from + "/", 0) == 0;
      if (is_it) into[to + entry->first.substr(from.size())] = entry->second;
      entry = is_it ? at.erase(entry) : std::next(entry);
    }
  };
  for (const Change& change : changes) {
    Step step;
    step.kind = change.kind;
    step.offset = change.offset;
    switch (change.kind) {
      case ChangeKind::kFolder:
      case ChangeKind::kFile: {
        const std::size_t object = object_is_folder_.size();
        object_is_folder_.push_back(change.kind == ChangeKind::kFolder);
        of_node[change.node] = object;
        if (!change.path.empty()) step.names = {name(change.path, object)};
        at[change.path] = object;
        step.kind = ChangeKind::kRename;
        break;
      }
      case ChangeKind::kLink:
        step.names = {name(change.other, at.at(change.path))};
        at[change.other] = at.at(change.path);
        step.kind = ChangeKind::kRename;
        break;
      case ChangeKind::kRename:
      case ChangeKind::kExchange: {
        const bool exchanges = change.kind == ChangeKind::kExchange;
        step.names = {name(change.path, exchanges ? at.at(change.other) : kNoObject),
                      name(change.other, at.at(change.path))};
        std::map<std::string, std::size_t> moved, dropped;
        moveAll(change.path, change.other, moved);
        moveAll(change.other, change.path, exchanges ? moved : dropped);
        at.merge(moved);
        step.kind = ChangeKind::kRename;
        break;
      }
      case ChangeKind::kRemove:
        if (at.erase(change.path) == 0) continue;
        step.names = {name(change.path, kNoObject)};
        step.kind = ChangeKind::kRename;
        break;
      case ChangeKind::kWrite:
        step.bytes = change.other;
        [[fallthrough]];
      case ChangeKind::kTruncate:
      case ChangeKind::kSync:
        step.object = of_node.at(change.node);
        break;
      case ChangeKind::kSyncAll:
        if (begin_ == 0) begin_ = steps_.size() + 1;
        break;
    }
    steps_.push_back(std::move(step));
  }
}

std::vector<PowerLoss::Object> PowerLoss::noObjects() const {
  std::vector<Object> objects(object_is_folder_.size());
  for (std::size_t i = 0; i < objects.size(); ++i) objects[i].is_folder = object_is_folder_[i];
  return objects;
}

void PowerLoss::apply(const Step& step, std::vector<Object>& objects) {
  if (step.kind == ChangeKind::kWrite)
    writeInto(objects[step.object].bytes, step.offset, step.bytes.data(), step.bytes.size());
  if (step.kind == ChangeKind::kTruncate) objects[step.object].bytes.resize(step.offset);
  for (const Name& name : step.names)
    if (name.object == kNoObject)
      objects[name.folder].names.erase(name.name);
    else
      objects[name.folder].names[name.name] = name.object;
}

FolderContent PowerLoss::contentOf(const std::vector<Object>& objects) const {
  FolderContent content;
  const std::function<void(std::size_t, const std::string&)> walk = [&](std::size_t folder,
                                                                        const std::string& path) {
    for (const auto& [name, object] : objects[folder].names) {
      content[path + name + (objects[object].is_folder ? "/" : "")] = objects[object].bytes;
      if (objects[object].is_folder) walk(object, path + name + "/");
    }
  };
  walk(0, "");
  return content;
}

FolderContent PowerLoss::contentAt(std::size_t moment) const {
  std::vector<Object> objects = noObjects();
  for (std::size_t i = 0; i < moment; ++i) apply(steps_[i], objects);
  return contentOf(objects);
}

bool PowerLoss::isDurable(std::size_t step, std::size_t moment, DiskModel model) const {
  const Step& change = steps_[step];
  const auto isSynced = [&](std::size_t object) {
    for (std::size_t i = step + 1; i < moment; ++i) {
      if (steps_[i].kind == ChangeKind::kSyncAll) return true;
      if (steps_[i].kind != ChangeKind::kSync) continue;
      // One journal has the names of all files.
      if (steps_[i].object == object ||
          (model == DiskModel::kOrdered && change.kind != ChangeKind::kWrite))
        return true;
    }
    return false;
  };
  if (change.kind != ChangeKind::kRename) return isSynced(change.object);
  return std::all_of(change.names.begin(), change.names.end(),
                     [&](const Name& name) { return isSynced(name.folder); });
}

PowerLoss::Pending PowerLoss::pendingAt(std::size_t moment, DiskModel model) const {
  Pending pending;
  pending.names_are_ordered = model == DiskModel::kOrdered;
  pending.first_unit.assign(moment, kNoObject);
  for (std::size_t i = begin_; i < moment; ++i) {
    const Step& step = steps_[i];
    if (step.kind == ChangeKind::kSync || step.kind == ChangeKind::kSyncAll ||
        isDurable(i, moment, model))
      continue;
    if (step.kind == ChangeKind::kRename ||
        (step.kind == ChangeKind::kTruncate && pending.names_are_ordered)) {
      pending.names.push_back(i);
      continue;
    }
    pending.first_unit[i] = pending.units.size();
    if (step.kind == ChangeKind::kTruncate)
      pending.units.push_back({i, 0});
    else
      for (std::uint64_t page = step.offset / kPage;
           page <= (step.offset + step.bytes.size() - 1) / kPage; ++page)
        pending.units.push_back({i, page});
  }
  return pending;
}

FolderContent PowerLoss::stateOf(std::size_t moment, const Pending& pending,
                                 const Choice& choice) const {
  std::vector<Object> objects = noObjects();
  std::size_t next_name = 0;
  for (std::size_t i = 0; i < moment; ++i) {
    const Step& step = steps_[i];
    if (next_name < pending.names.size() && pending.names[next_name] == i) {
      if (choice.names[next_name++]) apply(step, objects);
      continue;
    }
    const std::size_t first = pending.first_unit[i];
    if (first == kNoObject) {
      apply(step, objects);
    } else if (step.kind == ChangeKind::kTruncate) {
      if (choice.has(first, 0)) apply(step, objects);
    } else {
      std::string& file = objects[step.object].bytes;
      const std::uint64_t end = step.offset + step.bytes.size();
      if (choice.sizes_first && file.size() < end) file.resize(end);
      for (std::uint64_t at = step.offset; at < end;) {
        const std::uint64_t sector = at / kSector, next = std::min(end, (sector + 1) * kSector);
        if (choice.has(first + (at / kPage - step.offset / kPage), sector))
          writeInto(file, at, step.bytes.data() + (at - step.offset), next - at);
        at = next;
      }
    }
  }
  return contentOf(objects);
}

LossCounts PowerLoss::visitStates(
    DiskModel model, std::uint64_t most_each,
    const std::function<void(const FolderContent& state, bool is_done)>& visit) const {
  LossCounts counts;
  std::set<std::uint64_t> seen;
  Random random(52);
  constexpr std::size_t kFewNames = 5, kFewUnits = 5;
  using Units = Choice::Units;
  for (std::size_t moment = begin_; moment <= steps_.size(); ++moment) {
    const Pending pending = pendingAt(moment, model);
    // Which names.
    const std::size_t n = pending.names.size();
    std::vector<std::vector<bool>> all_names;
    const bool has_few_names = !pending.names_are_ordered && n <= kFewNames;
    if (has_few_names) {
      for (std::size_t mask = 0; mask < std::size_t{1} << n; ++mask) {
        std::vector<bool>& names = all_names.emplace_back(n);
        for (std::size_t i = 0; i < n; ++i) names[i] = (mask >> i & 1) != 0;
      }
    } else {
      for (std::size_t end = 0; end <= n; ++end) {
        std::vector<bool> names(n);
        std::fill_n(names.begin(), end, true);
        all_names.push_back(names);
        if (pending.names_are_ordered || end == n) continue;
        names.assign(n, true), names[end] = false, all_names.push_back(names);
        names.assign(n, false), names[end] = true, all_names.push_back(names);
        for (std::size_t i = 0; i < n; ++i) names[i] = random() % 2 != 0;
        all_names.push_back(names);
      }
    }
    // Which bytes.
    const std::uint64_t units = pending.units.size();
    std::vector<Choice> all_units;
    const auto add = [&](Units kind, std::uint64_t number) {
      all_units.push_back({{}, kind, number, false});
      if (model == DiskModel::kWeak) all_units.push_back({{}, kind, number, true});
    };
    add(Units::kMask, ~std::uint64_t{0});
    if (units > 0 && units <= kFewUnits) {
      for (std::uint64_t mask = 0; mask + 1 < std::uint64_t{1} << units; ++mask)
        add(Units::kMask, mask);
    } else if (units > 0) {
      add(Units::kMask, 0);
      for (std::uint64_t i = 0; i < units; ++i)
        for (const Units kind : {Units::kUpTo, Units::kAllBut, Units::kOnly}) add(kind, i);
    }
    for (std::uint64_t i = 0; i < units; ++i) {
      add(Units::kTorn, i);
      add(Units::kRandom, random());
      add(Units::kRandomSectors, random());
    }
    // Both together: all, or the ones at the ends and some of the rest.
    const std::uint64_t all = all_names.size() * all_units.size();
    const bool is_complete = all <= most_each;
    std::set<std::uint64_t> chosen = {0, all - 1, all_units.size() - 1, all - all_units.size()};
    if (is_complete)
      for (std::uint64_t i = 0; i < all; ++i) chosen.insert(i);
    else
      while (chosen.size() < most_each) chosen.insert(randomBelow(random, all));
    ++counts.moments;
    counts.complete +=
        is_complete && units <= kFewUnits && (pending.names_are_ordered || has_few_names) ? 1 : 0;
    for (const std::uint64_t number : chosen) {
      Choice choice = all_units[number % all_units.size()];
      choice.names = all_names[number / all_units.size()];
      const FolderContent state = stateOf(moment, pending, choice);
      ++counts.states;
      // The end counts apart: there all must be there.
      const bool is_done = moment == steps_.size();
      if (!seen.insert(hashOf(hashOf(state), is_done)).second) continue;
      ++counts.distinct;
      visit(state, is_done);
    }
  }
  return counts;
}

std::vector<Change> readChanges(const std::string& file) {
  const std::string text = readBytes(file);
  std::vector<Change> changes;
  std::size_t at = 0;
  const auto take = [&](std::size_t bytes) {
    at += bytes;
    return text.substr(at - bytes, bytes);
  };
  while (at < text.size()) {
    std::uint64_t numbers[5];
    std::memcpy(numbers, take(sizeof numbers).data(), sizeof numbers);
    Change& change = changes.emplace_back();
    change.kind = static_cast<ChangeKind>(numbers[0]);
    change.node = numbers[1];
    change.offset = numbers[2];
    change.path = take(numbers[3]);
    change.other = take(numbers[4]);
  }
  return changes;
}

}  // namespace isobrick::test
