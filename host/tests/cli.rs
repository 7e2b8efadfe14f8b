//! What the command line prints, and where.

use serde_json::Value;
use std::fs;
use std::process::{Command, Output};

fn rugosa(arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_rugosa"))
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_slice(&rugosa(arguments).stdout).unwrap()
}

#[test]
fn info_describes_points_and_rasters() {
    let directory = tempfile::tempdir().unwrap();
    let points = directory.path().join("a.csv");
    fs::write(&points, "0,0,1\n2,0,1\n0,3,inf\n2,4,5\n").unwrap();
    let report = json(&["info", points.to_str().unwrap(), "--json"]);
    assert_eq!(report["kind"], "points");
    assert_eq!(
        (&report["points"], &report["skipped"]),
        (&3.into(), &1.into())
    );
    assert_eq!(report["max_m"], serde_json::json!([2.0, 4.0, 5.0]));
    let raster = directory.path().join("a.asc");
    fs::write(
        &raster,
        "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 2\n1 2\n3 nan\n",
    )
    .unwrap();
    let report = json(&["--json", "info", raster.to_str().unwrap()]);
    assert_eq!(
        (&report["kind"], &report["known"]),
        (&"raster".into(), &3.into())
    );
}

#[test]
fn every_command_has_help_with_examples() {
    let help = String::from_utf8(rugosa(&["--help"]).stdout).unwrap();
    assert!(help.contains("Exit codes"));
    let commands = help
        .split("Commands:")
        .nth(1)
        .unwrap()
        .split("Options:")
        .next()
        .unwrap();
    let names: Vec<&str> = commands
        .lines()
        .filter_map(|l| l.split_whitespace().next())
        .collect();
    assert!(names.len() > 4);
    for name in names.into_iter().filter(|&n| n != "help") {
        let help = String::from_utf8(rugosa(&[name, "--help"]).stdout).unwrap();
        assert!(help.contains("Examples:"), "{name} has no examples");
        assert!(!help.contains('\u{1b}'), "{name}: colours in a pipe");
    }
}

#[test]
fn pages_and_completions_name_every_command() {
    let directory = tempfile::tempdir().unwrap();
    let pages = json(&["man", "--out", directory.path().to_str().unwrap(), "--json"]);
    let files = pages["files"].as_array().unwrap();
    assert!(files.len() > 5);
    let info = fs::read_to_string(directory.path().join("rugosa-info.1")).unwrap();
    assert!(info.contains("spacing"));
    for shell in ["bash", "zsh", "fish"] {
        let script = String::from_utf8(rugosa(&["completions", shell]).stdout).unwrap();
        assert!(
            script.contains("doctor") && script.contains("spacing"),
            "{shell}"
        );
    }
}

#[test]
fn the_printed_configuration_can_be_read_back() {
    let text = rugosa(&["config"]).stdout;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("rugosa.toml");
    fs::write(&path, &text).unwrap();
    assert_eq!(rugosa(&["config", path.to_str().unwrap()]).stdout, text);
}

#[test]
fn doctor_tells_versions() {
    let report = json(&["doctor", "--json"]);
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(report["tools"].as_array().unwrap().len(), 4);
}

#[test]
fn dimension_of_an_exact_surface_and_of_a_plane() {
    let directory = tempfile::tempdir().unwrap();
    let side = 129;
    let surface = rugosa_fractal::synthesis::exact_fbm(side, 0.5, 7);
    let path = directory.path().join("a.npy");
    rugosa_host::io::npy::write(&path, side, side, &surface).unwrap();
    let plot = directory.path().join("a.png");
    let arguments = [
        "dimension",
        path.to_str().unwrap(),
        "--spacing",
        "1",
        "--noise-std",
        "0",
        "--json",
        "--out",
        plot.to_str().unwrap(),
    ];
    let report = json(&arguments);
    let dimension = report["dimension"].as_f64().unwrap();
    assert!((dimension - 2.5).abs() < 0.08, "D = {dimension}");
    assert_eq!(report["fractal"], true);
    for key in [
        "hurst",
        "sigma",
        "standard_error",
        "noise_std",
        "residual",
        "pairs",
        "reason",
        "points",
    ] {
        assert!(report.get(key).is_some(), "{key}");
    }
    assert!(report["scaling_range_m"][1].as_f64() > report["scaling_range_m"][0].as_f64());
    assert!(report["seconds"]["estimate"].as_f64().unwrap() > 0.0);
    let bin = &report["bins"][0];
    assert!(
        ["lag_m", "mean_abs_dz", "rms_dz", "pairs"]
            .iter()
            .all(|key| bin[key].is_number())
    );
    assert!(plot.is_file());

    let points = directory.path().join("plane.xyz");
    let text: String = (0..400)
        .map(|i| format!("{} {} 1\n", i % 20, i / 20))
        .collect();
    fs::write(&points, text).unwrap();
    let report = json(&["dimension", points.to_str().unwrap(), "--json"]);
    assert_eq!(
        (&report["fractal"], &report["dimension"]),
        (&false.into(), &Value::Null)
    );
    assert!(report["reason"].is_string());
}

