//! densify, fis, ifs, compress and decompress from the outside: results, JSON, exit codes.

use rugosa_host::io::npy;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

struct Folder(tempfile::TempDir);

impl Folder {
    /// A folder with `a.npy`, side² heights of the Jacksboro DEM.
    fn new(side: usize) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/jacksboro.npy");
        let dem = npy::read_array(&dem).unwrap();
        let at = |i: usize| dem.values[(i / side + 20) * 403 + i % side + 20] as f32;
        let values: Vec<f32> = (0..side * side).map(at).collect();
        npy::write(&folder.path("a.npy"), side, side, &values).unwrap();
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_rugosa"))
            .current_dir(self.0.path())
            .args(arguments.split(' '))
            .output()
            .unwrap()
    }

    /// Runs with `--json`; the object.
    fn json(&self, arguments: &str) -> Value {
        let output = self.run(&format!("{arguments} --json"));
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments}: {errors}");
        serde_json::from_slice(&output.stdout).expect("one JSON object")
    }

    /// Runs; must end with exit code 2 and one line.
    fn refused(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {errors}");
        errors
    }

    fn values(&self, name: &str) -> Vec<f64> {
        npy::read_array(&self.path(name)).unwrap().values
    }
}

#[test]
fn compress_and_decompress_keep_their_bounds() {
    let folder = Folder::new(129);
    let told = folder.json("compress a.npy --max-error 2 --out a.rz");
    assert!(told["max_error"].as_f64().unwrap() <= 2.0 && told["psnr"].as_f64().unwrap() > 50.0);
    assert_eq!(told["bytes"], folder.path("a.rz").metadata().unwrap().len());
    let back = folder.json("decompress a.rz --out b.npy");
    assert_eq!(back["step"], 1);
    let pairs = folder
        .values("a.npy")
        .into_iter()
        .zip(folder.values("b.npy"));
    assert!(pairs.fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) <= 2.0);
    let quick = folder.json("compress a.npy --max-error 2 --quick --out q.rz");
    assert!(quick["max_error"].as_f64().unwrap() <= 2.0);
    assert!(quick["bytes"].as_u64() > told["bytes"].as_u64());
    folder.json("decompress q.rz --out q.npy");
    let small = folder.json("compress a.npy --bytes 700 --out s.rz");
    assert!(small["bytes"].as_u64().unwrap() <= 700);
    let bytes = std::fs::read(folder.path("a.rz")).unwrap();
    std::fs::write(folder.path("half.rz"), &bytes[..bytes.len() / 2]).unwrap();
    let half = folder.json("decompress half.rz --out half.npy");
    assert!(half["step"].as_u64().unwrap() > 1);
    let mut damaged = bytes;
    damaged[300] ^= 4;
    std::fs::write(folder.path("bad.rz"), damaged).unwrap();
    assert!(
        folder
            .refused("decompress bad.rz --out bad.npy")
            .contains("checksum")
    );
    assert!(!folder.path("bad.npy").exists());
    folder.refused("compress a.npy --out x.rz");
    folder.refused("compress a.npy --bytes 10 --out x.rz");
    folder.refused("compress a.npy --bytes 900 --quick --out x.rz");
    folder.refused("compress a.npy --max-error 1 --model ifs --out x.ifs");
    let fis = folder.json("compress a.npy --bytes 1200 --model fis --out a.fis");
    assert!(fis["psnr"].as_f64().unwrap() < small["psnr"].as_f64().unwrap());
    folder.json("decompress a.fis --out f.npy");
    assert_eq!(folder.values("f.npy").len(), 129 * 129);
}

