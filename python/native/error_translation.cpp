#include "error_translation.h"

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <string>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

// The name in Python of the parameter that would help; null: none would.
const char* adviceOf(Remedy remedy) {
  switch (remedy) {
    case Remedy::kAllowMoreMemory:
      return "give a larger memory";
    case Remedy::kUseLessMemory:
      return "give a smaller memory, or fewer threads";
    case Remedy::kOtherFolder:
      return "choose another folder";
    case Remedy::kPack:
      return "give codec='zstd'";
    case Remedy::kReplaceNotFinite:
      return "replace such voxels in the array, or give build() nan_as, the value to put there, or "
             "mask_nan=True";
    case Remedy::kDescribeRawFile:
      return "give raw=isobrick.RawLayout(shape, dtype)";
    case Remedy::kCorrectRawLayout:
      return "correct raw";
    case Remedy::kBuildWithCurvature:
      return "build the pyramid with curvature=True";
    case Remedy::kChooseComponent:
      return "give component";
    case Remedy::kChooseVariant:
      return "give channel";
    case Remedy::kChooseTime:
      return "give time";
    case Remedy::kChooseStack:
      return "give grid";
    case Remedy::kChooseSeries:
      return "give series";
    case Remedy::kChooseImage:
      return "give image";
    case Remedy::kPackMesh:
      return "give meshopt=True";
    case Remedy::kResume:
    case Remedy::kBeginAnew:
    case Remedy::kDicomAsFloat32:
    case Remedy::kWholeFloats:
      return nullptr;
  }
  return nullptr;
}

std::string textOf(const Error& error) {
  std::string text = error.what();
  const char* joint = "; ";
  for (const Remedy remedy : error.remedies())
    if (const char* const advice = adviceOf(remedy)) {
      text += joint;
      text += advice;
      joint = ", or ";
    }
  return text;
}

// `name`: of a class, or of a function that returns an exception.
void raise(const char* name, const Error& error) {
  const nb::object make = nb::module_::import_("isobrick._errors").attr(name);
  const ErrorPlace& place = error.place();
  nb::object path = nb::none(), offset = nb::none(), level = nb::none(), brick = nb::none();
  if (!place.path.empty())
    path = nb::steal(PyUnicode_DecodeFSDefaultAndSize(place.path.data(),
                                                      static_cast<Py_ssize_t>(place.path.size())));
  if (place.offset) offset = nb::cast(*place.offset);
  if (place.level) level = nb::cast(*place.level);
  if (place.brick) brick = nb::make_tuple(place.brick->x, place.brick->y, place.brick->z);
  const nb::object text = nb::steal(PyUnicode_DecodeFSDefault(textOf(error).c_str()));
  const nb::object exception = make(text, path, offset, level, brick);
  PyErr_SetObject(exception.type().ptr(), exception.ptr());
}

}  // namespace

void translateErrors() {
  nb::register_exception_translator([](const std::exception_ptr& pointer, void*) {
    try {
      std::rethrow_exception(pointer);
    } catch (const Cancelled& error) {
      raise("Cancelled", error);
    } catch (const Error& error) {
      raise("error_of", error);
    }
  });
}

}  // namespace isobrick::python
