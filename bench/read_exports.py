#!/usr/bin/env python3
"""Reads every export of `rugosa map` back with other people's readers, and has their
writers make files that `rugosa` imports.

usage: read_exports.py path/to/rugosa

Two maps without any symmetry: a raster with a hole, far from the origin, and the map of a
simulated robot that has moved. Each export is opened with an independent reader (numpy,
Pillow, PyYAML, mcap + rosbags, rasterio, plyfile) and compared cell by cell, so that a
swapped or mirrored axis cannot pass. Then laspy, rasterio and rosbags write points, a raster
and a bag, which `rugosa info` has to describe. A reader that is not installed is said in the last
line, and the exit code is then 3.
"""
import importlib
import json
import pathlib
import subprocess
import sys
import tempfile
from dataclasses import dataclass

import numpy as np

FORMATS = "npy,npz,asc,png,ply,geotiff,mcap,nav2,nav2-trinary,rugosa"


@dataclass
class Map:
    """A map and what its layer `elevation` has to be."""

    out: pathlib.Path
    z: np.ndarray
    resolution: float
    corner: tuple

    @property
    def size(self):
        return self.z.shape[1], self.z.shape[0]

    def load(self, layer):
        return np.load(self.out / f"{layer}.npy")


def raster():
    column, row = np.meshgrid(np.arange(40), np.arange(30))
    z = 0.02 * column + 0.002 * row**2
    z[:3, 37:] = np.nan
    return z


def write_asc(path, z, resolution, corner):
    rows = [" ".join("-9999" if np.isnan(v) else repr(float(v)) for v in line) for line in z[::-1]]
    size = f"ncols {z.shape[1]}\nnrows {z.shape[0]}\n"
    place = f"xllcorner {corner[0]}\nyllcorner {corner[1]}\ncellsize {resolution}\nNODATA_value -9999\n"
    path.write_text(size + place + "\n".join(rows) + "\n")


def same(name, ours, theirs, tolerance=0.01):
    assert ours.shape == theirs.shape, (name, ours.shape, theirs.shape)
    assert (np.isnan(ours) == np.isnan(theirs)).all(), f"{name}: other cells are unknown"
    error = np.nanmax(np.abs(ours - theirs))
    assert error <= tolerance, f"{name}: off by {error}"
    print(f"  {name:<32} agrees within {error:.2g}")


def npy(m):
    same("npy (numpy)", m.z, m.load("elevation"))


def npz(m):
    archive = np.load(m.out / "map.npz")
    assert archive["resolution"] == m.resolution and tuple(archive["corner"]) == m.corner
    same("npz (numpy)", m.z, archive["elevation"])


def rugosa(m):
    archive = np.load(m.out / "map.rugosa")
    head = json.loads(bytes(archive["rugosa.json"]))
    corner = [c * m.resolution + s for c, s in zip(head["cell"], head["shift"])]
    assert np.allclose(corner, m.corner, rtol=0, atol=1e-6), (corner, m.corner)
    z = archive["elevation"] + head["rise"] * head["height_step"]
    same("rugosa (numpy)", m.z, np.where(archive["state"] == 1, z, np.nan))


def png(m):
    image = importlib.import_module("PIL.Image").open(m.out / "elevation.png")
    image.load()
    assert image.width > 400 and image.mode == "RGB"
    print("  png (Pillow)                     opens,", image.size)


def nav2_image(m, name, mode):
    meta = importlib.import_module("yaml").safe_load((m.out / f"{name}.yaml").read_text())
    assert meta["mode"] == mode and np.isclose(meta["resolution"], m.resolution) and meta["negate"] == 0
    assert np.allclose(meta["origin"], [*m.corner, 0.0], rtol=0, atol=1e-6)
    return np.asarray(importlib.import_module("PIL.Image").open(m.out / meta["image"]))[::-1]


def nav2(m):
    cost = 100 * (1 - m.load("traversability"))
    theirs = nav2_image(m, "map", "raw").astype(float)
    theirs[theirs > 100] = np.nan
    same("nav2 raw (PyYAML, Pillow)", cost, theirs, 0.51)
    pixels = nav2_image(m, "map_trinary", "trinary")
    assert set(np.unique(pixels)) <= {0, 205, 254}
    theirs = np.select([pixels == 0, pixels == 254], [1.0, 0.0], np.nan)
    same("nav2 trinary (PyYAML, Pillow)", np.where(np.isnan(cost), np.nan, cost >= 100), theirs)


def geotiff(m):
    with importlib.import_module("rasterio").open(m.out / "elevation.tif") as data:
        same("geotiff (rasterio)", m.z, data.read(1)[::-1])
        top = m.corner[1] + m.z.shape[0] * m.resolution
        assert np.allclose(data.transform * (0, 0), (m.corner[0], top), rtol=0, atol=1e-6)
        assert np.isnan(data.nodata)


