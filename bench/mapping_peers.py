#!/usr/bin/env python3
"""rugosa's mapper beside FastDEM's, the same points, in one run.

    python3 bench/mapping_peers.py path/to/fastdem [--rounds 3]

`fastdem` is bench/fastdem.cpp, built against a checkout of FastDEM as its first lines say. The
points are those of `cargo bench -p rugosa --bench mapping`, which writes them for it. Both
programs take turns, one thread each; printed are the medians of the rounds [ms] and the ratios.
"""
import argparse, json, statistics, subprocess, tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROWS = {"first sweep": "first", "second to fifth": "second", "sixth to thirtieth": "sixth", "the same points": "same"}


def bench(*arguments):
    command = ["cargo", "bench", "--quiet", "-p", "rugosa", "--bench", "mapping", "--", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def rugosa():
    """Times by scene and row: mapping, counters, roughness, costs."""
    scenes = []
    for line in bench().splitlines():
        if "cells measured" in line:
            scenes.append({})
        for name, key in ROWS.items():
            if line.strip().startswith(name):
                scenes[-1][key] = [float(word) for word in line.split()[-6:-2]]
    return scenes


def fastdem(program, folder):
    scenes = sorted({path.name.rsplit("_", 1)[0] for path in folder.iterdir()}, key=lambda name: int(name))
    run = lambda scene: subprocess.run([program, *sorted(folder.glob(f"{scene}_*"))], check=True, capture_output=True, text=True)
    return [json.loads(run(scene).stdout) for scene in scenes]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fastdem", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench("write", folder)
        rounds = [(rugosa(), fastdem(arguments.fastdem.resolve(), Path(folder))) for _ in range(arguments.rounds)]
    middle = lambda values: statistics.median(list(values))
    for scene, peer in enumerate(rounds[0][1]):
        theirs = lambda key: middle(them[scene][key] for _, them in rounds)
        ours = lambda key, parts: middle(sum(us[scene][key][i] for i in parts) for us, _ in rounds)
        print(f"{peer['points']} points, {peer['cells']} cells measured by FastDEM [ms]")
        print(f"  {'':<20} {'FastDEM':>8} {'mapping':>8} {'ratio':>6} {'+ counters':>11} {'ratio':>6}")
        for name, key in ROWS.items():
            a, b = ours(key, [0]), ours(key, [0, 1])
            print(f"  {name:<20} {theirs(key):8.2f} {a:8.2f} {a / theirs(key):6.2f} {b:11.2f} {b / theirs(key):6.2f}")
        for name, key, row in [("features, first", "features_first", "first"), ("features, thirtieth", "features_further", "sixth")]:
            a = ours(row, [2, 3])
            print(f"  {name:<20} {theirs(key):8.2f} {a:8.2f} {a / theirs(key):6.2f}")


if __name__ == "__main__":
    main()
