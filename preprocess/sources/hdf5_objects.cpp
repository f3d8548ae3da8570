#include <algorithm>

#include "isobrick/preprocess/sources/hdf5_dataset.h"
#include "isobrick/preprocess/sources/source_checks.h"

namespace isobrick {
namespace {

// Hostile files: no attribute is longer.
constexpr std::size_t kMostAttributeNumbers = 4096;
constexpr std::size_t kMostAttributeCharacters = std::size_t{1} << 20;
constexpr std::size_t kMostLinks = 10'000;
constexpr std::size_t kMostScaleValues = std::size_t{1} << 22;

void noteIfWide(hid_t group, const char* name, std::vector<std::string>& names) {
  const Hdf5Handle dataset(H5Dopen2(group, name, H5P_DEFAULT), H5Dclose);
  if (!dataset.isValid()) return;
  const Hdf5Handle space(H5Dget_space(dataset.id()), H5Sclose);
  if (space.isValid() && H5Sget_simple_extent_ndims(space.id()) >= 3)
    names.push_back(std::string("/") + name);
}

herr_t stopIfMany(const std::vector<std::string>& names) { return names.size() > kMostDatasets; }

// `Info` is what H5Ovisit2 and H5Lvisit want, which depends on the version of HDF5.
template <typename Info>
herr_t noteDataset(hid_t group, const char* name, const Info* info, void* found) {
  auto& names = *static_cast<std::vector<std::string>*>(found);
  if (info->type == H5O_TYPE_DATASET) noteIfWide(group, name, names);
  return stopIfMany(names);
}
template <typename Info>
herr_t noteLink(hid_t group, const char* name, const Info* info, void* found) {
  auto& names = *static_cast<std::vector<std::string>*>(found);
  if (info->type != H5L_TYPE_HARD) noteIfWide(group, name, names);
  return stopIfMany(names);
}

std::vector<double> valuesOf(hid_t dataset) {
  const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
  const Hdf5Handle type(H5Dget_type(dataset), H5Tclose);
  const auto count = H5Sget_simple_extent_npoints(space.id());
  const H5T_class_t kind = H5Tget_class(type.id());
  if (H5Sget_simple_extent_ndims(space.id()) != 1 || (kind != H5T_FLOAT && kind != H5T_INTEGER) ||
      count < 1 || static_cast<std::size_t>(count) > kMostScaleValues)
    return {};
  std::vector<double> values(static_cast<std::size_t>(count));
  if (H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    return {};
  return values;
}

Hdf5Scale scaleOf(hid_t dataset) {
  Hdf5Scale scale;
  std::string path(static_cast<std::size_t>(std::max<ssize_t>(H5Iget_name(dataset, nullptr, 0), 0)),
                   '\0');
  H5Iget_name(dataset, path.data(), path.size() + 1);
  scale.name = path.substr(path.rfind('/') + 1);
  // NetCDF writes empty datasets for dimensions that have no values.
  if (!Hdf5Attribute(dataset, "NAME").text().starts_with("This is a netCDF dimension but not"))
    scale.values = valuesOf(dataset);
  scale.units = Hdf5Attribute(dataset, "units").text();
  return scale;
}

}  // namespace

std::string hdf5Reason() {
  std::string reason;
  const auto keepFirst = [](unsigned, const H5E_error2_t* error, void* to) -> herr_t {
    if (error->desc != nullptr) *static_cast<std::string*>(to) = error->desc;
    return 1;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keepFirst, &reason);
  return reason.empty() ? reason : quotedText(reason, 150);
}

std::vector<std::string> linkNames(hid_t group) {
  std::vector<std::string> names;
  const auto note = [](hid_t, const char* name, const auto*, void* found) -> herr_t {
    auto& all = *static_cast<std::vector<std::string>*>(found);
    all.emplace_back(name);
    return all.size() >= kMostLinks ? 1 : 0;
  };
  hsize_t at = 0;
  H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, &at, note, &names);
  return names;
}

std::vector<std::string> datasetNames(hid_t file) {
  std::vector<std::string> names;
  H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, noteDataset, &names, H5O_INFO_BASIC);
  if (names.empty()) H5Lvisit(file, H5_INDEX_NAME, H5_ITER_INC, noteLink, &names);
  return names;
}

