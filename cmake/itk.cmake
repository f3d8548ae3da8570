# ITK reads the medical formats. Only preprocess/sources/itk_*.cpp include it.
find_package(ITK 5 REQUIRED COMPONENTS
  ITKIOImageBase ITKIONRRD ITKIOMeta ITKIONIFTI ITKIOTIFF ITKIOGDCM ITKIOPNG ITKIOMRC ITKIOGIPL
  ITKIOVTK ITKIOLSM ITKIOBioRad)
target_include_directories(isobrick_sources SYSTEM PRIVATE ${ITK_INCLUDE_DIRS})
target_link_libraries(isobrick_sources PRIVATE ${ITK_LIBRARIES})
