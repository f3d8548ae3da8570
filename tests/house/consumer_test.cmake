# Installs isobrick into an empty folder, and uses it as other projects do: by find_package, by
# pkg-config, and as a subdirectory. A program that only extracts must not need ITK or OpenVDB.
set(prefix ${WORK}/prefix)
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)
set(configure ${CMAKE_COMMAND} -G ${GENERATOR} -DCMAKE_PREFIX_PATH=${prefix})

run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${prefix})
run(${prefix}/bin/isobrick --version)
run(${prefix}/bin/isobrick phantom sphere --voxels 32 -o sphere.mhd)
run(${prefix}/bin/isobrick build sphere.mhd)

# The examples, as a stranger builds them.
run(${configure} -S ${SOURCE}/examples -B examples -DCMAKE_BUILD_TYPE=Release)
run(${CMAKE_COMMAND} --build examples)
run(${CMAKE_COMMAND} -DSOURCE=${SOURCE} -DBIN=${WORK}/examples -DCHECK_MESH=${CHECK_MESH} -DWORK=${WORK}/examples_run
    -P ${CMAKE_CURRENT_LIST_DIR}/examples_test.cmake)

# One component: what it does not need is hidden from it.
run(${configure} -S ${SOURCE}/tests/house/extract_only -B extract_only -DCMAKE_BUILD_TYPE=Release
    -DCMAKE_DISABLE_FIND_PACKAGE_ITK=ON -DCMAKE_DISABLE_FIND_PACKAGE_OpenVDB=ON
    -DCMAKE_DISABLE_FIND_PACKAGE_OpenEXR=ON -DCMAKE_DISABLE_FIND_PACKAGE_PNG=ON)
run(${CMAKE_COMMAND} --build extract_only)
run(extract_only/extract_only sphere.isb 0)
function(refuse_formats program)
  run(ldd ${program})
  if(output MATCHES "(ITK|itk|VTK|vtk|gdcm|openvdb|OpenEXR|epoxy)")
    message(FATAL_ERROR "${program}, which only extracts, links ${CMAKE_MATCH_1}:\n${output}")
  endif()
endfunction()
refuse_formats(extract_only/extract_only)
refuse_formats(examples/stream_passes)

# Public headers, with nothing of the source tree in sight: all together, and each alone that no source
# file includes before anything else, as its own does in the build.
file(GLOB_RECURSE headers RELATIVE ${prefix}/include ${prefix}/include/*.h)
list(LENGTH headers header_count)
if(header_count LESS 20)
  message(FATAL_ERROR "only ${header_count} headers were installed")
endif()
list(TRANSFORM headers REPLACE "(.+)" "#include <\\1>" OUTPUT_VARIABLE all_headers)
list(JOIN all_headers "\n" all_headers)
set(sources "${all_headers}\n")
foreach(header ${headers})
  string(REGEX REPLACE "^isobrick/(.+)\\.h$" "${SOURCE}/\\1.cpp" its_source ${header})
  set(first_include "")
  if(EXISTS ${its_source})
    file(STRINGS ${its_source} first_include REGEX "^#include" LIMIT_COUNT 1)
  endif()
  if(NOT first_include STREQUAL "#include \"${header}\"")
    list(APPEND sources "#include <${header}>\n")
  endif()
endforeach()
list(LENGTH sources source_count)
message("${header_count} headers, ${source_count} compilations")
foreach(source ${sources})
  file(WRITE ${WORK}/header.cpp "${source}")
  run(${CXX} -std=c++20 -fsyntax-only -Wall -Wextra -Werror -I${prefix}/include header.cpp)
endforeach()

# pkg-config.
file(GLOB_RECURSE pc_files ${prefix}/isobrick-extract.pc)
get_filename_component(pc_folder "${pc_files}" DIRECTORY)
run(${CMAKE_COMMAND} -E env PKG_CONFIG_PATH=${pc_folder} pkg-config
    --define-variable=prefix=${prefix} --static --cflags --libs isobrick-extract)
string(STRIP "${output}" pc_flags)
separate_arguments(pc_flags UNIX_COMMAND "${pc_flags}")
run(${CXX} -std=c++20 -O1 ${SOURCE}/tests/house/extract_only/main.cpp ${pc_flags}
    -o by_pkg_config)
run(${WORK}/by_pkg_config sphere.isb 0)

# As a subdirectory, without ITK, OpenVDB and viewer.
run(${configure} -S ${SOURCE}/tests/house/subdirectory -B subdirectory -DISOBRICK=${SOURCE}
    ${quick_build})
run(${CMAKE_COMMAND} --build subdirectory)
run(subdirectory/extract_only sphere.isb 0)
refuse_formats(subdirectory/extract_only)
