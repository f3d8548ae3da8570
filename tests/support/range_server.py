#!/usr/bin/env python3
"""A server of ranges for tests, which misbehaves on demand. Python's library alone.

usage: range_server.py FOLDER [--waves MS] [--certificate PEM]

Listens on a free port of 127.0.0.1, prints the port and serves until its stdin ends. The first part of a
path says how it behaves, the rest names a file in FOLDER: /good/scan.isb, /good/scan.zarr/0/zarr.json.
`BEHAVIOURS` lists all.
/stats answers with what was asked for so far, as JSON.

--waves MS: answers nothing before no request has come for MS milliseconds, then all that wait at once. So
the number of waves is the number of round trips that a client made one after the other.
"""
import argparse
import gzip
import hashlib
import hmac
import json
import os
import re
import socket
import socketserver
import ssl
import struct
import sys
import threading
import time
import urllib.parse

ETAG = '"first"'
MODIFIED = "Tue, 24 Nov 2026 10:00:00 GMT"
lock = threading.Lock()
requests = []  # {path, first, last, at}
counts = {}    # requests by path
options = None
began = time.monotonic()


class Waves:
    """Holds answers back until no further request comes."""

    def __init__(self, milliseconds):
        self.pause = milliseconds / 1000
        self.condition = threading.Condition()
        self.number = 0
        self.waiting = 0
        self.last_came = 0.0
        self.sizes = []

    def wait(self):
        with self.condition:
            mine = self.number
            self.waiting += 1
            self.last_came = time.monotonic()
            while self.number == mine:
                left = self.last_came + self.pause - time.monotonic()
                if left <= 0:
                    self.sizes.append(self.waiting)
                    self.number += 1
                    self.waiting = 0
                    self.condition.notify_all()
                else:
                    self.condition.wait(left)


class Request:
    def __init__(self, method, path, headers):
        self.method, self.path, self.headers = method, path, headers
        parts = path.split("?")[0].strip("/").split("/")
        self.behaviour = parts[0]
        self.words = parts[1:-1]
        self.name = parts[-1]
        stores = [i for i, word in enumerate(self.words) if word.endswith((".isbs", ".zarr"))]
        if stores:
            self.name = "/".join(self.words[stores[0]:] + [self.name])
            self.words = self.words[:stores[0]]
        asked = headers.get("range", "")
        found = re.fullmatch(r"bytes=(\d+)-(\d+)", asked)
        self.first, self.last = (int(found[1]), int(found[2])) if found else (None, None)
        self.end_bytes = int(asked[len("bytes=-"):]) if re.fullmatch(r"bytes=-(\d+)", asked) else None


def head(status, fields, reason="Text"):
    lines = [f"HTTP/1.1 {status} {reason}"] + [f"{name}: {value}" for name, value in fields.items()]
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


def answer(status, body=b"", **fields):
    fields = {name.replace("_", "-"): value for name, value in fields.items()}
    return head(status, {"Content-Length": len(body), **fields}) + body


class Handler(socketserver.StreamRequestHandler):
    disable_nagle_algorithm = True

    def handle(self):
        try:
            while (request := self.read_request()) is not None:
                if request.path == "/stats":
                    return self.send(answer(200, self.stats(), Connection="close"))
                with lock:
                    number = counts[request.path] = counts.get(request.path, 0) + 1
                    requests.append({"path": request.path, "first": request.first, "last": request.last,
                                     "at": round(time.monotonic() - began, 4)})
                if waves:
                    waves.wait()
                behave = BEHAVIOURS.get(request.behaviour)
                if behave is None:
                    self.send(answer(404, b"no such behaviour"))
                elif behave(self, request, number) is False:
                    return
        except (ConnectionError, ssl.SSLError, TimeoutError):
            pass

    def read_request(self):
        line = self.rfile.readline(65536).decode("latin-1").split()
        if len(line) < 2:
            return None
        headers = {}
        while (field := self.rfile.readline(65536).decode("latin-1").strip()):
            name, _, value = field.partition(":")
            headers[name.lower()] = value.strip()
        return Request(line[0], line[1], headers)

    def send(self, data):
        self.wfile.write(data)
        self.wfile.flush()

    @staticmethod
    def stats():
        with lock:
            return json.dumps({"requests": requests, "waves": waves.sizes if waves else []}).encode()


class Data:
    """The bytes of a file, of which slices are read."""

    def __init__(self, path):
        self.path = path

    def __len__(self):
        return os.path.getsize(self.path)

    def __getitem__(self, part):
        first, last, _ = part.indices(len(self))
        with open(self.path, "rb") as file:
            file.seek(first)
            return file.read(max(0, last - first))


def data_of(request):
    return Data(os.path.join(options.folder, request.name))


