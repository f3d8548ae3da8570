#!/usr/bin/env bash
# Builds the site of the documents: docs/ by MkDocs Material with search, the options from the command itself,
# Python by mkdocstrings, C++ by Doxygen. Any warning fails, and so does any link that leads nowhere.
#   tools/site.sh [FOLDER]        default: build/site/html
# The environment is build/site/venv, with the versions of tools/site/requirements.txt. ISOBRICK names the
# command if it lies elsewhere than in build/ci-release, build/release or the PATH.
set -euo pipefail
cd "$(dirname "$0")/.."
out=$(realpath -m "${1:-build/site/html}")
venv=build/site/venv
isobrick=${ISOBRICK:-}
for candidate in build/ci-release/isobrick build/release/isobrick "$(command -v isobrick || true)"; do
  if [ -z "$isobrick" ] && [ -x "$candidate" ]; then isobrick=$candidate; fi
done
[ -x "$isobrick" ] || { echo "no isobrick was found; build it, or name it: ISOBRICK=PATH tools/site.sh" >&2; exit 1; }

# The environment is made once for each list of versions.
if ! cmp -s tools/site/requirements.txt $venv/made-of; then
  rm -rf $venv
  /usr/bin/python3 -m venv $venv
  $venv/bin/pip install -q --no-deps -r tools/site/requirements.txt
  cp tools/site/requirements.txt $venv/made-of
fi
mkdir -p build/site
# Not --quiet: it hides warnings from --strict, too.
ISOBRICK=$(realpath "$isobrick") NO_MKDOCS_2_WARNING=1 $venv/bin/mkdocs build --strict --site-dir "$out" \
  >build/site/mkdocs.log 2>&1 || { cat build/site/mkdocs.log; exit 1; }
cmake -D OUT=build/site/reference -P docs/reference.cmake >build/site/reference.log || { cat build/site/reference.log; exit 1; }
cp -r build/site/reference/html "$out/cpp"
$venv/bin/python tools/site/check_links.py "$out"
echo "site: $out/index.html"