def ply(m):
    data = importlib.import_module("plyfile").PlyData.read(m.out / "surface.ply")
    v = data["vertex"]
    name = "mean" if (m.out / "mean.npy").exists() else "elevation"
    same("ply (plyfile)", m.load(name), by_cell(m, v["x"], v["y"], v["z"]))
    assert max(max(f) for f in data["face"]["vertex_indices"]) < len(v)


def by_cell(m, x, y, z):
    column = np.floor((x - m.corner[0]) / m.resolution + 1e-3).astype(int)
    row = np.floor((y - m.corner[1]) / m.resolution + 1e-3).astype(int)
    out = np.full_like(m.z, np.nan, dtype=float)
    out[row, column] = z
    return out


def mcap(m):
    reader = importlib.import_module("mcap.reader")
    typesys = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    with open(m.out / "map.mcap", "rb") as file:
        messages = list(reader.make_reader(file).iter_messages())
    for schema, _, _ in messages:
        store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
    decoded = {c.topic: store.deserialize_cdr(p.data, s.name) for s, c, p in messages}
    grid_map(decoded["/grid_map"], m)
    occupancy(decoded["/occupancy"], m)
    points(decoded["/points"], m)
    foxglove(decoded["/grid"], m)


def grid_map(message, m):
    info = message.info
    nx, ny = m.size
    assert np.allclose((info.resolution, info.length_x, info.length_y), (m.resolution, nx * m.resolution, ny * m.resolution))
    centre = (info.pose.position.x, info.pose.position.y)
    assert np.allclose(centre, (m.corner[0] + nx * m.resolution / 2, m.corner[1] + ny * m.resolution / 2), rtol=0, atol=1e-6)
    assert message.basic_layers == ["elevation"]
    array = message.data[message.layers.index("elevation")]
    labels = [(d.label, d.size, d.stride) for d in array.layout.dim]
    assert labels == [("column_index", ny, nx * ny), ("row_index", nx, nx)], labels
    # index (0, 0) is the greatest x and y; rows run along -x, columns along -y
    by_row_and_column = np.asarray(array.data).reshape(ny, nx).T
    same("mcap GridMap (rosbags)", m.z, by_row_and_column[::-1, ::-1].T)


def occupancy(message, m):
    info = message.info
    assert (info.width, info.height) == m.size
    assert np.allclose((info.origin.position.x, info.origin.position.y), m.corner, rtol=0, atol=1e-6)
    data = np.asarray(message.data).reshape(m.z.shape).astype(float)
    data[data < 0] = np.nan
    same("mcap OccupancyGrid (rosbags)", 100 * (1 - m.load("traversability")), data, 0.51)


def points(message, m):
    kinds = {7: "<f4", 8: "<f8"}
    fields = message.fields
    kind = np.dtype({"names": [f.name for f in fields], "formats": [kinds[f.datatype] for f in fields],
                     "offsets": [f.offset for f in fields], "itemsize": message.point_step})
    v = np.frombuffer(message.data.tobytes(), kind)
    assert len(v) == message.width * message.height == np.isfinite(m.z).sum()
    same("mcap PointCloud2 (rosbags)", m.z, by_cell(m, v["x"], v["y"], v["z"]))


def foxglove(message, m):
    nx, _ = m.size
    assert (message.column_count, message.cell_size.x) == (nx, m.resolution)
    assert message.row_stride == nx * message.cell_stride
    corner = message.pose.position
    assert np.allclose((corner.x, corner.y), m.corner, rtol=0, atol=1e-6)
    cells = message.data.reshape(*m.z.shape, message.cell_stride)
    offset = {f.name: f.offset for f in message.fields}
    z = cells[:, :, offset["elevation"]:][:, :, :4].copy().view("<f4")[:, :, 0]
    same("mcap foxglove Grid (rosbags)", m.z, z.astype(float))
    assert ((cells[:, :, offset["alpha"]] == 255) == np.isfinite(m.z)).all()


def las(folder, info):
    laspy = importlib.import_module("laspy")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = [0.001] * 3
    for name in ("points.las", "points.laz"):
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = [1.0, 2.0, 4.0], [10.0, 20.0, 50.0], [0.5, -0.25, 2.0]
        cloud.write(str(folder / name))
        found = info(folder / name)
        assert found["points"] == 3 and np.allclose(found["min_m"], [1, 10, -0.25]) and np.allclose(found["max_m"], [4, 50, 2])
        print(f"  {name + ' (laspy)':<32} is read")