/// An asymmetric pattern far from the origin: every format must show it the same way.
#[test]
fn a_raster_becomes_a_map_in_every_format() {
    let directory = tempfile::tempdir().unwrap();
    let dem = directory.path().join("dem.asc");
    let mut text = String::from(
        "ncols 40\nnrows 30\nxllcorner 1000\nyllcorner 2000\ncellsize 0.5\nNODATA_value -9999\n",
    );
    for row in (0..30).rev() {
        let value = |column: usize| {
            if row < 3 && column > 36 {
                -9999.0
            } else {
                0.02 * column as f64 + 0.002 * (row * row) as f64
            }
        };
        let words: Vec<String> = (0..40).map(|column| value(column).to_string()).collect();
        text += &(words.join(" ") + "\n");
    }
    fs::write(&dem, text).unwrap();
    let out = directory.path().join("map");
    let report = json(&[
        "map",
        dem.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
        "--export",
        "npy,asc,png,ply,geotiff,mcap,nav2",
        "--json",
    ]);
    assert_eq!(
        (&report["cells_x"], &report["cells_y"], &report["points"]),
        (&40.into(), &30.into(), &1191.into())
    );
    for file in report["files"].as_array().unwrap() {
        assert!(
            fs::metadata(file.as_str().unwrap()).unwrap().len() > 0,
            "{file}"
        );
    }
    let before = rugosa_host::io::read_raster(&dem, None).unwrap();
    let after = rugosa_host::io::read_raster(&out.join("elevation.asc"), None).unwrap();
    assert_eq!(
        (after.origin, after.rows, after.columns),
        (before.origin, 30, 40)
    );
    for (a, b) in before.values.iter().zip(&after.values) {
        assert!(
            (a - b).abs() < 0.01 || a.is_nan() && b.is_nan(),
            "{a} became {b}"
        );
    }
    let bag = report["files"].as_array().unwrap().iter();
    let bag = bag
        .filter_map(|f| f.as_str())
        .find(|f| f.ends_with(".mcap"));
    let described = json(&["info", bag.unwrap(), "--json"]);
    assert_eq!(
        (&described["kind"], &described["points"]),
        (&"points".into(), &1191.into()),
        "a bag is not a recording"
    );
    let pgm = fs::read(out.join("map.pgm")).unwrap();
    assert!(pgm.starts_with(b"P5\n40 30\n255\n"));
    assert_eq!(pgm.last(), Some(&255), "the hole is at the lower right");
    assert_ne!(pgm[13], 255, "the upper left is known");
}

/// Two halves of a surface, mapped apart and merged, are the surface mapped at once.
#[test]
fn halves_are_merged_and_cut_again() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let point = |i: i32| {
        let [x, y] = [i % 120, i / 120].map(|n| 0.025 + 0.05 * f64::from(n));
        format!("{x} {y} {}\n", (1.1 * x).sin() * (0.7 * y).cos())
    };
    for (name, keep) in [("west", 0..70), ("east", 50..120), ("all", 0..120)] {
        let points = (0..120 * 100).filter(|i| keep.contains(&(i % 120)));
        fs::write(
            path(&format!("{name}.xyz")),
            points.map(point).collect::<String>(),
        )
        .unwrap();
        let out = path(name);
        let file = path(&format!("{name}.xyz"));
        rugosa(&[
            "map",
            &file,
            "--resolution",
            "0.1",
            "--out",
            &out,
            "--export",
            "rugosa,npy",
        ]);
    }
    let (west, east) = (path("west/map.rugosa"), path("east/map.rugosa"));
    let merge = |a: &str, b: &str, out: &str| {
        let out = path(out);
        let report = json(&["merge", a, b, "--out", &out, "--json"]);
        assert_eq!(
            (&report["cells_x"], &report["cells_y"]),
            (&60.into(), &50.into())
        );
        fs::read(out).unwrap()
    };
    assert!(merge(&west, &east, "a.rugosa") == merge(&east, &west, "b.rugosa"));
    let told = json(&["info", &path("a.rugosa"), "--json"]);
    assert_eq!(
        (&told["kind"], &told["rows"], &told["columns"]),
        (&"map".into(), &50.into(), &60.into())
    );
    assert_eq!(
        (&told["measured"], &told["merged"]),
        (&3000.into(), &true.into())
    );
    assert_eq!(json(&["info", &west, "--json"])["merged"], false);
    let top = told["max_m"].as_f64().unwrap();
    assert!((0.95..1.0).contains(&top), "{top}");
    let report = json(&[
        "map",
        &west,
        &east,
        "--out",
        &path("both"),
        "--export",
        "npy",
        "--report",
        "--json",
    ]);
    assert_eq!(report["cells"]["measured"], 3000);
    assert!(fs::metadata(path("both/report.html")).unwrap().len() > 4_000_000);
    let elevation = |name: &str| {
        let file = path(&format!("{name}/elevation.npy"));
        rugosa_host::io::npy::read_array(file.as_ref())
            .unwrap()
            .values
    };
    for (a, b) in elevation("all").iter().zip(elevation("both")) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    let part = path("part.rugosa");
    let report = json(&[
        "merge",
        &path("a.rugosa"),
        "--crop",
        "1,1,3,2",
        "--out",
        &part,
        "--json",
    ]);
    assert_eq!(
        (&report["cells_x"], &report["cells_y"]),
        (&20.into(), &10.into())
    );
}
