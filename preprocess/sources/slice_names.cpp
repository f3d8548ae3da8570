#include "isobrick/preprocess/sources/slice_names.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "isobrick/preprocess/input_file.h"
#include "isobrick/preprocess/number_text.h"
#include "isobrick/preprocess/path_error.h"
#include "isobrick/preprocess/sources/format_sources.h"
#include "isobrick/preprocess/sources/source_checks.h"
#include "isobrick/storage/error.h"
#include "isobrick/storage/file_system.h"
#include "isobrick/storage/lowercase.h"

namespace isobrick {

namespace fs = std::filesystem;

namespace {

bool beginsAsDicom(const fs::path& path) {
  constexpr std::streamoff kPreambleBytes = 128;
  std::ifstream file(path, std::ios::binary);
  char magic[4] = {};
  return file.seekg(kPreambleBytes) && file.read(magic, sizeof magic) &&
         std::string_view(magic, sizeof magic) == "DICM";
}

// A name, and the numbers in it.
struct NumberedSlice {
  std::string path;
  std::string kind;                   // the name in lower case with '#' for each number
  std::vector<std::int64_t> numbers;  // without their signs
  std::string signs;                  // before each: '+', '-' or ' '
};

NumberedSlice numberedSlice(const std::string& path) {
  NumberedSlice slice{path, {}, {}, {}};
  const std::string name = lowercase(fs::path(path).stem().string());
  constexpr std::string_view kDigits = "0123456789";
  for (std::size_t i = 0; i < name.size();) {
    const std::size_t end = std::min(name.find_first_not_of(kDigits, i), name.size());
    const auto number = numberIn<std::int64_t>(name.substr(i, end - i));
    std::string& kind = slice.kind;
    if (!number) {
      // Letters, and runs of digits that are too long.
      kind.append(name, i, std::max<std::size_t>(end - i, 1));
    } else {
      // Behind another number it is a hyphen.
      const bool has_sign = (kind.ends_with('-') || kind.ends_with('+')) &&
                            !(kind.size() > 1 && kind[kind.size() - 2] == '#');
      slice.signs += has_sign ? kind.back() : ' ';
      if (has_sign) kind.pop_back();
      slice.numbers.push_back(*number);
      kind += '#';
    }
    i = std::max(end, i + 1);
  }
  return slice;
}

// Numbers at one place of all names that differ.
struct NumberPlace {
  std::size_t at;
  std::string word;  // before them
  std::set<std::int64_t> values;

