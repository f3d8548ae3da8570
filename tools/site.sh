#!/usr/bin/env bash
# Builds the site of the documents: docs/ by MkDocs Material with search, the options from the command itself,
# Python by mkdocstrings, C++ by Doxygen. Any warning of MkDocs fails, and so does a link that leads nowhere.
#   tools/site.sh [FOLDER]        default: build/site/html
# ISOBRICK names the command if it lies elsewhere than in build/ci-release, build/release or the PATH.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$(realpath -m "${1:-build/site/html}")
venv=build/site/venv
ISOBRICK=$(realpath "${ISOBRICK:-$(PATH=build/ci-release:build/release:$PATH command -v isobrick)}")
export ISOBRICK NO_MKDOCS_2_WARNING=1
# The environment is made once for each list of versions.
if ! cmp -s docs/requirements.txt $venv/made-of; then
  rm -rf $venv
  /usr/bin/python3 -m venv $venv
  $venv/bin/pip install -q -r docs/requirements.txt
  cp docs/requirements.txt $venv/made-of
fi
$venv/bin/mkdocs build --strict --site-dir "$out"
cmake -D OUT=build/site/reference -P docs/reference.cmake
cp -r build/site/reference/html "$out/cpp"
echo "site: $out/index.html"
