// Pyramids in Python.
#pragma once

#include <isobrick/isobrick.h>
#include <nanobind/nanobind.h>

#include <memory>
#include <string>

namespace isobrick::python {

// An open pyramid that lives as long as anything of it is held, until abandon().
class PyramidHandle {
 public:
  // `cache_folder` and `cache_bytes` as of RemoteOptions.
  PyramidHandle(const std::string& path, std::uint64_t budget_bytes, bool is_mapped,
                const std::string& cache_folder, std::uint64_t cache_bytes);

  // Throws Error after close() and abandon().
  const std::shared_ptr<const Pyramid>& pyramid() const;
  // Gives this handle's share up.
  void close() { pyramid_.reset(); }
  // The same in a child of fork(): threads and locks of the pyramid are not what they were there,
  // so its memory is not given back.
  void abandon();

 private:
  std::shared_ptr<const Pyramid> pyramid_;
};

// Adds class PyramidHandle to the module.
void bindPyramid(nanobind::module_& module);

}  // namespace isobrick::python