def bag(folder, info):
    """A scanner 0.5 m above a robot that drives 1 m/s to the north; one cloud every second."""
    writer = importlib.import_module("rosbags.rosbag2").Writer
    plugin = importlib.import_module("rosbags.rosbag2").StoragePlugin.MCAP
    typesys = importlib.import_module("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = lambda name: store.types[name]
    header = lambda t, frame: kind("std_msgs/msg/Header")(kind("builtin_interfaces/msg/Time")(t, 0), frame)

    def transform(t, parent, child, x, y, z):
        pose = kind("geometry_msgs/msg/Transform")(kind("geometry_msgs/msg/Vector3")(x, y, z), kind("geometry_msgs/msg/Quaternion")(0.0, 0.0, 0.0, 1.0))
        return kind("tf2_msgs/msg/TFMessage")([kind("geometry_msgs/msg/TransformStamped")(header(t, parent), child, pose)])

    def cloud(t):
        xyz = np.array([[1.0, 0.0, -0.5], [2.0, 0.0, -0.25]], "<f4")
        fields = [kind("sensor_msgs/msg/PointField")(n, 4 * i, 7, 1) for i, n in enumerate("xyz")]
        data = np.frombuffer(xyz.tobytes(), np.uint8)
        return kind("sensor_msgs/msg/PointCloud2")(header(t, "lidar"), 1, 2, fields, False, 12, 24, data, True)

    with writer(folder / "bag", version=9, storage_plugin=plugin) as out:
        topics = {"/tf_static": "tf2_msgs/msg/TFMessage", "/tf": "tf2_msgs/msg/TFMessage", "/points": "sensor_msgs/msg/PointCloud2"}
        at = {topic: out.add_connection(topic, name, typestore=store) for topic, name in topics.items()}
        put = lambda topic, t, message: out.write(at[topic], t * 10**9, store.serialize_cdr(message, topics[topic]))
        put("/tf_static", 0, transform(0, "base", "lidar", 0.0, 0.0, 0.5))
        for t in range(4):
            put("/tf", t, transform(t, "odom", "base", 0.0, float(t), 0.0))
            put("/points", t, cloud(t))
    found = info(next((folder / "bag").glob("*.mcap")))
    assert found["points"] == 8 and np.allclose(found["min_m"], [1, 0, 0]) and np.allclose(found["max_m"], [2, 3, 0.25]), found
    print("  bag (rosbags)                    is read")


def tif(folder, info):
    rasterio = importlib.import_module("rasterio")
    z = raster().astype("float32")
    place = rasterio.transform.from_origin(500.0, 915.0, 0.5, 0.5)
    options = dict(driver="GTiff", width=40, height=30, count=1, dtype="float32", transform=place, crs="EPSG:32633", nodata=-1)
    for name, extra in (("strips.tif", {"compress": "lzw"}), ("tiles.tif", {"tiled": True, "blockxsize": 16, "blockysize": 16, "compress": "deflate"})):
        with rasterio.open(folder / name, "w", **options, **extra) as data:
            data.write(np.where(np.isnan(z), -1, z)[::-1], 1)
        found = info(folder / name)
        assert (found["rows"], found["columns"], found["known"]) == (30, 40, 1191), found
        assert np.allclose(found["origin_m"], [500.25, 900.25]), found
        print(f"  {name + ' (rasterio)':<32} is read")


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    missing = []

    def run(*arguments):
        command = [program, *map(str, arguments), "--quiet", "--json"]
        return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)

    def attempt(check, *arguments):
        try:
            check(*arguments)
        except ModuleNotFoundError as error:
            missing.append(f"{check.__name__} ({error.name})")

    def check_all(m):
        for check in (npy, npz, rugosa, png, nav2, geotiff, ply, mcap):
            attempt(check, m)

    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        print("a raster far from the origin")
        z = raster()
        write_asc(folder / "dem.asc", z, 0.5, (1000.0, 2000.0))
        run("map", folder / "dem.asc", "--out", folder / "map", "--export", FORMATS)
        check_all(Map(folder / "map", z, 0.5, (1000.0, 2000.0)))
        print("a map that has moved with its robot")
        summary = run("demo", "--sweeps", 12, "--out", folder / "demo")
        assert summary["counters"]["map.moves"] > 0, "the map has not moved"
        run("map", folder / "demo/map.rugosa", "--out", folder / "moved", "--export", FORMATS)
        head = json.loads(bytes(np.load(folder / "demo/map.rugosa")["rugosa.json"]))
        resolution = round(head["resolution"], 6)
        corner = tuple(c * resolution for c in head["cell"])
        check_all(Map(folder / "moved", np.load(folder / "demo/elevation.npy"), resolution, corner))
        print("files of others")
        attempt(las, folder, lambda path: run("info", path))
        attempt(tif, folder, lambda path: run("info", path))
        attempt(bag, folder, lambda path: run("info", path))
    if missing:
        print("NOT CHECKED, reader not installed:", ", ".join(sorted(set(missing))))
        sys.exit(3)


if __name__ == "__main__":
    main()
