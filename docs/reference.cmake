# The reference of the library's interface, by Doxygen from the public headers.
#   cmake [-D OUT=FOLDER] -P docs/reference.cmake      makes FOLDER/html/index.html, else build/reference/html/index.html
get_filename_component(source ${CMAKE_CURRENT_LIST_DIR} DIRECTORY)
if(NOT OUT)
  set(OUT ${source}/build/reference)
endif()
get_filename_component(out ${OUT} ABSOLUTE)
set(ISOBRICK_WITH_VIEWER ON)
include(${source}/cmake/public_headers.cmake)
list(TRANSFORM isobrick_public_headers PREPEND isobrick/)
list(JOIN isobrick_public_headers " " headers)
file(READ ${source}/docs/Doxyfile settings)
file(WRITE ${out}/Doxyfile "${settings}\nINPUT = ${headers}\n")
file(CREATE_LINK ${source} ${out}/isobrick SYMBOLIC)  # headers are named as they are included
execute_process(COMMAND doxygen Doxyfile WORKING_DIRECTORY ${out} COMMAND_ERROR_IS_FATAL ANY)
