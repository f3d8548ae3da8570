#!/usr/bin/env bash
# Draws the house: which folder includes which, as a graph in Mermaid, and for each folder its files,
# lines, longest function and longest class.
#   tests/house/picture.sh            of the working tree
#   tests/house/picture.sh COMMIT     of a commit
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ $# -gt 0 ]; then
  tree=$(mktemp -d)
  trap 'rm -rf "$tree"' EXIT
  git archive "$1" | tar -x -C "$tree"
  cd "$tree"
fi
rooms=(storage preprocess extract viewer tools)
mapfile -t files < <(find "${rooms[@]}" -name '*.h' -o -name '*.cpp' | LC_ALL=C sort)

echo '```mermaid'
echo 'graph LR'
awk '
  function folderOf(path) { sub(/\/[^\/]*$/, "", path); return path }
  /^#include "/ {
    split($0, quoted, "\"")
    to = quoted[2]
    sub(/^isobrick\//, "", to)
    from = folderOf(FILENAME)
    to = folderOf(to)
    if (from != to) ++count[from " " to]
  }
  END {
    for (edge in count) {
      split(edge, ends, " ")
      print "  " ends[1] " -->|" count[edge] "| " ends[2]
    }
  }' "${files[@]}" | LC_ALL=C sort
echo '```'
echo

# A definition begins where the last one, or the last statement, ended, and ends with its brace. What
# is in a function (lambdas, local classes) belongs to it. Good for code as clang-format leaves it.
echo '| folder | files | lines | longest function | longest class |'
echo '|---|--:|--:|---|---|'
awk '
  function folderOf(path) { sub(/\/[^\/]*$/, "", path); return path }
  function nameOf(text,    name) {
    gsub(/<[^<>]*>/, "", text)
    while (match(text, /(operator[^A-Za-z_ ]+|[A-Za-z_~][A-Za-z_0-9:~]*) *\(/)) {
      name = substr(text, RSTART, RLENGTH - 1)
      sub(/ +$/, "", name)
      if (name !~ /^(decltype|noexcept|requires|alignas|sizeof)$/) return name
      text = substr(text, RSTART + RLENGTH)
    }
    return "?"
  }
  function open() {
    kind[++depth] = "other"
    if (text ~ /(^| )namespace( |$)/ || text ~ /extern *$/) kind[depth] = "namespace"
    else if (text ~ /(^| |>)(class|struct|union) +[A-Za-z_]/ && text !~ /[()=]/) {
      kind[depth] = "class"
      name[depth] = text
      sub(/^.*(class|struct|union) +/, "", name[depth])
      sub(/[ :].*$/, "", name[depth])
    } else if (text ~ /\(/ && text !~ /(^|[^=!<>])=[^=]/ && text !~ /^ *(enum)/ &&
               (depth == 1 || kind[depth - 1] ~ /namespace|class/)) {
      kind[depth] = "function"
      name[depth] = nameOf(text)
    }
    first[depth] = begin
    text = ""
  }
  function close_(    lines) {
    if (depth == 0) return
    lines = FNR - first[depth] + 1
    if (kind[depth] ~ /function|class/ && lines > most[folder, kind[depth]]) {
      most[folder, kind[depth]] = lines
      which[folder, kind[depth]] = name[depth]
    }
    --depth
    text = ""
  }
  FNR == 1 { depth = 0; text = ""; is_raw = goes_on = 0; folder = folderOf(FILENAME); ++files[folder] }
  { ++lines_of[folder]; line = $0 }
  is_raw { if (line !~ /\)"/) next; sub(/^.*\)"/, "", line); is_raw = 0 }
  line ~ /R"[a-z]*\(/ && line !~ /\)"/ { sub(/R"[a-z]*\(.*$/, "", line); is_raw = 1 }
  line ~ /^ *#/ || goes_on { goes_on = (line ~ /\\$/); next }
  {
    gsub(/\\./, "", line)
    gsub(/"[^"]*"/, "", line)
    gsub(/\047[^\047]*\047/, "", line)
    sub(/\/\/.*$/, "", line)
    while (match(line, /[{};]/)) {
      before = substr(line, 1, RSTART - 1)
      sign = substr(line, RSTART, 1)
      if (text == "" && before ~ /[^ ]/) begin = FNR
      text = text " " before
      line = substr(line, RSTART + 1)
      if (sign == "{" && text ~ /\) *:.*[A-Za-z_>]$/) {  # a member, initialised with braces
        if (match(line, /\}/)) line = substr(line, RSTART + 1)
      } else if (sign == "{") open()
      else if (sign == "}") close_()
      else text = ""
    }
    sub(/(^| )(public|private|protected):/, "", line)
    if (text == "" && line ~ /[^ ]/) begin = FNR
    if (line ~ /[^ ]/) text = text " " line
  }
  function entry(what) {
    return (folder, what) in most ? "`" which[folder, what] "`, " most[folder, what] : ""
  }
  END {
    for (folder in files)
      print "| `" folder "/` | " files[folder] " | " lines_of[folder] " | " entry("function") " | " \
            entry("class") " |"
  }' "${files[@]}" | LC_ALL=C sort
