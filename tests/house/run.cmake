# run(COMMAND...): in the folder WORK, fails with what it printed; otherwise that is in `output`.
function(run)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${WORK} RESULT_VARIABLE result
                  OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "failed: ${ARGN}\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

# How the libraries are built anew where the matter is what is linked: a file each, without optimisation,
# kernels for one processor. A class of one source file may have members of types of that file.
set(quick_build -DCMAKE_BUILD_TYPE=None -DISOBRICK_BATCH=1000
    "-DCMAKE_CXX_FLAGS=-O0 -DHWY_COMPILE_ONLY_STATIC -Wno-subobject-linkage")
