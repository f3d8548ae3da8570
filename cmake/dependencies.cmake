# What isobrick is built on; all of it in Debian 12 (tools/packages), under names that upstream gives.
# What only one room needs is looked for only if that room is built.
find_package(TBB REQUIRED)
find_package(glm REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(ZLIB REQUIRED)
find_package(EXPAT REQUIRED)
find_package(meshoptimizer REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(BLOSC REQUIRED IMPORTED_TARGET blosc>=1.21)
pkg_check_modules(LZ4 REQUIRED IMPORTED_TARGET liblz4)
find_package(BZip2 REQUIRED)
pkg_check_modules(ZSTD REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(LZMA REQUIRED IMPORTED_TARGET liblzma)
pkg_check_modules(TIFF REQUIRED IMPORTED_TARGET libtiff-4>=4.5)
pkg_check_modules(HWY REQUIRED libhwy>=1.0.3)
find_path(XXHASH_INCLUDE_DIR xxhash.h REQUIRED)  # all in line
# Its own package asks for programs that Debian has elsewhere. Only preprocess/sources/nifti_source.cpp includes it.
find_path(NIFTI_INCLUDE_DIR nifti2_io.h PATH_SUFFIXES nifti REQUIRED)
find_library(NIFTI2_LIBRARY nifti2 REQUIRED)

set(switched_off_sources "")

# ITK reads DICOM and PNG. Only preprocess/sources/itk_*.cpp include it.
if(ISOBRICK_WITH_ITK)
  set(isobrick_itk_components
    ITKIOImageBase ITKIOGDCM ITKIOPNG)
  find_package(ITK 5 REQUIRED COMPONENTS ${isobrick_itk_components})
  # GDCM is a part of ITK or a library beside it, whose own package asks for more than its libraries.
  find_path(GDCM_INCLUDE_DIR gdcmImageReader.h HINTS ${ITK_INCLUDE_DIRS} PATH_SUFFIXES gdcm-3.0 gdcm REQUIRED)
  set(GDCM_LIBRARIES "")
  foreach(library gdcmMSFF gdcmDSED gdcmCommon)
    if(TARGET ${library})
      list(APPEND GDCM_LIBRARIES ${library})
    else()
      find_library(GDCM_${library} ${library} REQUIRED)
      list(APPEND GDCM_LIBRARIES ${GDCM_${library}})
    endif()
  endforeach()
  # Its headers for a target's sources.
  function(isobrick_include_itk target)
    target_include_directories(${target} SYSTEM PRIVATE ${ITK_INCLUDE_DIRS} ${GDCM_INCLUDE_DIR})
    if(CMAKE_CXX_COMPILER_ID MATCHES Clang)
      target_compile_options(${target} PRIVATE "SHELL:-include ${PROJECT_SOURCE_DIR}/cmake/itk_by_clang.h")
    endif()
  endfunction()
else()
  list(APPEND switched_off_sources "/itk_[a-z_]*\\.cpp$")
endif()

if(ISOBRICK_WITH_OPENVDB)
  find_package(IsobrickOpenVDB REQUIRED)
else()
  list(APPEND switched_off_sources "/vdb_[a-z_]*\\.cpp$")
endif()

if(ISOBRICK_WITH_HDF5)
  find_package(IsobrickHDF5 REQUIRED)
  # For files of h5py. Debian's plugin of HDF5 for it lacks the library, and cannot be loaded.
  find_path(LZF_INCLUDE_DIR lzf.h PATH_SUFFIXES liblzf REQUIRED)
  find_library(LZF_LIBRARY lzf REQUIRED)
else()
  list(APPEND switched_off_sources "/hdf5_[a-z_]*\\.cpp$")
endif()

# 7.88: signatures of S3 that take in all headers. Only storage/remote/http_transfers.cpp includes it.
if(ISOBRICK_WITH_HTTP)
  pkg_check_modules(CURL REQUIRED IMPORTED_TARGET libcurl>=7.88)
else()
  list(APPEND switched_off_sources "/remote/(http|s3)_[a-z0-9_]*\\.cpp$")
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
  find_path(ISOBRICK_STB stb_truetype.h PATH_SUFFIXES stb REQUIRED
            DOC "The folder of stb_truetype.h, which draws the text in pictures")
  # Without it panels have the small bitmap font of Dear ImGui, and pictures no text.
  find_file(ISOBRICK_FONT Roboto-Regular.ttf PATHS /usr/share/fonts PATH_SUFFIXES
            truetype/roboto/unhinted/RobotoTTF truetype/roboto google-roboto roboto TTF
            DOC "The font of panels and pictures, TrueType")
endif()
if(ISOBRICK_WITH_WINDOW)
  pkg_check_modules(GLFW REQUIRED IMPORTED_TARGET glfw3>=3.3)
  find_package(imgui CONFIG QUIET)  # vcpkg has this, Linux distributions a file for pkg-config
  set(imgui_target imgui::imgui)
  if(NOT TARGET imgui::imgui)
    pkg_check_modules(IMGUI REQUIRED IMPORTED_TARGET imgui)
    set(imgui_target PkgConfig::IMGUI)
  endif()
endif()
if(ISOBRICK_WITH_SERVER)
  find_path(ISOBRICK_BEAST boost/beast/websocket.hpp REQUIRED DOC "The folder of Boost's headers")
endif()
if(ISOBRICK_COMMAND)
  find_package(fmt REQUIRED)
  find_package(CLI11 REQUIRED)
  find_package(draco CONFIG REQUIRED)
endif()
