#!/usr/bin/env python3
"""Roughness of irregular points: rugosa beside other tools, same points, same bins, one run.

    python3 bench/roughness_peers.py path/to/rugosa

Points: uniform in 512 × 512, a smooth surface with noise, lags 2–30 in 29 annuli. Peers: a cell
list in C (bench/pairs_cell_list.c, compiled with `cc -O3 -march=native`), and scikit-gstat's
sparse path (pip install numpy scipy scikit-gstat) where it is installed. Prints a Markdown table of the least of
several runs, the peer's time over rugosa's, and the largest difference of the bins.

rugosa's time is `seconds.estimate` of its own report: pairs, noise, scaling range, power law and
its error, reading the file aside. The peers' times are those of the pairs alone (scikit-gstat:
coordinates, distances and experimental variogram, no model).
"""
import argparse, ctypes, json, subprocess, tempfile, time
from pathlib import Path
import numpy as np

LOW, WIDTH, BINS = 1.5, 1.0, 29


def surface(count):
    random = np.random.default_rng(count)
    xy = random.uniform(0, 512, (count, 2))
    z = np.sin(xy[:, 0] / 40) * np.cos(xy[:, 1] / 25) + 0.05 * random.standard_normal(count)
    return np.column_stack([xy, z])


def rugosa(command, points, folder, runs):
    path = Path(folder) / "points.npy"
    np.save(path, points.astype(np.float32))
    call = [command, "dimension", path, "--min-lag", "2", "--max-lag", "30", "--json", "--quiet"]
    reports = [json.loads(subprocess.run(call, check=True, capture_output=True).stdout) for _ in range(runs)]
    pairs = np.array([b["pairs"] for b in reports[0]["bins"]], float)
    return min(r["seconds"]["estimate"] for r in reports), pairs


def cell_list(points, folder, runs):
    source, library = Path(__file__).with_name("pairs_cell_list.c"), Path(folder) / "pairs.so"
    subprocess.run(["cc", "-O3", "-march=native", "-shared", "-fPIC", source, "-o", library, "-lm"], check=True)
    call = ctypes.CDLL(str(library)).structure_function
    array = np.ctypeslib.ndpointer(np.float64, flags="C")
    call.argtypes = [array, ctypes.c_long, ctypes.c_double, ctypes.c_double, ctypes.c_long, array]
    call.restype = None
    points = np.ascontiguousarray(points.astype(np.float32).astype(np.float64))
    best = np.inf
    for _ in range(runs):
        sums = np.zeros((BINS, 4))
        start = time.perf_counter()
        call(points, len(points), LOW, WIDTH, BINS, sums)
        best = min(best, time.perf_counter() - start)
    return best, sums[:, 0]


def scikit_gstat(points):
    import skgstat
    points = points.astype(np.float32).astype(np.float64)
    edges = LOW + WIDTH * np.arange(1, BINS + 1)
    start = time.perf_counter()
    space = skgstat.MetricSpace(points[:, :2], max_dist=edges[-1])
    variogram = skgstat.Variogram(space, points[:, 2], bin_func=[LOW, *edges], maxlag=edges[-1], fit_method=None)
    variogram.experimental
    seconds = time.perf_counter() - start
    return seconds, np.asarray(variogram.bin_count, float)[-BINS:]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rugosa", help="the command, e.g. target/release/rugosa")
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    print("| points | tool | ms | its time / rugosa's | largest difference of pairs in a bin |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for count in (10_000, 19_600):
            points = surface(count)
            ours, pairs = rugosa(arguments.rugosa, points, folder, arguments.runs)
            print(f"| {count} | rugosa dimension | {1e3 * ours:.2f} | 1 | |")
            peers = [("C cell list", lambda: cell_list(points, folder, arguments.runs))]
            peers.append(("scikit-gstat, sparse", lambda: scikit_gstat(points)))
            for name, peer in peers:
                try:
                    seconds, counts = peer()
                except ImportError as missing:
                    print(f"| {count} | {name} | not installed ({missing}) | | |")
                    continue
                off = np.max(np.abs(counts - pairs) / pairs)
                print(f"| {count} | {name} | {1e3 * seconds:.2f} | {seconds / ours:.2f} | {off:.1e} |", flush=True)


if __name__ == "__main__":
    main()
