#!/usr/bin/env bash
# What an installed command serves: the page whole, or, if it was built without one, word of how it is made.
#   served_page.sh ISOBRICK [PYRAMID]       default: of a phantom
# ISOBRICK_WITHOUT_PAGE=1: the command has to be one without.
set -euo pipefail
isobrick=$(realpath "$1")
work=$(mktemp -d /tmp/isobrick_page_XXXXXX)
pyramid=${2:-$work/head.isb}
[ -e "$pyramid" ] || "$isobrick" build phantom:head:32 -o "$pyramid" >/dev/null
"$isobrick" serve "$pyramid" >"$work/url" 2>"$work/said" &
server=$!
trap 'kill $server; wait $server 2>/dev/null; rm -rf "$work"' EXIT
for _ in $(seq 100); do [ ! -s "$work/url" ] || break; sleep 0.1; done
address=$(sed 's|/#.*||' "$work/url")
python3 - "$address" "${ISOBRICK_WITHOUT_PAGE:-}" <<'PYTHON'
import gzip
import re
import sys
import urllib.error
import urllib.request

address, is_without = sys.argv[1:]
opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def get(name: str) -> bytes:
    request = urllib.request.Request(f"{address}/{name}", headers={"Accept-Encoding": "gzip"})
    with opener.open(request, timeout=30) as answer:
        return bytes(answer.read())


if is_without:
    try:
        get("")
    except urllib.error.HTTPError as refusal:
        assert b"no page" in refusal.read()
        print("serve: no page, and says so")
        sys.exit()
    sys.exit("there is a page where none was built")
packed = [get("")]
html = gzip.decompress(packed[0]).decode()
names = [name for name in re.findall(r'(?:src|href)="([^"]+)"', html) if name[0] != "#"]
assert "main.js" in names and "style.css" in names, names
packed += [get(name) for name in [*names, "decode_worker.js"]]
assert sum(map(len, packed)) <= 400_000
print(f"serve: page of {sum(map(len, packed)):,} bytes packed")
PYTHON