def good(handler, request, number, etag=ETAG, modified=MODIFIED, heeds=True, change=lambda body: body,
         **fields):
    """A server as it should be, or nearly."""
    data = data_of(request)
    if not os.path.exists(data.path):
        return handler.send(answer(404, b"no such file"))
    if heeds and request.headers.get("if-match", etag) != etag:
        return handler.send(answer(412))
    if heeds and request.headers.get("if-unmodified-since", modified) != modified:
        return handler.send(answer(412))
    if request.end_bytes and len(data) > 0:
        request.first, request.last = max(0, len(data) - request.end_bytes), len(data) - 1
    if request.first is None or request.first >= len(data):
        return handler.send(answer(416, Content_Range=f"bytes */{len(data)}"))
    last = min(request.last, len(data) - 1)
    body = change(data[request.first:last + 1])
    marks = {}
    if etag:
        marks["ETag"] = etag
    if modified:
        marks["Last_Modified"] = modified
    return handler.send(answer(206, body, Content_Range=f"bytes {request.first}-{last}/{len(data)}", **marks,
                               **fields))


SECRET = "se/cret+key"


def signed(handler, request, number):
    """S3, which accepts a request only if the signature is that of SECRET."""
    fields = dict(re.findall(r"(\w+)=([^, ]+)", request.headers.get("authorization", "")))
    scope = fields.get("Credential", "/").split("/", 1)[1]
    names = fields.get("SignedHeaders", "").split(";")
    key = urllib.parse.unquote(request.path)
    canonical = "\n".join(["GET", urllib.parse.quote(key, safe="/-._~"), "",
                           *(f"{name}:{request.headers.get(name)}" for name in names), "",
                           ";".join(names), request.headers.get("x-amz-content-sha256", "")])
    text = "\n".join(["AWS4-HMAC-SHA256", request.headers.get("x-amz-date", ""), scope,
                      hashlib.sha256(canonical.encode("latin-1")).hexdigest()])
    signature = f"AWS4{SECRET}".encode()
    for word in scope.split("/") + [text]:
        signature = hmac.new(signature, word.encode(), hashlib.sha256).digest()
    has_all = {"host", "x-amz-date", "x-amz-content-sha256"} <= set(names)
    is_token_signed = "x-amz-security-token" in names or "x-amz-security-token" not in request.headers
    if signature.hex() != fields.get("Signature") or not has_all or not is_token_signed:
        return handler.send(answer(403, b"SignatureDoesNotMatch"))
    request.name = key.rsplit("/", 1)[-1]
    return good(handler, request, number)


def ignores(handler, request, number):
    data = data_of(request)
    handler.send(head(200, {"Content-Length": len(data), "ETag": ETAG}))
    handler.send(data[:])


def ignores_without_end(handler, request, number):
    handler.send(head(200, {"ETag": ETAG}))
    while True:
        handler.send(b"x" * 65536)


def other_range(handler, request, number):
    """The right number of bytes, of another place."""
    data = data_of(request)
    first = request.first + 1 if number > 1 or request.words == ["first"] else request.first
    last = min(request.last + first - request.first, len(data) - 1)
    handler.send(answer(206, data[first:last + 1], ETag=ETAG,
                        Content_Range=f"bytes {first}-{last}/{len(data)}"))


def part_of_range(handler, request, number):
    """Says that it sends less than it was asked for, and does."""
    if number == 1:
        return good(handler, request, number)
    data = data_of(request)
    last = (request.first + request.last) // 2
    handler.send(answer(206, data[request.first:last + 1], ETag=ETAG,
                        Content_Range=f"bytes {request.first}-{last}/{len(data)}"))


