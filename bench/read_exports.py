#!/usr/bin/env python3
"""Reads every export of `rugosa map` back with other people's readers.

usage: read_exports.py path/to/rugosa

An asymmetric raster with a hole goes through `rugosa map`; each file is then opened with
an independent reader (numpy, Pillow, PyYAML, mcap + rosbags, rasterio, plyfile) and
compared cell by cell, so that a swapped or mirrored axis cannot pass. A reader that is
not installed is said in the last line, and the exit code is then 3.
"""
import importlib
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

NX, NY, RESOLUTION, CORNER = 40, 30, 0.5, (1000.0, 2000.0)


def raster():
    column, row = np.meshgrid(np.arange(NX), np.arange(NY))
    z = 0.02 * column + 0.002 * row**2
    z[:3, 37:] = np.nan
    return z


def write_asc(path, z):
    rows = [" ".join("-9999" if np.isnan(v) else repr(float(v)) for v in line) for line in z[::-1]]
    head = f"ncols {NX}\nnrows {NY}\nxllcorner {CORNER[0]}\nyllcorner {CORNER[1]}\ncellsize {RESOLUTION}\nNODATA_value -9999\n"
    path.write_text(head + "\n".join(rows) + "\n")


def same(name, ours, theirs, tolerance=0.01):
    assert ours.shape == theirs.shape, (name, ours.shape, theirs.shape)
    assert (np.isnan(ours) == np.isnan(theirs)).all(), f"{name}: other cells are unknown"
    error = np.nanmax(np.abs(ours - theirs))
    assert error <= tolerance, f"{name}: off by {error}"
    print(f"{name:<28} agrees within {error:.2g}")


def npy(out, z):
    same("npy (numpy)", z, np.load(out / "elevation.npy"))


def png(out, _):
    image = importlib.import_module("PIL.Image").open(out / "elevation.png")
    image.load()
    assert image.width > 400 and image.mode == "RGB"
    print("png (Pillow)                 opens,", image.size)


def nav2(out, _):
    meta = importlib.import_module("yaml").safe_load((out / "map.yaml").read_text())
    assert meta["mode"] == "raw" and meta["resolution"] == RESOLUTION and meta["negate"] == 0
    assert meta["origin"] == [CORNER[0], CORNER[1], 0.0]
    pgm = np.asarray(importlib.import_module("PIL.Image").open(out / meta["image"]))
    cost = 100 * (1 - np.load(out / "traversability.npy"))
    theirs = pgm[::-1].astype(float)
    theirs[theirs > 100] = np.nan
    same("nav2 (PyYAML, Pillow)", cost, theirs, 0.51)


def geotiff(out, z):
    with importlib.import_module("rasterio").open(out / "elevation.tif") as data:
        same("geotiff (rasterio)", z, data.read(1)[::-1])
        assert data.transform * (0, 0) == (CORNER[0], CORNER[1] + NY * RESOLUTION)
        assert np.isnan(data.nodata)


def ply(out, z):
    data = importlib.import_module("plyfile").PlyData.read(out / "surface.ply")
    v = data["vertex"]
    column = np.floor((v["x"] - CORNER[0]) / RESOLUTION).astype(int)
    row = np.floor((v["y"] - CORNER[1]) / RESOLUTION).astype(int)
    theirs = np.full_like(z, np.nan)
    theirs[row, column] = v["z"]
    same("ply (plyfile)", z, theirs)
    assert max(max(f) for f in data["face"]["vertex_indices"]) < len(v)


def mcap(out, z):
    reader = importlib.import_module("mcap.reader")
    typesys = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    with open(out / "map.mcap", "rb") as file:
        messages = list(reader.make_reader(file).iter_messages())
    for schema, _, _ in messages:
        store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
    decoded = {c.topic: store.deserialize_cdr(m.data, s.name) for s, c, m in messages}
    grid_map(decoded["/grid_map"], z)
    occupancy(decoded["/occupancy"], out)


def grid_map(message, z):
    info = message.info
    assert (info.resolution, info.length_x, info.length_y) == (RESOLUTION, NX * RESOLUTION, NY * RESOLUTION)
    centre = info.pose.position
    assert (centre.x, centre.y) == (CORNER[0] + NX * RESOLUTION / 2, CORNER[1] + NY * RESOLUTION / 2)
    assert message.basic_layers == ["elevation"]
    array = message.data[message.layers.index("elevation")]
    labels = [(d.label, d.size, d.stride) for d in array.layout.dim]
    assert labels == [("column_index", NY, NX * NY), ("row_index", NX, NX)], labels
    # index (0, 0) is the greatest x and y; rows run along -x, columns along -y
    by_row_and_column = np.asarray(array.data).reshape(NY, NX).T
    same("mcap GridMap (rosbags)", z, by_row_and_column[::-1, ::-1].T)


def occupancy(message, out):
    info = message.info
    assert (info.width, info.height) == (NX, NY)
    assert (info.origin.position.x, info.origin.position.y) == CORNER
    data = np.asarray(message.data).reshape(NY, NX).astype(float)
    data[data < 0] = np.nan
    cost = 100 * (1 - np.load(out / "traversability.npy"))
    same("mcap OccupancyGrid (rosbags)", cost, data, 0.51)


def main():
    rugosa = pathlib.Path(sys.argv[1]).resolve()
    missing = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        z = raster()
        write_asc(folder / "dem.asc", z)
        formats = "npy,asc,png,ply,geotiff,mcap,nav2"
        command = [rugosa, "map", folder / "dem.asc", "--out", folder / "map", "--export", formats, "--quiet", "--json"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        for check in (npy, png, nav2, geotiff, ply, mcap):
            try:
                check(folder / "map", z)
            except ModuleNotFoundError as error:
                missing.append(f"{check.__name__} ({error.name})")
    if missing:
        print("NOT CHECKED, reader not installed:", ", ".join(missing))
        sys.exit(3)


if __name__ == "__main__":
    main()
