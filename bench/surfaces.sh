#!/bin/sh
# Prints every figure of docs/surfaces.md and docs/results-surfaces.md, and draws their pictures:
#     sh bench/surfaces.sh [folder for the pictures]
# Takes about ten minutes; the last part wants numpy, pillow, zstandard and pylerc for Python.
set -e
cd "$(dirname "$0")/.."
fractal="cargo run --quiet --release -p rugosa-fractal"
tests="cargo test --quiet -p rugosa-fractal --all-features"

echo "== Scaling range: Monte Carlo"
$fractal --features std --example scaling_range
echo "== Midpoint, rectangular, projected IFS, codec: figures of the tests"
for test in surfaces_midpoint surfaces_rectangular surfaces_ifs codec; do
    $tests --test $test -- --nocapture --test-threads 1
done
echo "== Times, as ratios"
$fractal --features alloc --example surface_times
echo "== Codec beside LERC, JPEG 2000 and zstd"
cargo build --quiet --release -p rugosa-host
cargo run --quiet --release -p rugosa-host -- synthesize --size 257 --dimension 2.3 --method exact --out target/fbm-2.3.npy
cargo run --quiet --release -p rugosa-host -- synthesize --size 257 --dimension 2.5 --method exact --out target/fbm-2.5.npy
python3 bench/codec_peers.py target/release target/fbm-2.3.npy target/fbm-2.5.npy
echo "== Pictures"
cargo run --quiet --release -p rugosa-host --example surface_pictures -- "${1:-docs/img}"
