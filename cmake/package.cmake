# `cpack`: a .deb with the command and one with the library's headers and archives.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME isobrick)
set(CPACK_PACKAGE_VENDOR isobrick)
set(CPACK_PACKAGE_CONTACT "isobrick <isobrick@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime development)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME isobrick)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
# What is loaded by name rather than linked: pictures are drawn by whatever GL there is.
set(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS "libegl1, libopengl0, libgl1, libgl1-mesa-dri")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libisobrick-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
  "libtbb-dev, libglm-dev, libblosc-dev, libhwy-dev, libmeshoptimizer-dev, nlohmann-json3-dev, zlib1g-dev, libexpat1-dev")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SUGGESTS
  "libinsighttoolkit5-dev, libopenvdb-dev, libhdf5-dev, libtiff-dev, libzstd-dev, libopenexr-dev, libpng-dev, libepoxy-dev")
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE ${PROJECT_SOURCE_DIR}/NOTICE
        DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT runtime)
include(CPack)
