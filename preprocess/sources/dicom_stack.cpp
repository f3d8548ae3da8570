#include "isobrick/preprocess/sources/dicom_stack.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>

#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/dicom_values.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

// Nearer than this share of their mean distance, slices are at the same position.
constexpr double kSamePosition = 1e-4;
constexpr double kMostUneven = 0.1, kNotedUneven = 0.01;

bool haveAllPositions(const std::vector<DicomPlace>& places) {
  return std::all_of(places.begin(), places.end(),
                     [](const DicomPlace& place) { return place.position.has_value(); });
}

// Where there are no positions nobody can tell: true.
bool areSomeAtOnePosition(const std::vector<DicomPlace>& places, const glm::dvec3& normal) {
  if (!haveAllPositions(places)) return true;
  std::vector<double> heights;
  for (const DicomPlace& place : places) heights.push_back(glm::dot(*place.position, normal));
  std::sort(heights.begin(), heights.end());
  const double mean_gap = (heights.back() - heights.front()) /
                          static_cast<double>(std::max<std::size_t>(heights.size(), 2) - 1);
  for (std::size_t i = 1; i < heights.size(); ++i)
    if (heights[i] - heights[i - 1] <= kSamePosition * mean_gap) return true;
  return false;
}

void takeNoteOfChoice(const std::string& what, VolumeInfo& info) {
  info.encoding += (info.encoding.empty() ? "" : "; ") + what;
}

void chooseStack(const std::string& path, const std::string& name, std::vector<DicomPlace>& places,
                 VolumeInfo& info) {
  std::map<std::string, std::size_t> counts;
  for (const DicomPlace& place : places) ++counts[place.stack];
  if (counts.contains(name) && !name.empty()) {
    std::erase_if(places, [&](const DicomPlace& place) { return place.stack != name; });
    return takeNoteOfChoice("stack " + quotedText(name, 40), info);
  }
  if (counts.size() == 1 && name.empty()) return;
  std::string list;
  std::size_t listed = 0;
  constexpr std::size_t kMostListed = 12;
  for (const auto& [stack, count] : counts) {
    if (listed++ == kMostListed) {
      list += ", ...";
      break;
    }
    list += (list.empty() ? "" : ", ") + quotedText(stack, 40) + " (" + std::to_string(count) +
            " slices)";
  }
  if (!name.empty())
    throw unusable(path, "it has no stack of the name " + quotedText(name, 40) + "; it has " + list,
                   {Remedy::kChooseStack});
  throw unusable(path, "it holds " + std::to_string(counts.size()) + " stacks of slices: " + list,
                 {Remedy::kChooseStack});
}

// `member` of the places takes several values, each of which is a volume.
void chooseOneOf(const std::string& path, const char* what, Remedy remedy,
                 std::vector<std::int64_t> DicomPlace::*member, bool may_differ,
                 std::optional<std::int64_t> choice, std::vector<DicomPlace>& places,
                 VolumeInfo& info) {
  std::map<std::vector<std::int64_t>, std::size_t> counts;
  if (may_differ)
    for (const DicomPlace& place : places) ++counts[place.*member];
  const std::size_t count = std::max<std::size_t>(counts.size(), 1);
  if (choice && static_cast<std::uint64_t>(*choice) >= count)
    throw unusable(path,
                   std::string("it has no ") + what + " " + std::to_string(*choice) + "; it has " +
                       std::to_string(count) + ", counted from 0",
                   {remedy});
  if (count == 1) return;
  if (!choice)
    throw unusable(path,
                   "it holds " + std::to_string(count) + " volumes, of " + what + " 0 to " +
                       std::to_string(count - 1),
                   {remedy});
  const std::vector<std::int64_t> key = std::next(counts.begin(), *choice)->first;
  std::erase_if(places, [&](const DicomPlace& place) { return place.*member != key; });
  takeNoteOfChoice(std::string(what) + " " + std::to_string(*choice), info);
}

}  // namespace

void chooseDicomVolume(const DicomStackWords& words,
                       const std::function<glm::dvec3(const DicomPlace&)>& normal,
                       bool times_differ, const OpenOptions& options,
                       std::vector<DicomPlace>& places, VolumeInfo& info) {
  chooseStack(words.path, options.grid, places, info);
  chooseOneOf(words.path, "time", Remedy::kChooseTime, &DicomPlace::time,
              times_differ || areSomeAtOnePosition(places, normal(places.front())), options.time,
              places, info);
  chooseOneOf(words.path, "channel", Remedy::kChooseVariant, &DicomPlace::channel,
              areSomeAtOnePosition(places, normal(places.front())), options.channel, places, info);
}

std::optional<glm::dvec3> sortDicomSlices(const DicomStackWords& words, const glm::dvec3& normal,
                                          std::vector<DicomPlace>& places,
                                          std::vector<std::string>& notes) {
  if (!haveAllPositions(places)) {
    std::stable_sort(places.begin(), places.end(),
                     [](const DicomPlace& a, const DicomPlace& b) { return a.number < b.number; });
    return std::nullopt;
  }
  const auto height = [&](const DicomPlace& place) { return glm::dot(*place.position, normal); };
  std::stable_sort(places.begin(), places.end(),
                   [&](const DicomPlace& a, const DicomPlace& b) { return height(a) < height(b); });
  const glm::dvec3 step =
      (*places.back().position - *places.front().position) / static_cast<double>(places.size() - 1);
  const double mean_gap = glm::dot(step, normal);
  const auto fail = [&](std::size_t i, const std::string& why) {
    return unusable(words.path, places[i - 1].name + " and " + places[i].name + " are " + why);
  };
  for (std::size_t i = 1; i < places.size(); ++i)
    if (!(height(places[i]) - height(places[i - 1]) > kSamePosition * mean_gap) ||
        !std::isfinite(mean_gap))
      throw fail(i, "at the same position " + words.same_position);
  double greatest_deviation = 0;
  std::size_t at = 1;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const double deviation = std::abs(height(places[i]) - height(places[i - 1]) - mean_gap);
    if (deviation <= greatest_deviation) continue;
    greatest_deviation = deviation;
    at = i;
  }
  if (greatest_deviation > kMostUneven * mean_gap)
    throw fail(at, std::to_string(height(places[at]) - height(places[at - 1])) +
                       " mm apart and others " + std::to_string(mean_gap) + " mm on average; " +
                       words.gap);
  if (greatest_deviation > kNotedUneven * mean_gap)
    notes.push_back("slice distances differ by up to " + std::to_string(greatest_deviation) +
                    " mm; their mean was used");
  return step;
}

std::optional<glm::dvec3> dicomPosition(const std::string& text) {
  const std::vector<double> p = decimalStrings(text, 3);
  if (p.empty()) return std::nullopt;
  return glm::dvec3(p[0], p[1], p[2]);
}

}  // namespace isobrick
