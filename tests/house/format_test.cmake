# Every header and source is as clang-format leaves it. To mend: clang-format -i FILE.
foreach(folder storage preprocess extract viewer tools tests)
  file(GLOB_RECURSE files ${SOURCE}/${folder}/*.h ${SOURCE}/${folder}/*.cpp)
  list(APPEND all ${files})
endforeach()
execute_process(COMMAND ${CLANG_FORMAT} --dry-run -Werror --style=file ${all} RESULT_VARIABLE result)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "the files above are not formatted; run clang-format -i on them")
endif()
