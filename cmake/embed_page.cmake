# cmake -D FOLDER=DIST -D OUTPUT=FILE.cpp -P embed_page.cmake
# Writes C++ that holds the files of the page (viewer/serve/page_files.h); without a folder there are none.
file(GLOB files "${FOLDER}/*")
set(arrays "")
set(rows "")
set(number 0)
foreach(file ${files})
  get_filename_component(name "${file}" NAME)
  file(READ "${file}" hex HEX)
  string(LENGTH "${hex}" digits)
  math(EXPR bytes "${digits} / 2")
  string(REGEX REPLACE "(..)" "0x\\1," numbers "${hex}")
  string(APPEND arrays "const unsigned char kFile${number}[] = {${numbers}0};\n")
  string(APPEND rows "    {\"${name}\", {reinterpret_cast<const char*>(kFile${number}), ${bytes}}},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE "${OUTPUT}" "#include \"isobrick/viewer/serve/page_files.h\"

namespace isobrick {
namespace {
${arrays}
}  // namespace

const std::vector<PageFile>& pageFiles() {
  static const std::vector<PageFile> kFiles{
${rows}  };
  return kFiles;
}

}  // namespace isobrick
")
