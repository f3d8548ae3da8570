# The plot script on the JSON of a real run, and without what it needs.
file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/hidden/matplotlib)
set(script ${SOURCE}/tools/plot_bench.py)

function(run_well)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${WORK} RESULT_VARIABLE result
                  OUTPUT_FILE ${WORK}/out ERROR_VARIABLE errors)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "'${ARGN}' failed:\n${errors}")
  endif()
endfunction()

function(expect_failure words)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${WORK} RESULT_VARIABLE result
                  OUTPUT_VARIABLE output ERROR_VARIABLE errors)
  if(result EQUAL 0 OR NOT errors MATCHES "^plot_bench.py: [^\n]*${words}[^\n]*\n$")
    message(FATAL_ERROR "'${ARGN}' should have failed for '${words}':\n${errors}")
  endif()
endfunction()

run_well(${ISOBRICK} phantom sphere --voxels 32 -o sphere.nrrd)
run_well(${ISOBRICK} build sphere.nrrd)
run_well(${ISOBRICK} bench sphere.isb --iso 0 --level 1 --rounds 1 --repeat 1 --page-cache both
         --huge-pages both --rows isobrick,isobrick-adaptive --json)
file(COPY_FILE ${WORK}/out ${WORK}/bench.json)

# A second run, for curves.
run_well(${ISOBRICK} bench sphere.isb --iso 1 --focus 16,16,16 --radius 4 --rounds 1 --repeat 1
         --rows isobrick-adaptive --json)
file(COPY_FILE ${WORK}/out ${WORK}/focus.json)
file(READ ${WORK}/focus.json focus_json)
string(JSON radius GET "${focus_json}" query 3)
if(NOT radius STREQUAL "4")
  message(FATAL_ERROR "the JSON says not what was asked for: ${focus_json}")
endif()

# A third one, of surfaces that approximate.
run_well(${ISOBRICK} bench sphere.isb --iso 0 --rounds 1 --repeat 1 --rows simplify-0.2,simplify-0.4
         --json)
file(COPY_FILE ${WORK}/out ${WORK}/simplify.json)
run_well(${ISOBRICK} bench sphere.isb --iso 0 --rounds 1 --repeat 1 --rows isobrick --json)
file(COPY_FILE ${WORK}/out ${WORK}/exact.json)

expect_failure("has no row that approximates"
               ${PYTHON} ${script} exact.json --against distance -o distance.png)
expect_failure("several runs need '--against'" ${PYTHON} ${script} bench.json focus.json)
expect_failure("no run has a value of 'radius'"
               ${PYTHON} ${script} bench.json --against radius -o radius.png)
expect_failure("cannot read 'missing.json'" ${PYTHON} ${script} missing.json)
file(WRITE ${WORK}/half.json "{\"rows\": [")
expect_failure("is not JSON" ${PYTHON} ${script} half.json)
file(WRITE ${WORK}/empty.json "{\"rows\": [{\"name\": \"a\", \"failure\": \"b\"}]}")
expect_failure("no row of 'empty.json' was measured" ${PYTHON} ${script} empty.json)
file(WRITE ${WORK}/other.json "[]")
expect_failure("has no rows" ${PYTHON} ${script} other.json)
file(WRITE ${WORK}/hidden/matplotlib/__init__.py "raise ImportError('hidden')\n")
expect_failure("apt-get install python3-matplotlib"
               ${CMAKE_COMMAND} -E env PYTHONPATH=${WORK}/hidden ${PYTHON} ${script} bench.json)

execute_process(COMMAND ${PYTHON} -c "import matplotlib" RESULT_VARIABLE missing ERROR_QUIET)
if(missing EQUAL 0)
  foreach(picture bench.png bench.svg)
    run_well(${PYTHON} ${script} bench.json -o ${picture})
    file(SIZE ${WORK}/${picture} bytes)
    if(bytes LESS 10000)
      message(FATAL_ERROR "${picture} has only ${bytes} bytes")
    endif()
  endforeach()
  run_well(${PYTHON} ${script} bench.json focus.json --against triangles -o curve.png)
  file(SIZE ${WORK}/curve.png bytes)
  if(bytes LESS 5000)
    message(FATAL_ERROR "curve.png has only ${bytes} bytes")
  endif()
  run_well(${PYTHON} ${script} simplify.json simplify.json --against distance -o distance.png)
  file(SIZE ${WORK}/distance.png bytes)
  if(bytes LESS 10000)
    message(FATAL_ERROR "distance.png has only ${bytes} bytes")
  endif()
  expect_failure("cannot write" ${PYTHON} ${script} bench.json -o no/folder/bench.png)
  message(STATUS "pictures made")
endif()
