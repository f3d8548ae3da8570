# What isobrick is built on; all of it in Debian 12 (tools/packages.txt). What only one room needs is
# looked for only where that room is built.
find_package(TBB REQUIRED)
find_package(glm REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(ZLIB REQUIRED)
find_package(EXPAT REQUIRED)
find_package(meshoptimizer REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(BLOSC REQUIRED IMPORTED_TARGET blosc>=1.21)
pkg_check_modules(ZSTD REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(TIFF REQUIRED IMPORTED_TARGET libtiff-4)
pkg_check_modules(HWY REQUIRED libhwy>=1.0.3)

set(switched_off_sources "")

# ITK reads the medical formats. Only preprocess/sources/itk_*.cpp include it.
if(ISOBRICK_WITH_ITK)
  set(isobrick_itk_components
    ITKIOImageBase ITKIONRRD ITKIOMeta ITKIONIFTI ITKIOTIFF ITKIOGDCM ITKIOPNG ITKIOMRC ITKIOGIPL
    ITKIOVTK ITKIOLSM ITKIOBioRad)
  find_package(ITK 5 REQUIRED COMPONENTS ${isobrick_itk_components})
  # GDCM comes with ITK; by name, as its package asks for more than its libraries.
  find_path(GDCM_INCLUDE_DIR gdcmImageReader.h PATH_SUFFIXES gdcm-3.0 REQUIRED)
  set(GDCM_LIBRARIES gdcmMSFF gdcmDSED gdcmCommon)
else()
  list(APPEND switched_off_sources "/itk_[a-z_]*\\.cpp$")
endif()

# Debian's FindOpenVDB asks for more of Boost than OpenVDB's headers need. By name, as Highway: the
# installed package then links them without looking for them.
if(ISOBRICK_WITH_OPENVDB)
  find_path(OPENVDB_INCLUDE_DIR openvdb/openvdb.h REQUIRED)
  find_library(OPENVDB_LIBRARY openvdb REQUIRED)
  find_path(LOG4CPLUS_INCLUDE_DIR log4cplus/logger.h REQUIRED)  # its log, to be silenced
  find_path(BOOST_UUID_INCLUDE_DIR boost/uuid/uuid.hpp REQUIRED)
  set(OPENVDB_INCLUDE_DIRS ${OPENVDB_INCLUDE_DIR} ${LOG4CPLUS_INCLUDE_DIR} ${BOOST_UUID_INCLUDE_DIR})
  find_package(Imath CONFIG REQUIRED)  # half floats
  set(OPENVDB_LIBRARIES openvdb log4cplus Imath::Imath)
else()
  list(APPEND switched_off_sources "/vdb_[a-z_]*\\.cpp$")
endif()

# Debian has HDF5 with and without MPI side by side; by pkg-config, as FindHDF5 takes whichever compiler
# wrapper it meets first.
if(ISOBRICK_WITH_HDF5)
  pkg_check_modules(HDF5 REQUIRED IMPORTED_TARGET hdf5-serial)
else()
  list(APPEND switched_off_sources "/hdf5_[a-z_]*\\.cpp$")
endif()

if(ISOBRICK_WITH_OPENEXR OR ISOBRICK_WITH_VIEWER)
  find_package(OpenEXR CONFIG REQUIRED)
endif()
if(NOT ISOBRICK_WITH_OPENEXR)
  list(APPEND switched_off_sources "/formats/exr_[a-z_]*\\.cpp$" "/sources/exr_[a-z_]*\\.cpp$")
endif()

if(ISOBRICK_WITH_VIEWER)
  find_package(PNG REQUIRED)
  pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)
endif()
if(ISOBRICK_WITH_WINDOW)
  pkg_check_modules(GLFW REQUIRED IMPORTED_TARGET glfw3>=3.3)
  pkg_check_modules(IMGUI REQUIRED IMPORTED_TARGET imgui)
endif()
if(ISOBRICK_COMMAND)
  find_package(fmt REQUIRED)
  find_package(CLI11 REQUIRED)
endif()
