#include "tools/failure_text.h"

#include "isobrick/storage/error.h"

namespace isobrick {
namespace {

const char* adviceOf(Remedy remedy) {
  switch (remedy) {
    case Remedy::kAllowMoreMemory:
      return "give so much with --memory";
    case Remedy::kUseLessMemory:
      return "give a smaller --memory or fewer --threads";
    case Remedy::kOtherFolder:
      return "choose another folder with -o";
    case Remedy::kPack:
      return "pack it with --codec";
    case Remedy::kReplaceNotFinite:
      return "give the value to put there with --nan-as V";
    case Remedy::kResume:
      return "go on with --resume, or delete it";
    case Remedy::kBeginAnew:
      return "leave out --resume to begin anew";
    case Remedy::kDescribeRawFile:
      return "a file without a header needs --raw-dims X,Y,Z and --raw-type T (and --raw-endian, "
             "--raw-spacing, --raw-offset where they are not little, 1,1,1 and 0)";
    case Remedy::kCorrectRawLayout:
      return "check --raw-dims, --raw-type and --raw-offset";
    case Remedy::kDicomAsFloat32:
      return "give --dicom-float32";
    case Remedy::kBuildWithCurvature:
      return "build it without --no-curvature to use a tolerance";
    case Remedy::kChooseComponent:
      return "take one with --component N, or the root of their squares with --component magnitude";
  }
  return "";
}

}  // namespace

std::string failureText(const std::exception& failure) {
  std::string text = failure.what();
  if (const auto* const error = dynamic_cast<const Error*>(&failure))
    for (const Remedy remedy : error->remedies()) text += std::string("; ") + adviceOf(remedy);
  return text;
}

}  // namespace isobrick