#[test]
fn projected_ifs_are_fitted_and_tabulated() {
    let folder = Folder::new(82);
    let told = folder.json("ifs fit a.npy --iterations 7 --out a.ifs");
    let psnr = told["psnr"].as_array().unwrap();
    assert_eq!((psnr.len(), told["bytes"].as_u64()), (8, Some(948)));
    assert!(psnr[7].as_f64().unwrap() > 23.7);
    assert!(["proved", "not disproved"].contains(&told["contractivity"].as_str().unwrap()));
    let table = folder.json("ifs tabulate a.ifs --depth 5 --out t.npy");
    assert_eq!(table["rows"], 244);
    let (fine, coarse) = (
        folder.values("t.npy"),
        folder.json("ifs tabulate a.ifs --out u.npy"),
    );
    assert_eq!(coarse["rows"], 82);
    assert_eq!(fine[3 * 244 + 3], folder.values("u.npy")[83]);
    assert!(
        folder
            .refused("fis a.npy --step 8 --out x.npy")
            .contains("sides")
    );
    assert!(
        folder
            .refused("ifs tabulate a.npy --out x.npy")
            .contains("RIFS")
    );
    let other = Folder::new(80);
    assert!(other.refused("ifs fit a.npy --out a.ifs").contains("27"));
}

#[test]
fn maps_are_densified_and_interpolated() {
    let folder = Folder::new(65);
    let told = folder.json("densify a.npy --spacing 83 --levels 2 --noise calibrated --out d.npy");
    assert_eq!(
        (told["rows"].as_u64(), told["unknown"].as_u64()),
        (Some(257), Some(0))
    );
    let (coarse, fine) = (folder.values("a.npy"), folder.values("d.npy"));
    for i in 0..65 * 65 {
        assert_eq!(
            fine[i / 65 * 4 * 257 + i % 65 * 4],
            coarse[i],
            "a measured node moved"
        );
    }
    folder.json(
        "densify a.npy --levels 1 --noise fbm --hurst 0.7 --sigma 3 --stencil four --out e.npy",
    );
    folder.refused("densify a.npy --noise fbm --hurst 1.5 --sigma 3 --out x.npy");
    let told = folder.json("fis a.npy --step 8 --scale best --out f.npy");
    assert_eq!(told["bytes"], 4 * (9 * 9 + 1));
    assert!(told["psnr"].as_f64().unwrap() > 10.0);
    folder.json("fis a.npy --step 8 --scale hurst --hurst 0.8 --out f.npy");
    folder.refused("fis a.npy --step 8 --scale 1 --out x.npy");
    assert!(!folder.path("x.npy").exists());
}

/// Every way to be wrong: one line that names the culprit, exit code 2, the output as it was.
#[test]
fn bad_input_is_named_and_nothing_is_touched() {
    let folder = Folder::new(65);
    let mut values: Vec<f32> = folder.values("a.npy").iter().map(|z| *z as f32).collect();
    npy::write(&folder.path("flat.npy"), 28, 28, &[7.0; 784]).unwrap();
    npy::write(&folder.path("row.npy"), 1, 65, &values[..65]).unwrap();
    values[70] = f32::NAN;
    npy::write(&folder.path("holes.npy"), 65, 65, &values).unwrap();
    std::fs::write(folder.path("text.npy"), "no raster").unwrap();
    std::fs::write(folder.path("empty.rz"), "").unwrap();
    std::fs::write(folder.path("x.npy"), "before").unwrap();
    let cases = [
        ("compress absent.npy --bytes 500", "absent.npy"),
        ("compress text.npy --bytes 500", "text.npy"),
        ("compress a.npy --max-error 0", "--max-error"),
        ("compress a.npy --max-error -1", "--max-error"),
        ("compress a.npy --max-error nan", "--max-error"),
        ("compress a.npy --max-error 1e-9", "fine"),
        ("compress a.npy --bytes 5", "5 bytes"),
        ("compress a.npy --bytes 500 --max-error 1", "--max-error"),
        ("compress holes.npy --bytes 5000 --model fis", "node (1, 5)"),
        ("compress a.npy --bytes 5000 --model ifs", "27"),
        ("decompress empty.rz", "empty.rz"),
        ("decompress text.npy", "RZ"),
        ("fis a.npy --step 0", "--step"),
        ("fis a.npy --step 7", "k · 7 + 1"),
        ("fis a.npy --step 8 --scale 1", "--scale"),
        ("fis a.npy --step 8 --scale nan", "--scale"),
        ("fis a.npy --step 8 --scale hurst --hurst 1", "--hurst"),
        ("fis holes.npy --step 8", "node (1, 5)"),
        ("ifs fit holes.npy", "node (1, 5)"),
        ("fis row.npy --step 8", "row.npy"),
        ("ifs fit a.npy", "27"),
        ("ifs fit flat.npy --ridge -1", "--ridge"),
        ("ifs fit flat.npy --patch 29", "29"),
        ("ifs tabulate a.npy", "RIFS"),
        ("ifs tabulate absent.ifs", "absent.ifs"),
        ("densify a.npy --levels 0", "--levels"),
        ("densify a.npy --levels 99", "--levels"),
        ("densify row.npy", "row.npy"),
        ("densify text.npy", "text.npy"),
        ("densify a.npy --noise fbm --hurst 0 --sigma 1", "--hurst"),
        (
            "densify a.npy --noise fbm --hurst 0.5 --sigma -1",
            "--sigma",
        ),
    ];
    for (arguments, culprit) in cases {
        let message = folder.refused(&format!("{arguments} --out x.npy"));
        assert!(message.contains(culprit), "{arguments}: {message}");
        let after = std::fs::read(folder.path("x.npy")).unwrap();
        assert_eq!(after, b"before", "{arguments}");
    }
}

