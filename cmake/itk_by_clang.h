// Included first by clang where ITK is included. ITK 5.2 knows the compiler alone that it was built by, which for
// Debian's is g++; clang takes what it says of a recent one.
#pragma clang system_header
#if __has_include(<itk_compiler_detection.h>)
#pragma push_macro("__clang__")
#pragma push_macro("__GNUC__")
#undef __clang__
#undef __GNUC__
#define __GNUC__ 12
#include <itk_compiler_detection.h>
#pragma pop_macro("__GNUC__")
#pragma pop_macro("__clang__")
#endif
