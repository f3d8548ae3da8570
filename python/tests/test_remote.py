"""Pyramids behind URLs: a server of ranges, and S3 as moto has it."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import isobrick

SERVER = Path(__file__).parents[2] / "tests" / "support" / "range_server.py"


class Server:
    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, SERVER, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.port}/{path}"


@pytest.fixture(scope="module")
def server(head: Path) -> Iterator[Server]:
    running = Server(head.parent)
    yield running
    assert running.process.stdin is not None
    running.process.stdin.close()
    running.process.wait()


def same(a: isobrick.Mesh, b: isobrick.Mesh) -> bool:
    return bool(
        np.array_equal(a.points, b.points)
        and np.array_equal(a.faces, b.faces)
        and np.array_equal(a.normals, b.normals)
    )


def test_a_url_is_opened_as_a_path(server: Server, head: Path) -> None:
    with isobrick.open(server.url("good/head.isb")) as far, isobrick.open(head) as near:
        assert far.shape == near.shape and far.dtype == near.dtype
        assert same(far.extract(500, focus=(60, 60, 60), radius=10), near.extract(500, focus=(60, 60, 60), radius=10))
        assert np.array_equal(far.levels[1][:], near.levels[1][:])
        assert far.remote_counters.requests > 2 and far.remote_counters.bytes > 0
        assert near.remote_counters.requests == 0
        assert far.path == server.url("good/head.isb")
        copy = pickle.loads(pickle.dumps(far))
        assert copy.shape == near.shape


def test_parts_stay_in_the_cache_folder(server: Server, tmp_path: Path) -> None:
    url = server.url("good/head.isb")
    for expected in (False, True):
        with isobrick.open(url, cache_folder=tmp_path, cache_size="100M") as pyramid:
            pyramid.extract(500)
            assert (pyramid.remote_counters.cached_parts > 0) is expected


def test_failures_say_what_to_do(server: Server) -> None:
    with pytest.raises(isobrick.Error, match="ignores ranges"):
        isobrick.open(server.url("ignores/head.isb"))
    with pytest.raises(isobrick.Error, match="no such file"):
        isobrick.open(server.url("fails/404/first/head.isb"))
    with pytest.raises(isobrick.Error, match="was changed"):
        isobrick.open(server.url("changes/etag/head.isb")).extract(500)
    url = server.url("good/head.isb").replace("http://", "http://ann:pass@") + "?token=hidden"
    with isobrick.open(url) as pyramid:
        assert "pass" not in repr(pyramid) and "hidden" not in repr(pyramid)


def test_ctrl_c_does_not_wait_for_the_server(server: Server) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which pytest-xdist's processes ignore
    threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        isobrick.open(server.url("hangs/1/head.isb"))
    assert time.monotonic() - begin < 5


# ---- S3


@pytest.fixture(scope="module")
def bucket(head: Path) -> Iterator[str]:
    """The endpoint of a server with s3://scans/dir/a head+1.isb, which wants keys, and s3://scans/public.isb."""
    import boto3
    from moto.server import ThreadedMotoServer

    moto = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    moto.start()
    host, port = moto.get_host_and_port()
    endpoint = f"http://{host}:{port}"
    client = boto3.client(
        "s3", endpoint_url=endpoint, region_name="us-east-1", aws_access_key_id="id", aws_secret_access_key="secret"
    )
    client.create_bucket(Bucket="scans")
    client.upload_file(str(head), "scans", "dir/a head+1.isb")
    client.upload_file(str(head), "scans", "public.isb", ExtraArgs={"ACL": "public-read"})
    yield endpoint
    moto.stop()


@pytest.fixture
def clean(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> pytest.MonkeyPatch:
    for name in [name for name in os.environ if name.startswith("AWS_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HOME", str(tmp_path))
    return monkeypatch


URL = "s3://scans/dir/a head+1.isb"


def test_s3_by_keys(bucket: str, head: Path, clean: pytest.MonkeyPatch) -> None:
    clean.setenv("AWS_ENDPOINT_URL", bucket)
    clean.setenv("AWS_ACCESS_KEY_ID", "id")
    clean.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    clean.setenv("AWS_SESSION_TOKEN", "token")
    with isobrick.open(URL) as far, isobrick.open(head) as near:
        assert same(far.extract(500), near.extract(500))
    with pytest.raises(isobrick.Error, match="no such file"):
        isobrick.open("s3://scans/none.isb")


def test_s3_by_a_profile(bucket: str, clean: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / ".aws").mkdir()
    (tmp_path / ".aws" / "credentials").write_text("[lab]\naws_access_key_id = id\naws_secret_access_key = secret\n")
    (tmp_path / ".aws" / "config").write_text(f"[profile lab]\nregion = eu-west-1\nendpoint_url = {bucket}\n")
    clean.setenv("AWS_PROFILE", "lab")
    with isobrick.open(URL) as far:
        assert far.shape == (128, 128, 128)
    clean.setenv("AWS_PROFILE", "other")
    with pytest.raises(isobrick.Error, match="no profile 'other'"):
        isobrick.open(URL)


def test_s3_anonymously(bucket: str, clean: pytest.MonkeyPatch) -> None:
    clean.setenv("AWS_ENDPOINT_URL_S3", bucket)
    with isobrick.open("s3://scans/public.isb") as far:
        assert far.shape == (128, 128, 128)
    with pytest.raises(isobrick.Error, match="refuses access"):
        isobrick.open(URL)


def test_s3_signatures_are_checked_by_the_server(bucket: str, clean: pytest.MonkeyPatch) -> None:
    """With moto's own check of signatures, which tells right keys from wrong ones."""
    import boto3
    import requests

    iam = boto3.client(
        "iam", endpoint_url=bucket, region_name="us-east-1", aws_access_key_id="id", aws_secret_access_key="secret"
    )
    iam.create_user(UserName="ann")
    iam.put_user_policy(
        UserName="ann",
        PolicyName="all",
        PolicyDocument='{"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "*", "Resource": "*"}]}',
    )
    keys = iam.create_access_key(UserName="ann")["AccessKey"]
    requests.post(f"{bucket}/moto-api/reset-auth", data="0", timeout=10)
    try:
        clean.setenv("AWS_ENDPOINT_URL", bucket)
        clean.setenv("AWS_ACCESS_KEY_ID", keys["AccessKeyId"])
        clean.setenv("AWS_SECRET_ACCESS_KEY", keys["SecretAccessKey"])
        with isobrick.open(URL) as far:
            assert far.shape == (128, 128, 128)
        clean.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
        with pytest.raises(isobrick.Error, match="refuses access"):
            isobrick.open(URL)
    finally:
        requests.post(f"{bucket}/moto-api/reset-auth", data="1000000", timeout=10)
