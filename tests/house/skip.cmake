cmake_minimum_required(VERSION 3.25)  # without it CI=true is no truth to if()

# skip(REASON): for a test that the machine cannot run; a failure if everything is required (CI).
function(skip reason)
  foreach(name CI ISOBRICK_REQUIRE_ALL)
    if("$ENV{${name}}")
      message(FATAL_ERROR "${reason}; and nothing may be skipped here")
    endif()
  endforeach()
  message("skipped: ${reason}")
endfunction()
