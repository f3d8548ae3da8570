# `cmake --install` and find_package(isobrick): the command, and the library under it (storage,
# preprocess, extract) with its headers.
include(CMakePackageConfigHelpers)

install(TARGETS isobrick_storage isobrick_preprocess isobrick_sources isobrick_extract EXPORT isobrick_targets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
if(TARGET isobrick)
install(TARGETS isobrick RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
foreach(folder storage preprocess extract)
  # itk_common.h is private to the ITK sources; its users would need ITK.
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/${folder} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/isobrick
          FILES_MATCHING PATTERN "*.h" PATTERN "itk_common.h" EXCLUDE)
endforeach()

set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/isobrick)
install(EXPORT isobrick_targets NAMESPACE isobrick:: DESTINATION ${config_folder})
configure_package_config_file(cmake/isobrick-config.cmake.in
  ${PROJECT_BINARY_DIR}/isobrick-config.cmake INSTALL_DESTINATION ${config_folder})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/isobrick-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/isobrick-config.cmake
              ${PROJECT_BINARY_DIR}/isobrick-config-version.cmake
        DESTINATION ${config_folder})
