#!/usr/bin/env bash
# clang-tidy 14 (the checks of .clang-tidy) and cppcheck on the command and the libraries; ends with the findings of each
# check, and with 1 if there is one.
#   tests/house/lint.sh [clang-tidy] [cppcheck]        default: both
# Takes ten minutes of a core. Compiles nothing; its notes of how to compile, and what was found, stay in build/lint.
set -euo pipefail
cd "$(dirname "$0")/../.."
tools=("$@")
[ $# -gt 0 ] || tools=(clang-tidy cppcheck)
jobs=${ISOBRICK_JOBS:-$(nproc)}
tools/install_packages.sh build release
if [[ " ${tools[*]} " == *" clang-tidy "* ]] && ! clang-tidy --version | grep -q 'version 14\.'; then
  echo "clang-tidy 14 was not found; Debian 12 has it; lint.sh cppcheck runs the other alone" >&2
  exit 2
fi
rooms=(storage preprocess extract viewer tools)
lint=build/lint
found=$lint/found
mkdir -p $lint

# Files in batches, as they are compiled: most of the time goes into headers.
cmake --preset clang -B $lint -D ISOBRICK_TESTS=OFF -D CMAKE_DISABLE_PRECOMPILE_HEADERS=ON >$lint/configure.log 2>&1 ||
  { tail -n 40 $lint/configure.log; exit 1; }

run_clang_tidy() {
  python3 -c 'import json, sys
for entry in json.load(open(sys.argv[1])):  # but for those that only a build makes
    if "/Unity/" in entry["file"] or "/build/lint/" not in entry["file"]:
        print(entry["file"])' $lint/compile_commands.json |
    xargs -P "$jobs" -n 1 clang-tidy --quiet -p $lint 2>$lint/clang-tidy.log
}

# Of its own checks, those that C++20 leads astray: it does not see that a thing is made of what goes, rather than refers to
# it, that a reference is chosen by a condition, that what was moved gets a new value, that a function in `throw` leaves,
# that a class is final, and that `int{a} & int{b}` takes no address. Templates of lambdas are wrong syntax to it.
cppcheck_misled=(invalidLifetime danglingTemporaryLifetime danglingTempReference returnTempReference
  mismatchingContainerIterator accessMoved containerOutOfBounds derefInvalidIteratorRedundantCheck syntaxError internalAstError
  virtualCallInConstructor AssignmentAddressToInteger)
run_cppcheck() {
  cppcheck -j "$jobs" --language=c++ --std=c++20 --enable=warning,portability --inline-suppr --quiet -I $lint/include -I . \
    "${cppcheck_misled[@]/#/--suppress=}" --template='{file}:{line}:{column}: error: {message} [{id}]' "${rooms[@]}" 2>&1
}

status=0
for tool in "${tools[@]}"; do
  seconds=$SECONDS ended=0
  "run_${tool/-/_}" >"$found.$tool.all" || ended=$?
  sed -n "s|^$PWD/||; s|^$lint/include/isobrick/||; /: \(error\|warning\|style\): .*\]$/p" "$found.$tool.all" |
    LC_ALL=C sort -u >"$found.$tool"
  echo "$tool: $(git ls-files "${rooms[@]}" | grep -cE '\.(h|cpp)$') files, $((SECONDS - seconds)) s, $(wc -l <"$found.$tool") findings"
  cat "$found.$tool"
  sed 's/.*\[\([^],]*\).*\]$/\1/' "$found.$tool" | sort | uniq -c | sort -rn
  [ "$ended" = 0 ] || [ -s "$found.$tool" ] || tail -n 20 $lint/clang-tidy.log "$found.$tool.all"
  [ "$ended" = 0 ] && [ ! -s "$found.$tool" ] || status=1
done
[ $status = 0 ] || { echo "lint: FAILS"; exit 1; }
echo "lint: works"