def too_little(handler, request, number):
    """Says how many bytes come, and breaks off in the middle. /too-little/N/: the first N times."""
    if number == 1 or (request.words and number > 1 + int(request.words[0])):
        return good(handler, request, number)
    data = data_of(request)
    last = min(request.last, len(data) - 1)
    body = data[request.first:last + 1]
    handler.send(head(206, {"Content-Length": len(body), "ETag": ETAG,
                            "Content-Range": f"bytes {request.first}-{last}/{len(data)}"}))
    handler.send(body[:len(body) // 2])
    return False


def too_little_unsaid(handler, request, number):
    """Ends the connection early, and did not say how many bytes come."""
    if number == 1:
        return good(handler, request, number)
    data = data_of(request)
    last = min(request.last, len(data) - 1)
    handler.send(head(206, {"ETag": ETAG, "Connection": "close",
                            "Content-Range": f"bytes {request.first}-{last}/{len(data)}"}))
    handler.send(data[request.first:last])
    return False


def too_much(handler, request, number):
    """A body without a stated length that does not end."""
    if number == 1:
        return good(handler, request, number)
    data = data_of(request)
    last = min(request.last, len(data) - 1)
    handler.send(head(206, {"ETag": ETAG, "Connection": "close",
                            "Content-Range": f"bytes {request.first}-{last}/{len(data)}"}))
    handler.send(data[request.first:last + 1])
    while True:
        handler.send(b"x" * 65536)


def contradicts(handler, request, number):
    """A length of the body that is not that of the range."""
    if number == 1:
        return good(handler, request, number)
    data = data_of(request)
    last = min(request.last, len(data) - 1)
    handler.send(answer(206, data[request.first:last + 1] + b"more", ETag=ETAG,
                        Content_Range=f"bytes {request.first}-{last}/{len(data)}"))


def garbage(handler, request, number):
    """Right in form, and other bytes; /garbage/first/: from the first answer on."""
    if number == 1 and request.words != ["first"]:
        return good(handler, request, number)
    return good(handler, request, number, change=lambda body: bytes(255 - byte for byte in body))


def no_http(handler, request, number):
    """/no-http/version/: a first line that begins as one of HTTP."""
    if request.words == ["version"]:
        handler.send(b"HTTP/x\r\n\r\n" + b"x" * 100)
        return False
    handler.send(b"\x00\x01SSH-2.0-nothing\r\n" * 100)
    return False


def redirect(handler, request, number):
    """/redirect/N/BEHAVIOUR/FILE: N times, then that."""
    left = int(request.words[0])
    rest = "/".join(request.words[1:] + [request.name])
    target = f"/redirect/{left - 1}/{rest}" if left > 1 else f"/{rest}"
    handler.send(answer(302, b"elsewhere", Location=target))


def redirect_once(handler, request, number):
    """To a place that serves some requests and then forgets the file."""
    handler.send(answer(307, Location=f"/forgets/{number}/{request.name}"))


def forgets(handler, request, number):
    if number > 2:
        return handler.send(answer(403))
    return good(handler, request, number)


def nowhere(handler, request, number):
    """/nowhere/empty/: with a header that names no place."""
    handler.send(answer(302, b"elsewhere", **{"Location": "" for _ in request.words}))


def elsewhere(handler, request, number):
    """To another kind of address: /elsewhere/WORD/FILE."""
    target = {"file": "file:///etc/passwd", "ftp": "ftp://127.0.0.1/x"}[request.words[0]]
    handler.send(answer(302, b"elsewhere", Location=target))


def hangs(handler, request, number):
    """/hangs/N/: from the Nth request on; in the middle of the body if N is 'body'."""
    word = request.words[0] if request.words else "1"
    if word == "body":
        if number > 1:
            data = data_of(request)
            last = min(request.last, len(data) - 1)
            handler.send(head(206, {"Content-Length": last + 1 - request.first, "ETag": ETAG,
                                    "Content-Range": f"bytes {request.first}-{last}/{len(data)}"}))
            handler.send(data[request.first:request.first + 16])
            time.sleep(3600)
    elif number >= int(word):
        time.sleep(3600)
    return good(handler, request, number)


def fails(handler, request, number):
    """/fails/STATUS/N/FILE: after the first request, N times with that status. N is 'always', or 'first'."""
    status, times = int(request.words[0]), request.words[1]
    if times == "first" or (number > 1 and (times == "always" or number <= 1 + int(times))):
        return handler.send(answer(status, b"no", Retry_After=0))
    return good(handler, request, number)


def resets(handler, request, number):
    """/resets/N/: breaks N connections with a reset, after the first request."""
    if 1 < number <= 1 + int(request.words[0]):
        handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        handler.connection.close()
        return False
    return good(handler, request, number)


def ends(handler, request, number):
    """/ends/: closes the connection without an answer, after the first request."""
    if number > 1:
        return False
    return good(handler, request, number)


def changes(handler, request, number):
    """Another edition from the second request on. /changes/WORD/: how one can tell."""
    word = request.words[0]
    second = number > 1
    if word == "etag":
        return good(handler, request, number, etag='"second"' if second else ETAG)
    if word == "silent-etag":
        return good(handler, request, number, etag='"second"' if second else ETAG, heeds=False)
    if word == "time":
        return good(handler, request, number, etag="",
                    modified="Wed, 25 Nov 2026 10:00:00 GMT" if second else MODIFIED)
    if word == "silent-time":
        return good(handler, request, number, etag="", heeds=False,
                    modified="Wed, 25 Nov 2026 10:00:00 GMT" if second else MODIFIED)
    if word == "weak-etag":
        return good(handler, request, number, etag='W/"second"' if second else 'W/"first"', heeds=False)
    assert word == "size"
    if not second:
        return good(handler, request, number, etag="", modified="")
    size = os.path.getsize(os.path.join(options.folder, request.name)) + 1
    body = data_of(request)[request.first:request.last + 1]
    return handler.send(answer(206, body, Content_Range=f"bytes {request.first}-{request.last}/{size}"))


def cut(handler, request, number):
    """The file ends earlier from the second request on."""
    if number > 1:
        return handler.send(answer(416, Content_Range="bytes */10"))
    return good(handler, request, number)


def without_marks(handler, request, number):
    return good(handler, request, number, etag="", modified="")


def weak(handler, request, number):
    """A weak ETag, which no If-Match matches."""
    if "if-match" in request.headers:
        return handler.send(answer(412))
    return good(handler, request, number, etag='W/"first"')


def packed(handler, request, number):
    return good(handler, request, number, change=gzip.compress, Content_Encoding="gzip")


def content_range(handler, request, number):
    """/content-range/WORD/: bad ones."""
    data = data_of(request)
    first, last = request.first, min(request.last, len(data) - 1)
    text = {"unknown": f"bytes {first}-{last}/*", "none": None, "words": "bytes one-two/three",
            "reversed": f"bytes {last}-{first}/{len(data)}", "huge": f"bytes {first}-{last}/99999999999999999999",
            "negative": f"bytes -{last}/{len(data)}", "short": f"bytes {first}-{last}/{last}",
            "units": f"lines {first}-{last}/{len(data)}"}[request.words[0]]
    fields = {} if text is None else {"Content_Range": text}
    handler.send(answer(206, data[first:last + 1], ETag=ETAG, **fields))


def multipart(handler, request, number):
    handler.send(answer(206, b"--x\r\n\r\nbytes\r\n--x--", Content_Type="multipart/byteranges; boundary=x"))


def headers_without_end(handler, request, number):
    handler.send(b"HTTP/1.1 206 Partial\r\n")
    while True:
        handler.send(b"X-More: " + b"x" * 1000 + b"\r\n")


def empty(handler, request, number):
    handler.send(answer(416, Content_Range="bytes */0"))


def slow(handler, request, number):
    """/slow/MS/: so much later."""
    time.sleep(int(request.words[0]) / 1000)
    return good(handler, request, number)


def is_chunk(request):
    """A chunk of a store of Zarr 2, rather than its metadata."""
    return request.name.rsplit("/", 1)[-1].isdigit()


def refuses_chunks(handler, request, number):
    """/refuses-chunks/STATUS/STORE: serves the metadata alone."""
    if is_chunk(request):
        return handler.send(answer(int(request.words[0]), b"no"))
    return good(handler, request, number)


def cuts_chunks(handler, request, number):
    """Breaks off in the middle of every chunk."""
    is_cut = is_chunk(request) and os.path.exists(data_of(request).path)
    return too_little(handler, request, 2) if is_cut else good(handler, request, number)


def once_busy(handler, request, number):
    """Serves nothing before it was asked for it twice."""
    return handler.send(answer(503, b"no")) if number == 1 else good(handler, request, number)


def secret(handler, request, number):
    """Asks for the user 'ann' with the password 'pass'."""
    if request.headers.get("authorization") != "Basic YW5uOnBhc3M=":
        return handler.send(answer(401, WWW_Authenticate='Basic realm="x"'))
    return good(handler, request, number)


BEHAVIOURS = {
    "good": good, "signed": signed, "ignores": ignores, "ignores-without-end": ignores_without_end, "other-range": other_range,
    "part-of-range": part_of_range, "too-little": too_little, "too-little-unsaid": too_little_unsaid,
    "too-much": too_much, "contradicts": contradicts, "garbage": garbage, "no-http": no_http,
    "redirect": redirect, "redirect-once": redirect_once, "forgets": forgets, "nowhere": nowhere,
    "elsewhere": elsewhere, "circle": lambda h, r, n: h.send(answer(302, Location=r.path)), "hangs": hangs,
    "index-only": lambda h, r, n: (good if r.name.endswith("index.isb") else hangs)(h, r, n),
    "fails": fails, "resets": resets, "ends": ends, "changes": changes, "cut": cut,
    "without-marks": without_marks, "weak": weak, "packed": packed, "content-range": content_range,
    "multipart": multipart, "headers-without-end": headers_without_end, "empty": empty, "slow": slow,
    "refuses-chunks": refuses_chunks, "cuts-chunks": cuts_chunks, "once-busy": once_busy, "secret": secret,
}


class Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True
    request_queue_size = 128

    def handle_error(self, request, client_address):
        pass  # a client that goes away


def main():
    global options, waves
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--waves", type=int, default=0)
    parser.add_argument("--certificate")
    options = parser.parse_args()
    waves = Waves(options.waves) if options.waves else None
    server = Server(("127.0.0.1", 0), Handler)
    if options.certificate:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(options.certificate)
        server.socket = context.wrap_socket(server.socket, server_side=True, do_handshake_on_connect=False)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    print(server.server_address[1], flush=True)
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main()
