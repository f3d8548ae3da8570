# cmake -D INPUT=FILE -D OUTPUT=FILE.cpp -D NAME=NAME -P embed_file.cmake
# Writes C++ that holds the bytes of a file: isobrick::NAME and isobrick::NAMEBytes. Without a file
# there are none, and NAME is one zero.
if(INPUT)
  file(READ "${INPUT}" hex HEX)
  string(LENGTH "${hex}" digits)
  math(EXPR bytes "${digits} / 2")
else()
  set(hex 00)
  set(bytes 0)
endif()
string(REGEX REPLACE "(..)" "0x\\1," numbers "${hex}")
string(REGEX REPLACE "(................................................................................)" "\\1\n"
       numbers "${numbers}")
file(WRITE "${OUTPUT}" "namespace isobrick {
extern const unsigned char ${NAME}[];
extern const int ${NAME}Bytes;
const int ${NAME}Bytes = ${bytes};
const unsigned char ${NAME}[] = {
${numbers}
};
}
")