#[test]
fn what_the_scaling_range_was_chosen_from_is_told_on_request() {
    let folder = Folder::new(129);
    let told = folder.json("dimension a.npy --spacing 83 --explain");
    let bic = told["candidates"]["bic"].as_array().unwrap();
    assert_eq!(bic.len(), 4);
    assert!(
        !told["candidates"]["segments"]
            .as_array()
            .unwrap()
            .is_empty()
    );
    let quiet = folder.json("dimension a.npy --spacing 83");
    assert!(quiet["candidates"].is_null() && quiet["hurst"] == told["hurst"]);
}

/// Constant heights and holes have a defined result.
#[test]
fn odd_data_have_a_defined_result() {
    let folder = Folder::new(65);
    npy::write(&folder.path("flat.npy"), 28, 28, &[7.0; 784]).unwrap();
    folder.json("ifs fit flat.npy --out flat.ifs");
    folder.json("ifs tabulate flat.ifs --out b.npy");
    assert!(folder.values("b.npy").iter().all(|z| *z == 7.0));
    folder.json("fis flat.npy --step 3 --out b.npy");
    assert!(folder.values("b.npy").iter().all(|z| *z == 7.0));
    folder.json("compress flat.npy --max-error 0.1 --out flat.rz");
    folder.json("decompress flat.rz --out b.npy");
    assert!(folder.values("b.npy").iter().all(|z| *z == 7.0));
    let mut values: Vec<f32> = folder.values("a.npy").iter().map(|z| *z as f32).collect();
    values[70..75].fill(f32::NAN);
    npy::write(&folder.path("holes.npy"), 65, 65, &values).unwrap();
    folder.json("compress holes.npy --max-error 1 --out holes.rz");
    folder.json("decompress holes.rz --out b.npy");
    let back = folder.values("b.npy");
    assert!((0..65 * 65).all(|i| back[i].is_nan() == (70..75).contains(&i)));
    let dense = folder.json("densify holes.npy --out d.npy");
    let unknown = folder.values("d.npy").iter().filter(|z| z.is_nan()).count();
    assert!(dense["unknown"].as_u64() == Some(unknown as u64) && unknown >= 5);
    let field = folder.json("fis a.npy --step 8 --scale field --out f.npy");
    let best = folder.json("fis a.npy --step 8 --scale best --out f.npy");
    assert_eq!(field["scales"], 81);
    assert!(field["psnr"].as_f64().unwrap() > best["psnr"].as_f64().unwrap() + 0.1);
}