  bool isOf(std::initializer_list<std::string_view> words) const {
    return std::ranges::count(words, word) > 0;
  }
  bool isChannel() const { return isOf({"c", "ch", "chan", "channel", "w", "wavelength"}); }
  bool isTime() const { return isOf({"t", "tp", "time", "timepoint", "frame"}); }
};

// "ch" of "rec_ch", which is in front of a number.
std::string wordBefore(std::string text) {
  const auto isLetter = [](char c) { return c >= 'a' && c <= 'z'; };
  while (!text.empty() && !isLetter(text.back())) text.pop_back();
  std::size_t first = text.size();
  while (first > 0 && isLetter(text[first - 1])) --first;
  return text.substr(first);
}

std::vector<NumberPlace> placesThatDiffer(const std::vector<NumberedSlice>& slices) {
  std::vector<NumberPlace> places;
  std::size_t before = 0;
  for (std::size_t i = 0; i < slices.front().numbers.size(); ++i) {
    const std::string& kind = slices.front().kind;
    const std::size_t at = kind.find('#', before);
    NumberPlace place{i, wordBefore(kind.substr(before, at - before)), {}};
    for (const NumberedSlice& slice : slices) place.values.insert(slice.numbers[i]);
    if (place.values.size() > 1) places.push_back(std::move(place));
    before = at + 1;
  }
  return places;
}

// Signs count if there are several at one place; a single one is a hyphen.
void applySigns(std::vector<NumberedSlice>& slices) {
  for (std::size_t i = 0; i < slices.front().numbers.size(); ++i) {
    const bool has_several = std::ranges::any_of(slices, [&](const NumberedSlice& slice) {
      return slice.signs[i] != slices.front().signs[i];
    });
    for (NumberedSlice& slice : slices)
      if (has_several && slice.signs[i] == '-') slice.numbers[i] = -slice.numbers[i];
  }
}

std::string fileName(const std::string& path) {
  return quotedText(fs::path(path).filename().string(), 80);
}

// The names of most files; a few others are left out with a note.
std::vector<NumberedSlice> namesOfOneKind(const std::vector<std::string>& files, VolumeInfo& info) {
  std::map<std::string, std::vector<NumberedSlice>> kinds;
  for (const std::string& file : files) {
    NumberedSlice slice = numberedSlice(file);
    kinds[slice.kind].push_back(std::move(slice));
  }
  std::vector<NumberedSlice> slices;
  if (kinds.size() == files.size()) return slices;
  for (const auto& [kind, names] : kinds)
    if (names.size() > slices.size()) slices = names;
  std::string list;
  for (const auto& [kind, names] : kinds) {
    constexpr std::size_t kMostCharacters = 300;
    if (kind == slices.front().kind || list.size() > kMostCharacters) continue;
    list += (list.empty() ? "" : ", ") + fileName(names.front().path);
    if (names.size() > 1) list += concat(" and ", names.size() - 1, " more like it");
  }
  const std::size_t others = files.size() - slices.size();
  if (4 * others > slices.size())
    throw unusable(info.source, "beside names like ", fileName(slices.front().path), " it has ",
                   list, "; keep only the slices of one volume in the folder");
  if (others > 0) info.notes.push_back("left out, as names not like those of the slices: " + list);
  applySigns(slices);
  std::ranges::sort(slices, {}, &NumberedSlice::numbers);
  return slices;
}

// The number that counts the slices if each file is one: it grows from name to name, in even steps
// if one does.
std::optional<std::size_t> countingPlace(const std::vector<NumberedSlice>& slices,
                                         const std::vector<NumberPlace>& places) {
  std::optional<std::size_t> found;
  for (const NumberPlace& place : places) {
    std::set<std::int64_t> steps;
    for (std::size_t i = 1; i < slices.size(); ++i)
      steps.insert(slices[i].numbers[place.at] - slices[i - 1].numbers[place.at]);
    const bool grows = *steps.begin() > 0;
    if (!grows && (place.isChannel() || place.isTime())) return std::nullopt;
    if (grows && (!found || steps.size() == 1)) {
      found = place.at;
      if (steps.size() == 1) return found;
    }
  }
  return found;
}

// Of names with numbers of channels or times beside those of slices: leaves the chosen ones, and
// returns the place of the slices' numbers.
std::size_t chooseAmong(std::vector<NumberedSlice>& slices, const std::vector<NumberPlace>& places,
                        const OpenOptions& options, VolumeInfo& info) {
  std::string list;
  std::size_t product = 1;
  std::vector<const NumberPlace*> channels, times, others;
  for (const NumberPlace& place : places) {
    (place.isChannel() ? channels : place.isTime() ? times : others).push_back(&place);
    product *= std::min(place.values.size(), slices.size() + 1);
    list += concat(list.empty() ? "" : " and ", place.word.empty() ? "" : "'" + place.word + "' ",
                   *place.values.begin(), " to ", *place.values.rbegin());
    if (product > slices.size()) break;
  }
  if (product != slices.size())
    throw unusable(info.source, "the numbers in its names (", list, ") have gaps: ", slices.size(),
                   " files do not make all pairs of them; add what is missing, or keep one volume "
                   "in the folder");
  if (others.size() != 1 || channels.size() > 1 || times.size() > 1)
    throw unusable(info.source, "the numbers in its names (", list,
                   ") do not say which of them count slices; keep one volume in the folder, or "
                   "call channels and times _c and _t");
  const auto take = [&](const std::vector<const NumberPlace*>& kind, const char* what,
                        std::optional<std::int64_t> wanted) {
    const std::int64_t count = kind.empty() ? 1 : std::ssize(kind.front()->values);
    const std::int64_t taken = takeOne(info.source, what, wanted, count, info);
    if (kind.empty()) return;
    const std::int64_t number = *std::next(kind.front()->values.begin(), taken);
    std::erase_if(slices, [&](const NumberedSlice& slice) {
      return slice.numbers[kind.front()->at] != number;
    });
  };
  take(channels, "channel", options.channel);
  take(times, "time step", options.time);
  return others.front()->at;
}

// Throws Error if the numbers of slices go on in steps that are not even.
void refuseGaps(const std::vector<NumberedSlice>& slices, std::size_t at, const VolumeInfo& info) {
  const auto step = [&](std::size_t i) {
    return slices[i].numbers[at] - slices[i - 1].numbers[at];
  };
  std::int64_t least = INT64_MAX;
  for (std::size_t i = 1; i < slices.size(); ++i) least = std::min(least, step(i));
  ListText gaps(", ", 5);
  for (std::size_t i = 1; i < slices.size(); ++i)
    if (step(i) != least) gaps.add(fileName(slices[i - 1].path), " and ", fileName(slices[i].path));
  if (!gaps.text().empty())
    throw unusable(info.source, "slices are missing between ", gaps.text(),
                   ", by the numbers in their names; add them, or number what is there anew");
}

}  // namespace

std::vector<std::string> filesInFolder(const std::string& folder) {
  std::vector<std::string> files;
  const std::error_code failure = visitFolder(folder, [&](const FolderMember& member) {
    if (member.isRegularFile())
      files.push_back(member.path().string());
    else if (!member.isFolder() && !member.name().starts_with('.'))
      static_cast<void>(InputFile(member.path().string()));  // refuses: a slice would be missing
    return true;
  });
  if (failure)
    throw fileError(folder, "cannot read the folder '", folder, "': ", failure.message(),
                    "; check its permissions");
  std::ranges::sort(files);
  return files;
}

std::vector<std::string> filesBelowFolder(const std::string& folder) {
  constexpr std::size_t kMostFolders = 100000;
  std::vector<std::string> files, folders = {folder};
  for (std::size_t i = 0; i < folders.size(); ++i)
    visitFolder(folders[i], [&](const FolderMember& member) {
      if (member.isRegularFile()) files.push_back(member.path().string());
      if (member.isFolder() && !member.isLink() && folders.size() < kMostFolders)
        folders.push_back(member.path().string());
      return true;
    });
  std::ranges::sort(files);
  return files;
}

std::vector<std::string> chooseSlices(const std::vector<std::string>& files,
                                      const OpenOptions& options, VolumeInfo& info) {
  std::vector<NumberedSlice> slices = namesOfOneKind(files, info);
  if (slices.empty()) return files;
  const auto twins = std::ranges::adjacent_find(slices, {}, &NumberedSlice::numbers);
  if (twins != slices.end())
    throw unusable(info.source, fileName(twins->path), " and ", fileName((twins + 1)->path),
                   " have the same number; keep one of them");
  const std::vector<NumberPlace> places = placesThatDiffer(slices);
  if (places.size() == 1 && places.front().isOf({"ch", "chan", "channel"}))
    throw unusable(
        info.source,
        "its files are channels of one slice by their names; name the folder of a volume");
  const auto counting = countingPlace(slices, places);
  const std::size_t at = counting && !options.time && !options.channel
                             ? *counting
                             : chooseAmong(slices, places, options, info);
  refuseGaps(slices, at, info);
  std::vector<std::string> paths;
  for (NumberedSlice& slice : slices) paths.push_back(std::move(slice.path));
  return paths;
}

bool numericNameLess(const std::string& a, const std::string& b) {
  const auto isDigit = [](char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (isDigit(a[i]) && isDigit(b[j])) {
      while (i < a.size() && a[i] == '0') ++i;
      while (j < b.size() && b[j] == '0') ++j;
      const std::size_t first_i = i, first_j = j;
      while (i < a.size() && isDigit(a[i])) ++i;
      while (j < b.size() && isDigit(b[j])) ++j;
      if (i - first_i != j - first_j) return i - first_i < j - first_j;
      const int order = a.compare(first_i, i - first_i, b, first_j, j - first_j);
      if (order != 0) return order < 0;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (i == a.size() && j == b.size()) return a < b;  // "01" and "1": any fixed order
  return i == a.size();
}

bool hasExrSlices(const std::string& folder) {
  std::int64_t exr = 0, others = 0;
  visitFolder(folder, [&](const FolderMember& member) {
    const std::string ending = lowerExtension(member.path());
    if (ending == ".exr") ++exr;
    if (ending == ".tif" || ending == ".tiff" || ending == ".png") ++others;
    return true;
  });
  if (exr == 0) return false;
  // A stray picture does not decide the kind of a folder.
  visitFolder(folder, [&](const FolderMember& member) {
    if (member.isRegularFile() && beginsAsDicom(member.path())) ++others;
    return true;
  });
  return exr > others;
}

}  // namespace isobrick
