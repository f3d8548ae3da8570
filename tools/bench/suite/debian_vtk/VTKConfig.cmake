# The parts of Debian's VTK that bench_peers needs, from packages that were unpacked into ISOBRICK_DEBIAN_VTK
# rather than installed. Their own VTKConfig.cmake asks for all of VTK.
set(VTK_LIBRARIES "")
foreach(part FiltersCore CommonExecutionModel CommonDataModel CommonCore CommonMath CommonMisc CommonSystem
             CommonTransforms sys)
  file(GLOB library ${ISOBRICK_DEBIAN_VTK}/usr/lib/*/libvtk${part}-9.*.so)
  file(GLOB headers ${ISOBRICK_DEBIAN_VTK}/usr/include/vtk-9.*)
  if(NOT library OR NOT headers)
    set(VTK_FOUND FALSE)
    set(VTK_NOT_FOUND_MESSAGE "there is no libvtk${part} in '${ISOBRICK_DEBIAN_VTK}'")
    return()
  endif()
  if(NOT TARGET VTK::${part})
    add_library(VTK::${part} SHARED IMPORTED)
    set_target_properties(VTK::${part} PROPERTIES IMPORTED_LOCATION ${library}
      INTERFACE_INCLUDE_DIRECTORIES ${headers})
  endif()
  list(APPEND VTK_LIBRARIES VTK::${part})
endforeach()
