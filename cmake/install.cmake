# `cmake --install`: the command, and the library under it with its public headers, found by
# find_package(isobrick COMPONENTS ...) and by pkg-config. Runtime and development files are components
# of their own, which debian/rules makes a package each.
include(CMakePackageConfigHelpers)

set(isobrick_components storage extract preprocess sources export view)
if(ISOBRICK_WITH_VIEWER)
  list(APPEND isobrick_components viewer)
endif()

if(ISOBRICK_COMMAND)
  file(RELATIVE_PATH lib_from_bin /${CMAKE_INSTALL_BINDIR} /${CMAKE_INSTALL_LIBDIR})
  file(RELATIVE_PATH lib_from_libexec /${CMAKE_INSTALL_LIBEXECDIR}/isobrick /${CMAKE_INSTALL_LIBDIR})
  if(BUILD_SHARED_LIBS)
    set_target_properties(isobrick PROPERTIES INSTALL_RPATH "$ORIGIN/${lib_from_bin}")
    set_target_properties(isobrick-build isobrick_source_plugin PROPERTIES INSTALL_RPATH "$ORIGIN/${lib_from_libexec}")
    if(ISOBRICK_WITH_WINDOW)
      set_target_properties(isobrick-view PROPERTIES INSTALL_RPATH "$ORIGIN/${lib_from_libexec}")
    endif()
  endif()
  install(TARGETS isobrick RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT runtime)
  set(installed_helpers isobrick-build)
  if(ISOBRICK_WITH_WINDOW)
    list(APPEND installed_helpers isobrick-view)
  endif()
  install(TARGETS ${installed_helpers} COMPONENT runtime
          RUNTIME DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/isobrick)
  install(TARGETS isobrick_source_plugin COMPONENT runtime
          LIBRARY DESTINATION ${CMAKE_INSTALL_LIBEXECDIR}/isobrick)
  # What a desktop knows of .isb files: their type and icon, and which program opens them.
  install(FILES desktop/isobrick.xml DESTINATION ${CMAKE_INSTALL_DATADIR}/mime/packages COMPONENT runtime)
  install(FILES desktop/isobrick.svg COMPONENT runtime
          DESTINATION ${CMAKE_INSTALL_DATADIR}/icons/hicolor/scalable/apps)
  if(ISOBRICK_WITH_WINDOW)
    install(FILES desktop/isobrick.desktop DESTINATION ${CMAKE_INSTALL_DATADIR}/applications COMPONENT runtime)
  endif()
  install(DIRECTORY ${PROJECT_BINARY_DIR}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR} COMPONENT runtime
          OPTIONAL)  # a cross build has none
  # Where the shells look for them.
  set(completions desktop/completions)
  install(FILES ${completions}/isobrick.bash COMPONENT runtime RENAME isobrick
          DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
  install(FILES ${completions}/_isobrick COMPONENT runtime DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
  install(FILES ${completions}/isobrick.fish COMPONENT runtime
          DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
endif()

# The headers that a program may include; tests/house/consumer_test.cmake compiles each alone.
include(public_headers)
foreach(header ${isobrick_public_headers})
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${PROJECT_SOURCE_DIR}/${header} COMPONENT development
          DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/isobrick/${folder})
endforeach()

# A component each: a program that extracts does not look for what the sources are built on.
set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/isobrick)
foreach(component ${isobrick_components})
  install(TARGETS isobrick_${component} EXPORT isobrick_${component}_targets
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development
          LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime
          NAMELINK_COMPONENT development)
  install(EXPORT isobrick_${component}_targets NAMESPACE isobrick:: DESTINATION ${config_folder}
          COMPONENT development)
endforeach()
configure_package_config_file(cmake/isobrick-config.cmake.in
  ${PROJECT_BINARY_DIR}/isobrick-config.cmake INSTALL_DESTINATION ${config_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/isobrick-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/isobrick-config.cmake
              ${PROJECT_BINARY_DIR}/isobrick-config-version.cmake
              ${PROJECT_SOURCE_DIR}/cmake/modules/FindIsobrickHDF5.cmake
              ${PROJECT_SOURCE_DIR}/cmake/modules/FindIsobrickOpenVDB.cmake
        DESTINATION ${config_folder} COMPONENT development)

install(FILES LICENSE NOTICE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)

# pkg-config: isobrick-storage, isobrick-extract, ... What a static library is built on is private to
# it; `pkg-config --static` names that too.
function(isobrick_pkg_config component requires requires_private libs_private)
  set(PC_NAME ${component})
  set(PC_REQUIRES ${requires})
  if(BUILD_SHARED_LIBS)
    set(PC_REQUIRES_PRIVATE "")
    set(PC_LIBS_PRIVATE "")
  else()
    set(PC_REQUIRES_PRIVATE ${requires_private})
    set(PC_LIBS_PRIVATE ${libs_private})
  endif()
  configure_file(${PROJECT_SOURCE_DIR}/cmake/isobrick.pc.in
                 ${PROJECT_BINARY_DIR}/isobrick-${component}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/isobrick-${component}.pc COMPONENT development
          DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endfunction()
if(ISOBRICK_WITH_HTTP)
  # Not by its own file: with --static that names what a static libcurl would need.
  isobrick_pkg_config(storage "" "blosc" "-lcurl -lstdc++ -lm")
else()
  isobrick_pkg_config(storage "" "blosc" "-lstdc++ -lm")
endif()
isobrick_pkg_config(extract "isobrick-storage" "tbb libhwy zlib" "-lmeshoptimizer -lstdc++ -lm")
isobrick_pkg_config(preprocess "isobrick-storage" "tbb libhwy zlib" "-lstdc++ -lm")
isobrick_pkg_config(view "isobrick-extract" "tbb" "-lstdc++ -lm")
