# Builds isobrick by clang as shared libraries and without all that can be left out, installs them, and runs a
# program that only extracts on what was installed. No library may ask for what was left out, or for
# VTK, and those that know no formats for nothing of those either.
file(REMOVE_RECURSE ${WORK}/prefix ${WORK}/consumer)
file(MAKE_DIRECTORY ${WORK})
include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)
function(refuse_libraries what pattern)
  if(output MATCHES "(${pattern})")
    message(FATAL_ERROR "${what} links ${CMAKE_MATCH_1}:\n${output}")
  endif()
endfunction()
find_program(clang NAMES clang++ REQUIRED)  # in half of the time
set(left_out "ITK|itk|gdcm|openvdb|hdf5|OpenEXR|epoxy|VTK|vtk")

run(${CMAKE_COMMAND} -G ${GENERATOR} -S ${SOURCE} -B build ${quick_build}
    -DCMAKE_CXX_COMPILER=${clang} "-DCMAKE_CXX_FLAGS=-O0 -DHWY_COMPILE_ONLY_STATIC"
    -DBUILD_SHARED_LIBS=ON -DISOBRICK_WITH_ITK=OFF -DISOBRICK_WITH_OPENVDB=OFF
    -DISOBRICK_WITH_HDF5=OFF -DISOBRICK_WITH_OPENEXR=OFF
    -DISOBRICK_WITH_VIEWER=OFF -DISOBRICK_COMMAND=OFF -DISOBRICK_TESTS=OFF -DISOBRICK_WERROR=${WERROR})
run(${CMAKE_COMMAND} --build build --parallel 1)
run(${CMAKE_COMMAND} --install build --prefix ${WORK}/prefix)

file(GLOB_RECURSE libraries ${WORK}/prefix/libisobrick_*.so)
list(LENGTH libraries count)
if(NOT count EQUAL 6)
  message(FATAL_ERROR "not storage, extract, preprocess, sources, export and view were installed: ${libraries}")
endif()
foreach(library ${libraries})
  # What it asks for itself; and that all of it is there, with all that it asks for in turn.
  run(readelf -d ${library})
  if(NOT output MATCHES "SONAME[^\n]*libisobrick_[a-z]+\\.so\\.[0-9]+\\.[0-9]+\\]")
    message(FATAL_ERROR "${library} has no SONAME with a version:\n${output}")
  endif()
  refuse_libraries(${library} ${left_out})
  if(library MATCHES "libisobrick_(storage|extract|view)\\.")
    refuse_libraries(${library} "expat|isobrick_preprocess|isobrick_sources")
  endif()
  if(library MATCHES "libisobrick_view\\.")  # nor for a window or pictures
    refuse_libraries(${library} "png|libGL|EGL|glfw|imgui|X11")
  endif()
  if(library MATCHES "libisobrick_storage\\.")  # meshes are packed with zlib
    refuse_libraries(${library} "libz\\.")
  endif()
  get_filename_component(folder ${library} DIRECTORY)
  run(${CMAKE_COMMAND} -E env LD_LIBRARY_PATH=${folder} ldd -r ${library})
  refuse_libraries(${library} "${left_out}|not found|undefined symbol")
endforeach()

run(${ISOBRICK} phantom sphere --voxels 32 -o sphere.mhd --force)
run(${ISOBRICK} build sphere.mhd)
run(${CMAKE_COMMAND} -G ${GENERATOR} -S ${SOURCE}/tests/house/extract_only -B consumer
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=${CXX} -DCMAKE_PREFIX_PATH=${WORK}/prefix)
run(${CMAKE_COMMAND} --build consumer)
run(consumer/extract_only sphere.isb 0)
run(ldd consumer/extract_only)
if(NOT output MATCHES "libisobrick_extract\\.so[^\n]*${WORK}/prefix")
  message(FATAL_ERROR "the program does not use what was installed:\n${output}")
endif()
refuse_libraries("a program that only extracts" "${left_out}|isobrick_preprocess|isobrick_sources")
