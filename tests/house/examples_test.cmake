# Runs the six programs of examples/ and looks at what they say and leave. BIN: the folder that they are in.
cmake_policy(VERSION 3.25)
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
include(${CMAKE_CURRENT_LIST_DIR}/run.cmake)
file(GLOB programs ${SOURCE}/examples/*.cpp)
foreach(program ${programs})
  file(READ ${program} text)
  string(REGEX MATCHALL "\n" lines "${text}")
  list(LENGTH lines count)
  if(count GREATER 60)
    message(FATAL_ERROR "${program} has ${count} lines, more than 60")
  endif()
endforeach()

# example(NAME REGEX...): what it prints has all of these.
function(example name)
  run(${BIN}/${name})
  foreach(regex ${ARGN})
    if(NOT output MATCHES "${regex}")
      message(FATAL_ERROR "${name} does not say '${regex}':\n${output}")
    endif()
  endforeach()
  set(output "${output}" PARENT_SCOPE)
endfunction()

example(open_and_query "128 x 128 x 128 voxels" "isovalue [0-9]+" "around_focus.ply: [0-9]+ triangles"
        "level 0: [1-9]" "level 2: [1-9]" "coarse.ply: [1-9][0-9]+ triangles")
run(${CHECK_MESH} around_focus.ply --box 0 0 0 127 127 127)
run(${CHECK_MESH} coarse.ply --box 0 0 0 127 127 127)

# The sphere has the radius 0.35 * 127: its area is 24,828, its volume 367,902, and it covers 6,207 pixels.
example(own_sink "area 248[0-9][0-9]" "volume 367[0-9][0-9][0-9]")
file(STRINGS ${WORK}/sphere.pgm picture)
list(LENGTH picture lines)
list(FILTER picture EXCLUDE REGEX "^0$")
list(LENGTH picture drawn)
list(GET picture 0 1 2 head)
if(NOT head STREQUAL "P2;128 128;255" OR NOT lines EQUAL 16387 OR drawn LESS 6150 OR drawn GREATER 6400)
  message(FATAL_ERROR "sphere.pgm is no picture of the sphere: ${head}, ${lines} lines, ${drawn} not black")
endif()

example(own_source "[1-9][0-9]+ triangles")
run(${CHECK_MESH} heart.ply)

example(progressive_surfaces "pass 1: [0-9]+ triangles.*more to come" "passes; the last one is the whole surface")
run(${CHECK_MESH} refined.ply --box 0 0 0 255 255 255)

example(stream_passes "radius 8: [1-9][0-9]* triangles" "radius 24: [1-9]" "radius 200: [1-9][0-9]+ triangles, [0-9]+ of them new\n$")
run(${CHECK_MESH} streamed.ply --box 0 0 0 127 127 127)

if(EXISTS ${BIN}/isosurface_node)
  example(isosurface_node "whole: [1-9][0-9]+ triangles" "half of it, closed: [1-9]" "around the focus: [1-9]")
endif()

example(build_and_verify "  0 %" " 75 %" "bricks in [0-9]+ bytes" "0 faults as it was built"
        "damaged.isb: brick \\(0,0,0\\) of level 0: " "1 faults in the damaged copy")
