#!/usr/bin/env python3
"""How far a maximum-likelihood estimate of the dimension gets, beside rugosa's.

    python3 bench/maximum_likelihood.py path/to/rugosa [--surfaces 4] [--snr 20]

5 % of the nodes of exact 512² surfaces (`rugosa synthesize --method exact`), with the noise
known: Vecchia's approximation of the restricted likelihood (Stein, Chi and Welty 2004). Points in random
order; each is predicted from its 16 nearest predecessors by ordinary kriging with the power
law's own variogram, and the prediction errors are independent normal numbers. H and σ maximise
their likelihood. Needs numpy and scipy. About half a minute per surface.
"""
import argparse, json, subprocess, tempfile
from pathlib import Path
import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree

SIDE, NEIGHBOURS = 512, 16


def predecessors(xy):
    """The nearest of the points before each one, within blocks that double in size."""
    near = np.zeros((len(xy), NEIGHBOURS), int)
    begin = 2 * NEIGHBOURS
    while begin < len(xy):
        end = min(2 * begin, len(xy))
        near[begin:end] = cKDTree(xy[:begin]).query(xy[begin:end], NEIGHBOURS)[1]
        begin = end
    return near


def likelihood(hurst, sigma, noise, xy, z, near):
    """−2 ln likelihood of the predictions, up to a constant."""
    n = NEIGHBOURS
    to = near[2 * n:]
    places, own = xy[to], xy[2 * n:]
    gamma = lambda d2: 0.5 * sigma**2 * d2**hurst
    matrix = np.zeros((len(to), n + 1, n + 1))
    matrix[:, :n, :n] = gamma(np.sum((places[:, :, None] - places[:, None]) ** 2, -1))
    matrix[:, range(n), range(n)] = -noise**2
    matrix[:, n, :n] = matrix[:, :n, n] = 1
    right = np.ones((len(to), n + 1))
    right[:, :n] = gamma(np.sum((places - own[:, None]) ** 2, -1))
    weights = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    variance = np.sum(weights * right, 1) + noise**2
    error = z[2 * n:] - np.sum(weights[:, :n] * z[to], 1)
    return np.sum(error**2 / variance + np.log(variance))


def estimate(points, noise):
    xy, z = points[:, :2], points[:, 2]
    near = predecessors(xy)
    cost = lambda p: likelihood(1 / (1 + np.exp(-p[0])), np.exp(p[1]), noise, xy, z, near)
    lag1 = np.std(z) / SIDE**0.5
    simplex = np.array([[0.0, np.log(lag1)]]) + [[0, 0], [0.8, 0], [0, 0.5]]
    best = minimize(cost, simplex[0], method="Nelder-Mead", options=dict(xatol=2e-3, fatol=0.02, initial_simplex=simplex))
    return 1 / (1 + np.exp(-best.x[0]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rugosa", help="the command, e.g. target/release/rugosa")
    parser.add_argument("--surfaces", type=int, default=4)
    parser.add_argument("--dimensions", type=float, nargs="+", default=[2.1, 2.3, 2.5, 2.7, 2.9])
    parser.add_argument("--snr", type=float, help="signal to noise [dB]; none without it")
    arguments = parser.parse_args()
    print("| D | likelihood: bias, deviation | rugosa: bias, deviation |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "surface.npy"
        for dimension in arguments.dimensions:
            errors = []
            for seed in range(arguments.surfaces):
                subprocess.run([arguments.rugosa, "synthesize", "--size", "513", "--dimension", str(dimension), "--seed",
                                str(seed), "--method", "exact", "--out", path, "--quiet"], check=True, capture_output=True)
                random = np.random.default_rng(seed)
                heights = np.load(path)[:SIDE, :SIDE]
                nodes = random.permutation(SIDE * SIDE)[: SIDE * SIDE // 20]
                z = heights.ravel()[nodes].astype(float)
                noise = 0.0 if arguments.snr is None else np.std(z) * 10 ** (-arguments.snr / 20)
                points = np.column_stack([nodes % SIDE, nodes // SIDE, z + noise * random.standard_normal(len(z))])
                np.save(path, points.astype(np.float32))
                report = subprocess.run([arguments.rugosa, "dimension", path, "--min-lag", "2", "--max-lag", "30", "--noise-std",
                                         str(noise), "--json", "--quiet"], check=True, capture_output=True)
                errors.append([3 - estimate(points, noise) - dimension, json.loads(report.stdout)["dimension"] - dimension])
            mean, deviation = np.mean(errors, 0), np.std(errors, 0, ddof=1)
            print(f"| {dimension} | {mean[0]:+.4f}, {deviation[0]:.4f} | {mean[1]:+.4f}, {deviation[1]:.4f} |", flush=True)


if __name__ == "__main__":
    main()
