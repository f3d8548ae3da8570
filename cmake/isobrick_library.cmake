# isobrick_library(NAME KIND FOLDER [INCLUDE REGEX] [EXCLUDE REGEX...]): the target isobrick_NAME, alias
# isobrick::NAME, of all sources in a folder and its rooms.
#
# Headers are included as "isobrick/storage/grid.h" everywhere. In the build tree a link named
# `isobrick` leads to the sources; in an installation it is a folder with the public headers.
file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/include)
file(CREATE_LINK ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR}/include/isobrick SYMBOLIC)

# Flags of our own code, and of nobody who links it. The oracles compare the same double in several
# places: no contraction to fused operations.
set(isobrick_compile_options
  -Wall -Wextra -Wpedantic -Wshadow $<$<COMPILE_LANGUAGE:CXX>:-Wconversion> -ffp-contract=off
  $<$<CXX_COMPILER_ID:Clang,AppleClang>:-Wno-sign-conversion>  # a part of clang's -Wconversion, not of g++'s
  $<$<BOOL:${ISOBRICK_WERROR}>:-Werror>)
set(isobrick_link_options "")
if(ISOBRICK_SANITIZE)
  # Without no-recover, undefined behaviour is a line in a log and the test passes.
  list(APPEND isobrick_compile_options
    -fsanitize=${ISOBRICK_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g1)  # reports need lines only
  list(APPEND isobrick_link_options -fsanitize=${ISOBRICK_SANITIZE})
  if(ISOBRICK_SANITIZE MATCHES address)
    list(APPEND isobrick_compile_options $<$<CXX_COMPILER_ID:Clang>:-D__SANITIZE_ADDRESS__>)  # as g++ does
  elseif(ISOBRICK_SANITIZE MATCHES thread)
    list(APPEND isobrick_compile_options $<$<CXX_COMPILER_ID:Clang>:-D__SANITIZE_THREAD__>)
  endif()
  if(ISOBRICK_SANITIZE MATCHES "address.*undefined")
    # AddressSanitizer stops at a null pointer anyhow; these checks take a quarter of the time to compile.
    list(APPEND isobrick_compile_options -fno-sanitize=null,vptr,object-size)
    list(APPEND isobrick_link_options -fno-sanitize=vptr)
  endif()
endif()
# Kernels are compiled once for each instruction set, which takes a tenth of the time to compile all. SSSE3 without SSE4 is
# left out: no processor since 2009 is like that. Sanitized kernels take minutes, so SSE4 and AVX3 (without the later
# extensions) go too. Highway's bits, since parentheses are no shell's friends.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  math(EXPR isobrick_left_out "1 << 12")
  if(ISOBRICK_SANITIZE)
    math(EXPR isobrick_left_out "(1 << 12) | (1 << 11) | (1 << 8)")
  endif()
else()
  # Kernels keep vectors in arrays and structs, which those of a size unknown to the compiler cannot be in: SVE's on ARM,
  # for which NEON's are taken, and RVV's on RISC-V.
  math(EXPR isobrick_left_out "(15 << 24) | (1 << 37)")
endif()
list(APPEND isobrick_compile_options -DHWY_DISABLED_TARGETS=${isobrick_left_out})
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)  # by default it looks for garbage a twentieth of its time
  list(APPEND isobrick_compile_options --param=ggc-min-heapsize=524288)
endif()

# Three kinds of our own code: `hot` meshes and builds; `cold` reads formats, draws and shows, and what takes its time is in
# other libraries; `command` reads options. To optimise more takes a quarter more time to compile, and gains nothing. Kernels
# are hot, and have -O3.
set(hot_optimisation $<$<CONFIG:Release>:-O2>)
set(cold_optimisation $<$<CONFIG:Release>:-O1>)
set(command_optimisation $<$<CONFIG:Release>:-O0>)
if(ISOBRICK_SANITIZE)
  set(cold_optimisation -O0)
  set(command_optimisation -O0)
endif()

# cmake/KIND_headers.h, precompiled: what most sources of that kind include.
function(isobrick_precompiled_headers kind)
  set(name isobrick_${kind}_headers)
  if(NOT EXISTS ${PROJECT_BINARY_DIR}/empty.cpp)  # written once: it would be compiled again after each configuration
    file(WRITE ${PROJECT_BINARY_DIR}/empty.cpp "")
  endif()
  add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/empty.cpp)
  target_compile_features(${name} PUBLIC cxx_std_20)
  set_target_properties(${name} PROPERTIES CXX_EXTENSIONS OFF)
  target_compile_options(${name} PRIVATE ${isobrick_compile_options} ${${kind}_optimisation})
  if(NOT kind STREQUAL command)  # libraries
    set_target_properties(${name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  endif()
  target_link_libraries(${name} PRIVATE ${ARGN})
  target_precompile_headers(${name} PRIVATE ${PROJECT_SOURCE_DIR}/cmake/${kind}_headers.h)
endfunction()

# How a target of our own code is compiled.
function(isobrick_compile_options target kind)
  target_compile_features(${target} PUBLIC cxx_std_20)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)
  target_compile_options(${target} PRIVATE ${isobrick_compile_options} ${${kind}_optimisation})
  target_link_options(${target} PRIVATE ${isobrick_link_options})
  # A few files are compiled together, since most of the time goes into headers. So names in anonymous namespaces differ
  # within a library; a class of one source file may have members of types of that file.
  if(ISOBRICK_BATCH)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${ISOBRICK_BATCH})
    target_precompile_headers(${target} REUSE_FROM isobrick_${kind}_headers)
    target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
  endif()
endfunction()

function(isobrick_library name kind folder)
  cmake_parse_arguments(PARSE_ARGV 3 arg "" "INCLUDE" "EXCLUDE")
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/*.cpp)
  if(arg_INCLUDE)
    list(FILTER sources INCLUDE REGEX ${arg_INCLUDE})
  endif()
  foreach(regex ${arg_EXCLUDE})
    list(FILTER sources EXCLUDE REGEX ${regex})
  endforeach()
  add_library(isobrick_${name} ${sources})
  add_library(isobrick::${name} ALIAS isobrick_${name})
  isobrick_compile_options(isobrick_${name} ${kind})
  set_target_properties(isobrick_${name} PROPERTIES
    EXPORT_NAME ${name} POSITION_INDEPENDENT_CODE ON
    VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  # Files of kernels include themselves, once for each kind of processor.
  list(FILTER sources INCLUDE REGEX "/kernels/")
  set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON
    SKIP_PRECOMPILE_HEADERS ON COMPILE_OPTIONS $<$<CONFIG:Release>:-O3>)
  if(ISOBRICK_SANITIZE MATCHES undefined AND CMAKE_CXX_COMPILER_ID STREQUAL Clang)
    # With a message for each check a kernel takes clang minutes. Instead the process ends at once, and
    # AddressSanitizer says in which line.
    set_source_files_properties(${sources} PROPERTIES COMPILE_OPTIONS "-O1;-fsanitize-trap=undefined")
    list(FILTER sources INCLUDE REGEX "/brick_crossings\\.cpp$")  # minutes at -O1
    set_source_files_properties(${sources} PROPERTIES COMPILE_OPTIONS "-O0;-fsanitize-trap=undefined")
  endif()
  target_include_directories(isobrick_${name} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
endfunction()
