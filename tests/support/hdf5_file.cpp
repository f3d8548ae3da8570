#include "tests/support/hdf5_file.h"

#include <hdf5.h>

#include <stdexcept>

namespace isobrick::test {
namespace {

hid_t checked(hid_t id) {
  if (id < 0) throw std::runtime_error("HDF5 cannot write the file of a test");
  return id;
}

hid_t typeNamed(const std::string& name) {
  if (name == "u1") return H5T_STD_U8LE;
  if (name == "i2") return H5T_STD_I16LE;
  if (name == "u2") return H5T_STD_U16LE;
  if (name == ">u2") return H5T_STD_U16BE;
  if (name == "f4") return H5T_IEEE_F32LE;
  if (name == "f8") return H5T_IEEE_F64LE;
  throw std::invalid_argument(name);
}

std::vector<hsize_t> sizesOf(const std::vector<std::uint64_t>& dims) {
  return {dims.begin(), dims.end()};
}

hid_t spaceOf(const std::vector<std::uint64_t>& dims) {
  return checked(H5Screate_simple(static_cast<int>(dims.size()), sizesOf(dims).data(), nullptr));
}

}  // namespace

struct Hdf5TestFile::Impl {
  hid_t file, links;

  explicit Impl(const std::string& path)
      : file(checked(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT))),
        links(checked(H5Pcreate(H5P_LINK_CREATE))) {
    H5Pset_create_intermediate_group(links, 1);
  }
  ~Impl() {
    H5Pclose(links);
    H5Fclose(file);
  }

  // Values may be null.
  void create(const std::string& name, hid_t type, hid_t space, hid_t creation, const void* values,
              std::size_t packed_bytes) const {
    const hid_t dataset =
        checked(H5Dcreate2(file, name.c_str(), type, space, links, creation, H5P_DEFAULT));
    const std::vector<hsize_t> first(static_cast<std::size_t>(H5Sget_simple_extent_ndims(space)),
                                     0);
    if (packed_bytes > 0)
      checked(H5Dwrite_chunk(dataset, H5P_DEFAULT, 0, first.data(), packed_bytes, values));
    else if (values != nullptr)
      checked(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values));
    H5Dclose(dataset);
  }

  void attribute(const std::string& object, const std::string& name, hid_t type, hid_t space,
                 const void* values) const {
    const hid_t owner = checked(H5Oopen(file, object.c_str(), H5P_DEFAULT));
    const hid_t made =
        checked(H5Acreate2(owner, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT));
    checked(H5Awrite(made, type, values));
    H5Aclose(made);
    H5Oclose(owner);
    H5Sclose(space);
  }
};

Hdf5TestFile::Hdf5TestFile(const std::string& path) : impl_(std::make_unique<Impl>(path)) {}
Hdf5TestFile::~Hdf5TestFile() = default;

void Hdf5TestFile::dataset(const std::string& name, const std::vector<std::uint64_t>& dims,
                           const std::string& type, const std::string& bytes,
                           const Hdf5TestLayout& layout) {
  const hid_t space = spaceOf(dims), creation = checked(H5Pcreate(H5P_DATASET_CREATE));
  if (!layout.chunk.empty())
    H5Pset_chunk(creation, static_cast<int>(dims.size()), sizesOf(layout.chunk).data());
  if (layout.has_checksum) H5Pset_fletcher32(creation);
  if (layout.filter) {
    if (H5Zfilter_avail(*layout.filter) > 0)
      H5Zunregister(*layout.filter);  // one that only unpacks may pack nothing
    checked(H5Pset_filter(creation, *layout.filter, H5Z_FLAG_OPTIONAL, layout.filter_values.size(),
                          layout.filter_values.data()));
  }
  if (!layout.raw_file.empty())
    H5Pset_external(creation, layout.raw_file.c_str(), 0, H5F_UNLIMITED);
  impl_->create(name, typeNamed(type), space, creation,
                layout.raw_file.empty() ? bytes.data() : nullptr, layout.filter ? bytes.size() : 0);
  H5Pclose(creation);
  H5Sclose(space);
}

void Hdf5TestFile::virtualDataset(const std::string& name, const std::vector<std::uint64_t>& dims,
                                  const std::string& type, const std::string& file,
                                  const std::string& dataset) {
  const hid_t space = spaceOf(dims), creation = checked(H5Pcreate(H5P_DATASET_CREATE));
  checked(H5Pset_virtual(creation, space, file.c_str(), dataset.c_str(), space));
  impl_->create(name, typeNamed(type), space, creation, nullptr, 0);
  H5Pclose(creation);
  H5Sclose(space);
}

void Hdf5TestFile::group(const std::string& name) {
  H5Gclose(checked(H5Gcreate2(impl_->file, name.c_str(), impl_->links, H5P_DEFAULT, H5P_DEFAULT)));
}

void Hdf5TestFile::externalLink(const std::string& name, const std::string& file,
                                const std::string& target) {
  checked(H5Lcreate_external(file.c_str(), target.c_str(), impl_->file, name.c_str(), impl_->links,
                             H5P_DEFAULT));
}

void Hdf5TestFile::text(const std::string& object, const std::string& attribute,
                        const std::string& value) {
  const hid_t type = checked(H5Tcopy(H5T_C_S1));
  H5Tset_size(type, H5T_VARIABLE);
  const char* const pointer = value.c_str();
  impl_->attribute(object, attribute, type, H5Screate(H5S_SCALAR), &pointer);
  H5Tclose(type);
}

void Hdf5TestFile::letters(const std::string& object, const std::string& attribute,
                           const std::string& value) {
  impl_->attribute(object, attribute, H5T_C_S1, spaceOf({value.size()}), value.data());
}

void Hdf5TestFile::numbers(const std::string& object, const std::string& attribute,
                           const std::vector<double>& values,
                           const std::vector<std::uint64_t>& dims) {
  impl_->attribute(object, attribute, H5T_NATIVE_DOUBLE,
                   spaceOf(dims.empty() ? std::vector<std::uint64_t>{values.size()} : dims),
                   values.data());
}

void Hdf5TestFile::scales(const std::string& object, const std::vector<std::string>& datasets) {
  const hid_t type = checked(H5Tvlen_create(H5T_STD_REF_OBJ));
  std::vector<hobj_ref_t> references(datasets.size());
  std::vector<hvl_t> lists(datasets.size());
  for (std::size_t i = 0; i < datasets.size(); ++i) {
    if (datasets[i].empty()) continue;
    checked(H5Rcreate(&references[i], impl_->file, datasets[i].c_str(), H5R_OBJECT, -1));
    lists[i] = {1, &references[i]};
  }
  impl_->attribute(object, "DIMENSION_LIST", type, spaceOf({datasets.size()}), lists.data());
  H5Tclose(type);
}

}  // namespace isobrick::test