Hdf5Attribute::Hdf5Attribute(hid_t object, const char* name) {
  if (H5Aexists(object, name) <= 0) return;
  attribute_ = Hdf5Handle(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  if (!attribute_.isValid()) return;
  type_ = Hdf5Handle(H5Aget_type(attribute_.id()), H5Tclose);
  space_ = Hdf5Handle(H5Aget_space(attribute_.id()), H5Sclose);
  kind_ = H5Tget_class(type_.id());
  count_ =
      static_cast<std::size_t>(std::max<hssize_t>(H5Sget_simple_extent_npoints(space_.id()), 0));
}

std::vector<double> Hdf5Attribute::numbers() const {
  if ((kind_ != H5T_FLOAT && kind_ != H5T_INTEGER) || count_ > kMostAttributeNumbers) return {};
  std::vector<double> values(count_);
  if (H5Aread(attribute_.id(), H5T_NATIVE_DOUBLE, values.data()) < 0) return {};
  return values;
}

std::vector<double> Hdf5Attribute::numbers(std::size_t count) const {
  return count_ == count ? numbers() : std::vector<double>{};
}

std::vector<std::string> Hdf5Attribute::texts() const {
  if (kind_ != H5T_STRING || count_ == 0 || count_ > kMostAttributeNumbers) return {};
  std::vector<std::string> texts;
  if (H5Tis_variable_str(type_.id()) > 0) {
    std::vector<char*> all(count_, nullptr);
    if (H5Aread(attribute_.id(), type_.id(), all.data()) < 0) return {};
    for (const char* text : all) texts.emplace_back(text == nullptr ? "" : text);
    H5Dvlen_reclaim(type_.id(), space_.id(), H5P_DEFAULT, all.data());
    return texts;
  }
  const std::size_t bytes = H5Tget_size(type_.id());
  if (bytes == 0 || bytes > kMostAttributeCharacters / count_) return {};
  std::string all(bytes * count_, '\0');
  if (H5Aread(attribute_.id(), type_.id(), all.data()) < 0) return {};
  // Each up to the characters that fill it up.
  for (std::size_t i = 0; i < count_; ++i) texts.emplace_back(all.substr(i * bytes, bytes).c_str());
  return texts;
}

std::string Hdf5Attribute::text() const {
  std::string all;
  for (const std::string& text : texts()) all += text;
  return all;
}

std::vector<Hdf5Scale> axisScales(hid_t dataset, std::size_t axes) {
  std::vector<Hdf5Scale> scales(axes);
  if (H5Aexists(dataset, "DIMENSION_LIST") <= 0) return scales;
  const Hdf5Handle attribute(H5Aopen(dataset, "DIMENSION_LIST", H5P_DEFAULT), H5Aclose);
  const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
  const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
  const Hdf5Handle reference(H5Tvlen_create(H5T_STD_REF_OBJ), H5Tclose);
  if (H5Tequal(type.id(), reference.id()) <= 0 ||
      H5Sget_simple_extent_npoints(space.id()) != static_cast<hssize_t>(axes))
    return scales;
  std::vector<hvl_t> lists(axes);
  if (H5Aread(attribute.id(), type.id(), lists.data()) < 0) return scales;
  for (std::size_t axis = 0; axis < axes; ++axis) {
    if (lists[axis].len == 0) continue;
    const Hdf5Handle scale(H5Rdereference2(dataset, H5P_DEFAULT, H5R_OBJECT, lists[axis].p),
                           H5Oclose);
    if (scale.isValid() && H5Iget_type(scale.id()) == H5I_DATASET)
      scales[axis] = scaleOf(scale.id());
  }
  H5Dvlen_reclaim(type.id(), space.id(), H5P_DEFAULT, lists.data());
  return scales;
}

}  // namespace isobrick
