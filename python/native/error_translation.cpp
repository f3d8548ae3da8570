#include "error_translation.h"

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

namespace nb = nanobind;

namespace isobrick::python {
namespace {

void raise(const char* name, const Error& error) {
  const nb::object type = nb::module_::import_("isobrick._errors").attr(name);
  const ErrorPlace& place = error.place();
  nb::object path = nb::none(), offset = nb::none(), level = nb::none(), brick = nb::none();
  if (!place.path.empty())
    path = nb::steal(PyUnicode_DecodeFSDefaultAndSize(place.path.data(),
                                                      static_cast<Py_ssize_t>(place.path.size())));
  if (place.offset) offset = nb::cast(*place.offset);
  if (place.level) level = nb::cast(*place.level);
  if (place.brick) brick = nb::make_tuple(place.brick->x, place.brick->y, place.brick->z);
  const nb::object text = nb::steal(PyUnicode_DecodeFSDefault(error.what()));
  const nb::object exception = type(text, path, offset, level, brick);
  PyErr_SetObject(type.ptr(), exception.ptr());
}

}  // namespace

void translateErrors() {
  nb::register_exception_translator([](const std::exception_ptr& pointer, void*) {
    try {
      std::rethrow_exception(pointer);
    } catch (const Cancelled& error) {
      raise("Cancelled", error);
    } catch (const Error& error) {
      raise("Error", error);
    }
  });
}

}  // namespace isobrick::python
