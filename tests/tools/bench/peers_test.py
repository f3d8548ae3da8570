"""Rows of other libraries beside isobrick's, and whole processes from file to mesh: of the packages that are here.

  peers_test.py ISOBRICK SOURCE VENV      VENV is a Python environment with VTK and scikit-image, if it is there
"""

import json
import os
import subprocess
import sys
import tempfile
import unittest

isobrick, source, venv = sys.argv[1:]
del sys.argv[1:]
folder = f"{source}/tools/bench/peers"
peers = f"{folder}/bench_peers.py"
# The tests of the Python module may just be making it.
has_venv = os.path.exists(f"{venv}/bin/python3") and subprocess.run(
    [f"{venv}/bin/python3", "-c", "import vtkmodules, skimage, SimpleITK, trimesh"], capture_output=True, check=False).returncode == 0
environment = {**os.environ, "PYTHONPATH": "", "PYTHONDONTWRITEBYTECODE": "1"}
if has_venv:
    environment["PATH"] = f"{venv}/bin:{environment['PATH']}"
work = tempfile.TemporaryDirectory()


def run(*words):
    return subprocess.run([*map(str, words)], capture_output=True, text=True, env=environment, cwd=work.name, check=False)


def run_well(*words):
    done = run(*words)
    assert done.returncode == 0, (words, done.stderr)
    return done.stdout


def listed(*names):
    return dict(line.split() for line in run_well(peers, "--list", *names).splitlines())


def volume(voxel_type):
    # Not a multiple of a brick, so that every brick's share of the voxels counts.
    run_well(isobrick, "phantom", "gyroid", "--voxels", 37, "--type", voxel_type, "-o", "gyroid.nrrd", "--force")
    run_well(isobrick, "build", "gyroid.nrrd", "--brick", 16, "--force")


def bench(isovalue, rows):
    rows = run_well(isobrick, "bench", "gyroid.isb", f"--iso={isovalue}", "--rounds", 1, "--repeat", 1, "--threads", 2,
                    "--peers", peers, "--rows", ",".join(rows), "--json")
    return {row["name"]: row for row in json.loads(rows)["rows"]}


class Peers(unittest.TestCase):
    def test_rows_are_listed_by_package_and_number(self):
        rows = listed("openvdb-0.03", "openvdb-0.1", "openvdb-1.5", "openvdb-x", "isobrick", "vtkMarchingCubes-0.5")
        self.assertEqual([name for name in rows if name.startswith("openvdb")],
                         ["openvdb-0", "openvdb-0.1", "openvdb-0.5", "openvdb-0.03"] if "openvdb-0" in rows else [])
        self.assertNotIn("isobrick", rows)
        self.assertNotIn("vtkMarchingCubes-0.5", rows)
        if has_venv:
            self.assertIn("skimage", rows)
            self.assertEqual(rows["vtkFlyingEdges3D"], "exact")

    def test_their_surfaces_are_ours_in_each_type(self):
        exact = [name for name, kind in listed().items() if kind == "exact"]
        near = [name for name in listed() if name == "openvdb-0"]
        for voxel_type, isovalue in (("u8", 127.5), ("i8", -0.5), ("u16", 32767.5), ("i16", -0.5), ("f32", 0.01)):
            volume(voxel_type)
            rows = bench(isovalue, ["isobrick", *exact, *near])
            own = rows.pop("isobrick")
            self.assertGreater(own["triangles"], 10000)
            for name, row in rows.items():
                self.assertNotIn("failure", row, name)
                if name in exact:
                    # Ambiguous faces may be cut differently.
                    self.assertLess(abs(row["triangles"] - own["triangles"]), 0.03 * own["triangles"], (name, voxel_type))
                if name.startswith("vtk"):
                    self.assertEqual(row["vertices"], own["vertices"], (name, voxel_type))
                if name in near:
                    for way in row["distance"].values():
                        self.assertLess(way["mean"], 0.1, (name, voxel_type))

    def test_surfaces_become_smaller_near_the_finest(self):
        volume("u16")
        names = [name for name in ("openvdb-0.2", "vtkQuadricDecimation-0.7", "vtkDecimatePro-0.7") if name in listed(name)]
        rows = bench(32767.5, ["isobrick", *names])
        for name in names:
            self.assertLess(rows[name]["triangles"], rows["isobrick"]["triangles"], name)
            self.assertLess(rows[name]["distance"]["to_finest"]["mean"], 0.5, name)

    def test_failures_are_one_line(self):
        volume("u8")
        words = [peers, "no.raw", "--dims", "37,37,37", "--type", "uint8", "--iso", 1, "--row"]
        for row, expected in (("none", "there is no row 'none'"), (next(iter(listed())), "no.raw")):
            done = run(*words, row)
            self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (1, "", 1), done.stderr)
            self.assertIn(expected, done.stderr)

    @unittest.skipUnless(has_venv, "VTK and scikit-image")
    def test_scripts_go_from_file_to_mesh(self):
        volume("u8")
        ours = json.loads(run_well(isobrick, "extract", "gyroid.nrrd", "--iso", 127.5, "-o", "own.ply", "--json"))
        for script in ("vtk_peer", "skimage_peer"):
            run_well(f"{venv}/bin/python3", f"{folder}/{script}.py", "gyroid.nrrd", 127.5, f"{script}.ply", 2)
            with open(f"{work.name}/{script}.ply", "rb") as file:
                header = file.read(500).split(b"end_header")[0].decode()
            faces = int(header.split("element face ")[1].split()[0])
            self.assertLess(abs(faces - ours["triangles"]), 0.01 * ours["triangles"], script)


if not listed():
    print("skipped: neither VTK, OpenVDB, scikit-image nor PyMCubes is here")
    sys.exit(0)
unittest.main()
