#include "tools/failure_text.h"

#include <algorithm>
#include <cctype>

namespace isobrick {
namespace {

using Texts = std::vector<std::string>;

// The first text whose options the command has is the one; the last one needs none of its options.
Texts advicesOf(Remedy remedy) {
  const auto choose = [](const std::string& what) {
    return Texts{"take one with --select " + what,
                 "'isobrick build' takes one with --select " + what};
  };
  switch (remedy) {
    case Remedy::kAllowMoreMemory:
      return {"give so much with --memory", "it needs more memory than is allowed here"};
    case Remedy::kUseLessMemory:
      return {"give a smaller --memory or fewer --threads", "close other programs"};
    case Remedy::kOtherFolder:
      return {"choose another folder with -o", "choose another folder"};
    case Remedy::kPack:
      return {"pack it with --codec", "write less"};
    case Remedy::kReplaceNotFinite:
      return {
          "give the value to put there with --nan-as V, or leave out the cells beside NaN with "
          "--mask-nan",
          "leave out the cells beside NaN with --mask-nan",
          "'isobrick build' puts a value there with --nan-as V"};
    case Remedy::kResume:
      return {"go on with --resume, or delete it", "delete it"};
    case Remedy::kBeginAnew:
      return {"leave out --resume to begin anew", "delete it to begin anew"};
    case Remedy::kDescribeRawFile:
      return {
          "a file without a header needs --raw-dims X,Y,Z and --raw-type T (and --raw-endian, "
          "--raw-offset, --spacing where they are not little, 0 and 1,1,1)",
          "'isobrick build' reads a file without a header with --raw-dims X,Y,Z and --raw-type "
          "T"};
    case Remedy::kCorrectRawLayout:
      return {"check --raw-dims, --raw-type and --raw-offset", "check how its voxels lie"};
    case Remedy::kDicomAsFloat32:
      return {"give --dicom-float32", "'isobrick build' takes it with --dicom-float32"};
    case Remedy::kBuildWithCurvature:
      return {"build it anew with 'isobrick build', without --no-curvature"};
    case Remedy::kChooseComponent:
      return choose("component=N, or the root of their squares with --select component=magnitude");
    case Remedy::kWholeFloats:
      return {"leave out --half, or bring the values into range with --window LO,HI and --type T",
              "write whole floats"};
    case Remedy::kPackMesh:
      return {"pack it with --meshopt", "extract less"};
    case Remedy::kChooseStack:
      return choose("grid=NAME");
    case Remedy::kChooseTime:
      return choose("time=T");
    case Remedy::kChooseVariant:
      return choose("channel=C");
    case Remedy::kChooseImage:
      return choose("image=N");
    case Remedy::kChooseSeries:
      return choose("series=NUMBER or --select series=UID");
  }
  return {"see the documentation"};
}

}  // namespace

std::vector<std::string> optionsNamedIn(const std::string& text) {
  std::vector<std::string> options;
  const auto isWord = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0; };
  for (std::size_t at = text.find('-'); at != std::string::npos; at = text.find('-', at + 1)) {
    if (at > 0 && (isWord(text[at - 1]) || text[at - 1] == '-')) continue;  // as in "non-zero"
    std::size_t end = at;
    while (end < text.size() && (isWord(text[end]) || text[end] == '-')) ++end;
    const std::string word = text.substr(at, end - at);
    if (word == "-o" || (word.starts_with("--") && word.size() > 2)) options.push_back(word);
    at = end - 1;
  }
  return options;
}

std::string adviceOf(Remedy remedy, const HasOption& has) {
  const Texts texts = advicesOf(remedy);
  const auto fits = [&](const std::string& text) {
    const std::vector<std::string> options = optionsNamedIn(text);
    return std::all_of(options.begin(), options.end(), has);
  };
  const auto found = std::find_if(texts.begin(), texts.end() - 1, fits);
  return *found;
}

std::string failureText(const std::exception& failure, const HasOption& has) {
  std::string text = failure.what();
  if (const auto* const error = dynamic_cast<const Error*>(&failure))
    for (const Remedy remedy : error->remedies()) text += "; " + adviceOf(remedy, has);
  return text;
}

}  // namespace isobrick
