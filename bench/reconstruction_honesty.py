#!/usr/bin/env python3
"""Is the reconstruction honest where nobody tells it the ground's parameters?

    python3 bench/reconstruction_honesty.py path/to/rugosa [DEM.npy:SPACING ...]

Hides 95 % of the nodes of 257 x 257 crops, lets rugosa estimate H, sigma and the noise from the
rest, and prints as Markdown (1) for every DEM how many of the hidden nodes lie within the mean
plus or minus 1.96 standard deviations (64 draws), and the squared error over the predicted
variance; (2) for exact fractional Brownian surfaces of D 2.1 ... 2.9 at 40 and 20 dB the
difference between D of a realisation and of the original. Needs numpy. Without files the DEM of
tests/data is taken.
"""
import json, subprocess, sys, tempfile
from pathlib import Path
import numpy as np

SIDE, SEEN = 257, 0.05


def dimension(z):
    lags = [1, 2, 4, 8, 16]
    square = [np.mean((z[l:] - z[:-l]) ** 2) + np.mean((z[:, l:] - z[:, :-l]) ** 2) for l in lags]
    return 3 - np.polyfit(np.log(lags), np.log(square), 1)[0] / 2


def reconstruct(command, z, folder, spacing, *options):
    np.save(f"{folder}/sparse.npy", z.astype(np.float32))
    run = subprocess.run([command, "reconstruct", f"{folder}/sparse.npy", "--spacing", spacing, "--out",
                          f"{folder}/out.npy", "--json", "--quiet", *options],
                         check=True, capture_output=True, text=True)
    return np.load(f"{folder}/out.npy").astype(float), json.loads(run.stdout)


def hidden(z, seed):
    seen = np.random.default_rng(seed).random(z.shape) < SEEN
    return seen, np.where(seen, z, np.nan)


def coverage(command, dems, folder, options=()):
    print("| DEM, crop | options | H | sigma [m] | noise [m] | error² / variance | inside 95 % |\n|---|---|---|---|---|---|---|")
    for name, spacing, dem in dems:
        rows, columns = dem.shape
        for r, c in [(0, 0), (rows - SIDE, columns - SIDE), ((rows - SIDE) // 2, (columns - SIDE) // 2)]:
            z = dem[r:r + SIDE, c:c + SIDE].astype(float)
            for extra in ([], ["--adaptive"], ["--prior", "measured"]):
                seen, sparse = hidden(z, 1)
                mean, told = reconstruct(command, sparse, folder, spacing, "--std", "64", *extra)
                std = np.load(f"{folder}/out_std.npy").astype(float)
                error, std = (mean - z)[~seen], std[~seen]
                print(f"| {name} [{r}, {c}] | {' '.join(extra) or 'none'} | {told['hurst']:.3f} | {told['sigma']:.4g} "
                      f"| {told.get('noise_std', float('nan')):.3g} | {np.mean(error ** 2) / np.mean(std ** 2):.3f} "
                      f"| {100 * np.mean(np.abs(error) < 1.96 * std):.1f} % |", flush=True)


def roughness(command, folder, surfaces):
    print("\n| D | 40 dB: mean of the difference of D, largest | 20 dB |\n|---|---|---|")
    for tenth in range(1, 10):
        d, cells = 2 + tenth / 10, []
        for decibel in (40, 20):
            off = []
            for seed in range(surfaces):
                subprocess.run([command, "synthesize", "--size", str(SIDE), "--hurst", str(3 - d), "--method", "exact",
                                "--seed", str(seed), "--quiet", "--out", f"{folder}/truth.npy"], check=True, capture_output=True)
                z = np.load(f"{folder}/truth.npy").astype(float)
                noise = np.std(z) * 10 ** (-decibel / 20)
                noisy = z + noise * np.random.default_rng(seed).normal(size=z.shape)
                drawn, _ = reconstruct(command, hidden(noisy, seed)[1], folder, "1", "--realisation", "1",
                                       "--noise-std", str(noise))
                off.append(abs(dimension(drawn) - dimension(z)))
            cells.append(f"{np.mean(off):.4f}, {np.max(off):.4f}")
        print(f"| {d:.1f} | {' | '.join(cells)} |", flush=True)


def main():
    command, files = sys.argv[1], sys.argv[2:]
    files = files or [str(Path(__file__).parent.parent / "tests/data/jacksboro.npy") + ":80"]
    dems = [(Path(f.rsplit(":", 1)[0]).stem, f.rsplit(":", 1)[1], np.load(f.rsplit(":", 1)[0])) for f in files]
    with tempfile.TemporaryDirectory() as folder:
        coverage(command, dems, folder)
        roughness(command, folder, 4)


if __name__ == "__main__":
    main()
