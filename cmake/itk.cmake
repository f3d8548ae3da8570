# ITK reads the medical formats. Only preprocess/itk_*.cpp include it.
find_package(ITK 5 REQUIRED COMPONENTS
  ITKIOImageBase ITKIONRRD ITKIOMeta ITKIONIFTI ITKIOTIFF ITKIOGDCM ITKIOPNG ITKIOMRC ITKIOGIPL
  ITKIOVTK ITKIOLSM ITKIOBioRad)
target_include_directories(isobrick_preprocess SYSTEM PRIVATE ${ITK_INCLUDE_DIRS})
target_link_libraries(isobrick_preprocess PRIVATE ${ITK_LIBRARIES})
