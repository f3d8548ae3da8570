#include "error_translation.h"

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <string>
#include <utility>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

// The parameters of Python that help; of other remedies none does.
constexpr std::pair<Remedy, const char*> kAdvices[] = {
    {Remedy::kAllowMoreMemory, "give a larger memory"},
    {Remedy::kUseLessMemory, "give a smaller memory, or fewer threads"},
    {Remedy::kOtherFolder, "choose another folder"},
    {Remedy::kPack, "give codec='zstd'"},
    {Remedy::kReplaceNotFinite,
     "replace such voxels in the array, or give build() nan_as, the value to put there, or "
     "mask_nan=True"},
    {Remedy::kDescribeRawFile, "give raw=isobrick.RawLayout(shape, dtype)"},
    {Remedy::kCorrectRawLayout, "correct raw"},
    {Remedy::kBuildWithCurvature, "build the pyramid with curvature=True"},
    {Remedy::kChooseComponent, "give component"},
    {Remedy::kChooseVariant, "give channel"},
    {Remedy::kChooseTime, "give time"},
    {Remedy::kChooseStack, "give grid"},
    {Remedy::kChooseSeries, "give series"},
    {Remedy::kChooseImage, "give image"},
    {Remedy::kPackMesh, "give meshopt=True"},
};

std::string textOf(const Error& error) {
  std::string text = error.what();
  const char* joint = "; ";
  for (const Remedy remedy : error.remedies())
    for (const auto& [of, advice] : kAdvices) {
      if (of != remedy) continue;
      text.append(joint).append(advice);
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
