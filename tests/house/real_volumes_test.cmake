# Where ISOBRICK_REQUIRE_DATA=1 the tests of the real volumes have to be there. They are registered
# where the folder exists when the build is configured.
if("$ENV{ISOBRICK_REQUIRE_DATA}" STREQUAL "1")
  if(NOT IS_DIRECTORY "${DATA}")
    message(FATAL_ERROR "the real volumes are required and '${DATA}' is missing")
  endif()
  if(NOT REGISTERED)
    message(FATAL_ERROR "the real volumes came after the build was configured: configure it again")
  endif()
endif()
