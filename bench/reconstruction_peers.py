#!/usr/bin/env python3
"""Sparse to dense: rugosa beside the tools others use, on one surface, in one run.

    python3 bench/reconstruction_peers.py path/to/rugosa [--size 257] [--seen 0.05] [--hurst 0.5]

Always runs SciPy (pip install numpy scipy). Runs GMT `surface` (apt install gmt), kriging with
16 neighbours (pip install pykrige) and sequential Gaussian simulation (apt install r-cran-gstat)
where they are installed, and says so where they are not. Prints a Markdown table: seconds, root
mean square error at the nodes that were not seen relative to the lag-1 deviation, D and the
lag-1 structure function relative to the truth.

Times: the least of five where one takes less than two seconds. rugosa's is the `solve` of its own report; SciPy and pykrige are timed around the call;
GMT and R include the start of their process.
"""
import argparse, json, shutil, subprocess, tempfile, time
from pathlib import Path
import numpy as np


def structure(z, lag):
    return 0.5 * (np.mean((z[lag:] - z[:-lag]) ** 2) + np.mean((z[:, lag:] - z[:, :-lag]) ** 2))


def dimension(z):
    lags = [1, 2, 4, 8, 16]
    return 3 - np.polyfit(np.log(lags), np.log([structure(z, l) for l in lags]), 1)[0] / 2


def rugosa(command, arguments, folder):
    out = Path(folder) / "out.npy"
    report = subprocess.run([command, "reconstruct", *arguments, "--out", str(out), "--json", "--quiet"],
                            check=True, capture_output=True, text=True)
    return np.load(out), json.loads(report.stdout)["seconds"]["solve"]


def scipy_linear(points, size):
    from scipy.interpolate import griddata
    y, x = np.mgrid[:size, :size]
    start = time.perf_counter()
    z = griddata(points[:, :2], points[:, 2], (x, y), method="linear")
    return z, time.perf_counter() - start


def gmt_surface(points, size, folder):
    xyz, grid = Path(folder) / "points.txt", Path(folder) / "gmt.nc"
    np.savetxt(xyz, points)
    start = time.perf_counter()
    subprocess.run(["gmt", "surface", xyz, f"-R0/{size - 1}/0/{size - 1}", "-I1", "-T0.25", f"-G{grid}"],
                   check=True, capture_output=True, cwd=folder)  # it leaves a gmt.history
    seconds = time.perf_counter() - start
    text = subprocess.run(["gmt", "grd2xyz", grid], check=True, capture_output=True, text=True, cwd=folder).stdout
    rows = np.array([line.split() for line in text.splitlines()], float)
    z = np.full((size, size), np.nan)
    z[rows[:, 1].round().astype(int), rows[:, 0].round().astype(int)] = rows[:, 2]
    return z, seconds


def kriging(points, size, hurst):
    from pykrige.ok import OrdinaryKriging
    axis = np.arange(size, dtype=float)
    start = time.perf_counter()
    model = OrdinaryKriging(*points.T, variogram_model="power",
                            variogram_parameters={"scale": 0.5, "exponent": 2 * hurst, "nugget": 0.0})
    z, _ = model.execute("grid", axis, axis, backend="C", n_closest_points=16)
    return np.asarray(z), time.perf_counter() - start


SIMULATION = """
library(gstat); library(sp)
p <- read.table("{points}"); names(p) <- c("x", "y", "z")
g <- expand.grid(x = 0:{last}, y = 0:{last})
g <- g[!(paste(g$x, g$y) %in% paste(p$x, p$y)), ]  # at the points themselves it returns NA
coordinates(p) <- ~x+y; coordinates(g) <- ~x+y
m <- vgm({sill}, "Exc", {range}, kappa = {power})
start <- proc.time()[["elapsed"]]
k <- krige(z ~ 1, p, g, m, nmax = 16, nsim = 1, debug.level = 0)
cat(proc.time()[["elapsed"]] - start, "\\n")
write.table(cbind(coordinates(k), k$sim1), "{out}", row.names = FALSE, col.names = FALSE)
"""


def simulation(points, size, hurst, folder):
    xyz, out = Path(folder) / "points.txt", Path(folder) / "sgs.txt"
    np.savetxt(xyz, points)
    reach = 10 * size  # simulation needs a sill: a power law up to far beyond the map
    script = SIMULATION.format(points=xyz, last=size - 1, power=2 * hurst, range=reach,
                               sill=0.5 * reach ** (2 * hurst), out=out)
    run = subprocess.run(["Rscript", "-e", script], check=True, capture_output=True, text=True)
    z = np.full((size, size), np.nan)
    for x, y, height in np.vstack([np.loadtxt(out), points]):
        z[int(y), int(x)] = height
    return z, float(run.stdout.split()[-1])


def attempts(args, points, folder):
    given = [folder + "/sparse.npy", "--spacing", "1", "--noise-std", "0",
             "--hurst", str(args.hurst), "--sigma", "1"]
    yield "rugosa mean", lambda: rugosa(args.rugosa, given, folder)
    yield "rugosa realisation", lambda: rugosa(args.rugosa, [*given, "--realisation", "1"], folder)
    yield "SciPy linear", lambda: scipy_linear(points, args.size)
    if shutil.which("gmt"):
        yield "GMT surface -T0.25", lambda: gmt_surface(points, args.size, folder)
    yield "pykrige, 16 neighbours", lambda: kriging(points, args.size, args.hurst)
    if shutil.which("Rscript"):
        yield "gstat sequential Gaussian simulation", lambda: simulation(points, args.size, args.hurst, folder)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("rugosa")
    parser.add_argument("--size", type=int, default=257)
    parser.add_argument("--seen", type=float, default=0.05)
    parser.add_argument("--hurst", type=float, default=0.5)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([args.rugosa, "synthesize", "--size", str(args.size), "--hurst", str(args.hurst),
                        "--method", "exact", "--quiet", "--out", folder + "/truth.npy"],
                       check=True, capture_output=True)
        truth = np.load(folder + "/truth.npy").astype(float)
        seen = np.random.default_rng(1).random(truth.shape) < args.seen
        np.save(folder + "/sparse.npy", np.where(seen, truth, np.nan).astype(np.float32))
        y, x = np.nonzero(seen)
        points = np.c_[x, y, truth[seen]].astype(float)
        print(f"truth: D {dimension(truth):.3f}, {seen.sum()} of {truth.size} nodes seen\n")
        print("| method | seconds | RMSE / lag-1 deviation | D | lag-1 structure function / truth |")
        print("|---|---|---|---|---|")
        for name, attempt in attempts(args, points, folder):
            try:
                z, seconds = attempt()
                if seconds < 2:
                    seconds = min(seconds, *(attempt()[1] for _ in range(4)))
            except (ImportError, OSError, subprocess.CalledProcessError) as reason:
                print(f"| {name} | not run: {reason} | | | |")
                continue
            hidden = ~seen & np.isfinite(z)
            error = np.sqrt(np.mean((z - truth)[hidden] ** 2) / structure(truth, 1))
            filled = np.where(np.isfinite(z), z, truth)
            print(f"| {name} | {seconds:.3f} | {error:.3f} | {dimension(filled):.3f} "
                  f"| {structure(filled, 1) / structure(truth, 1):.2f} |", flush=True)
        for tool in ("gmt", "Rscript"):
            if not shutil.which(tool):
                print(f"\n{tool} is not installed: not compared.")


if __name__ == "__main__":
    main()
