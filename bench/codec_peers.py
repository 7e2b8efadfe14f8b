#!/usr/bin/env python3
"""The codec beside LERC, JPEG 2000 and zstd on 257 x 257 heights, in one run.

    cargo build --release -p rugosa-fractal --features alloc --example surface_times
    cargo build --release -p rugosa-host
    python3 bench/codec_peers.py target/release [more 257 x 257 float32 .npy files]

Needs numpy, pillow (with OpenJPEG) and zstandard, and pylerc for the times; says what it lacks.
Times are the least of several rounds that alternate between the two codecs: on a busy machine
the ratio is what carries over. JPEG 2000: 16 bits, irreversible 9/7, bare codestream, the best of
three numbers of resolutions and fifty rates at no more than the size.
"""
import ctypes, io, json, re, subprocess, sys, tempfile, time
from pathlib import Path
import numpy as np

SIDE = 257
SIZES = {"33 x 33 samples": 2186, "17 x 17 samples": 586}


def psnr(a, b):
    return 20 * np.log10((b.max() - b.min()) / np.sqrt(((a - b) ** 2).mean()))


def rugosa(command, path, *options):
    with tempfile.TemporaryDirectory() as folder:
        report = subprocess.run([command, "compress", path, *options, "--out", f"{folder}/z.rz", "--json", "--quiet"],
                                check=True, capture_output=True, text=True)
    return json.loads(report.stdout)


def jpeg_2000(z, target):
    from PIL import Image
    relief, best = z.max() - z.min(), None
    image = Image.fromarray(np.round((z - z.min()) / relief * 65535).astype(np.uint16))
    for resolutions in (6, 7, 8):
        for rate in np.arange(0.80, 1.30, 0.01) * (2 * z.size / target):
            stream = io.BytesIO()
            image.save(stream, "JPEG2000", quality_mode="rates", quality_layers=[rate], irreversible=True,
                       num_resolutions=resolutions, no_jp2=True)
            if len(stream.getvalue()) > target:
                continue
            back = np.asarray(Image.open(stream)).astype(float) / 65535 * relief + z.min()
            found = (psnr(back, z), np.abs(back - z).max())
            best = max(best or found, found)
    return best


def zstd_of_differences(z):
    import zstandard
    q = np.round((z - z.min()).astype(float) / 0.001).astype(np.int64)
    q //= max(np.gcd.reduce(q, axis=None), 1)
    q[1:] -= q[:-1].copy()
    q[:, 1:] -= q[:, :-1].copy()
    folded = (q << 1 ^ q >> 63).astype("<u4")  # signs in the lowest bit
    width = "<i2" if np.abs(q).max() < 1 << 15 else "<i4"
    candidates = [q.astype(width).tobytes(), folded.view(np.uint8).reshape(-1, 4).T.tobytes()]
    return min(len(zstandard.ZstdCompressor(level=19).compress(c)) for c in candidates)


def lerc_times(z, error):
    """(bytes, ns per cell to encode, to decode)"""
    from lerc import _lerc
    lib = ctypes.CDLL(str(next(Path(_lerc.__file__).parent.glob("libLerc.so*"))))
    pointer, unsigned, integer = ctypes.c_void_p, ctypes.c_uint, ctypes.c_int
    lib.lerc_encode.argtypes = [pointer, unsigned] + [integer] * 5 + [pointer, ctypes.c_double, pointer, unsigned, pointer]
    lib.lerc_decode.argtypes = [pointer, unsigned, integer, pointer] + [integer] * 4 + [unsigned, pointer]
    stream, written, back = ctypes.create_string_buffer(8 * z.size), unsigned(0), np.zeros_like(z)
    float32 = 6
    encode = lambda: lib.lerc_encode(z.ctypes.data, float32, 1, *z.shape, 1, 0, None, error, stream, 8 * z.size,
                                     ctypes.byref(written))
    decode = lambda: lib.lerc_decode(stream, written.value, 0, None, 1, *z.shape, 1, float32, back.ctypes.data)

    def least(work, runs=100):
        seconds = []
        for _ in range(runs):
            start = time.perf_counter()
            assert work() == 0
            seconds.append(time.perf_counter() - start)
        return min(seconds) / z.size * 1e9
    times = least(encode), least(decode)
    assert np.abs(back - z).max() <= error * 1.0001
    return written.value, *times


def own_times(program):
    """{what: (bytes, ns per cell to encode, to decode)}"""
    text = subprocess.run([program, "codec"], check=True, capture_output=True, text=True).stdout
    pattern = r"257², (\w+\([\d.]+\)): (\d+) bytes, .* encode ([\d.]+) .* decode ([\d.]+)"
    return {m[1]: (int(m[2]), float(m[3]), float(m[4])) for m in re.finditer(pattern, text)}


def least_of(rounds):
    return rounds[0][0], *(min(r[i] for r in rounds) for i in (1, 2))


def print_times(folder, z):
    errors = [50.0, 5.0, 0.5]
    rounds = [(own_times(folder / "examples/surface_times"), [lerc_times(z, e) for e in errors]) for _ in range(5)]
    print("\n| codec | bytes | encode, ns per cell | decode | times LERC's |\n|---|---|---|---|---|")
    lerc = [least_of([r[1][i] for r in rounds]) for i in range(len(errors))]
    for error, (size, encode, decode) in zip(errors, lerc):
        print(f"| LERC within {error} m | {size} | {encode:.1f} | {decode:.1f} | |")
    encode_lerc, decode_lerc = (min(l[i] for l in lerc) for i in (1, 2))
    for what in rounds[0][0]:
        size, encode, decode = least_of([r[0][what] for r in rounds])
        print(f"| rugosa {what} | {size} | {encode:.1f} | {decode:.1f} | "
              f"{encode / encode_lerc:.2f}, {decode / decode_lerc:.2f} |")


def attempt(work, *arguments):
    try:
        return work(*arguments)
    except ImportError as missing:
        print(f"left out: {missing}", file=sys.stderr)


def print_sizes(command, name, path, z):
    for what, size in SIZES.items():
        told, jpeg = rugosa(command, path, "--bytes", str(size)), attempt(jpeg_2000, z.astype(float), size)
        other = f"{jpeg[0]:.2f} dB, largest error {jpeg[1]:.1f} m" if jpeg else "not installed"
        print(f"| {name} | {size} ({what}) | {told['psnr']:.2f} dB, {told['max_error']:.1f} m | {other} |")
    exact = rugosa(command, path, "--max-error", "0.0005")["bytes"]
    print(f"| {name} | exact to 1 mm | {exact} bytes | zstd -19 of 2-D differences: {attempt(zstd_of_differences, z)} bytes |")


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "target/release")
    dem = np.load(Path(__file__).parent.parent / "tests/data/jacksboro.npy").astype(np.float32)
    surfaces = {"Jacksboro A": dem[:SIDE, :SIDE], "Jacksboro B": dem[87:344, 146:403]}
    surfaces |= {Path(p).stem: np.load(p).astype(np.float32) for p in sys.argv[2:]}
    print("| surface | size | rugosa | peer |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for name, z in surfaces.items():
            np.save(f"{scratch}/z.npy", z)
            print_sizes(folder / "rugosa", name, f"{scratch}/z.npy", z)
    attempt(print_times, folder, np.ascontiguousarray(surfaces["Jacksboro A"]))


if __name__ == "__main__":
    main()
